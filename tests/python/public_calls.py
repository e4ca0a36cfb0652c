"""Every public function and class that takes arguments of the user's, and arguments with which it works."""

import importlib
import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from colmap_files import make_views, write_model
from public_names import public_names

from cgroup import features, registration, verification
from cgroup.datasets import standin_pair
from cgroup.datasets.matching_problems import make_problem
from cgroup.io import read_colmap, write_cloud, write_correspondences, write_descriptors, write_transform
from cgroup.registry import METHOD_INFO
from cgroup.types import PointCloud

MODULES = (
    "",
    "features",
    "registration",
    "verification",
    "evaluation",
    "nuisances",
    "rigid",
    "targets",
    "io",
)

INPUTS = {"Cloud", "Correspondences", "DenseFront", "FineSurface", "PaperFront", "Surface"}
"""Classes that take arguments of the user's; the others hold what the library computed, or read from a file."""


PROBLEM = make_problem(np.random.default_rng(0), 12, inlier_ratio=0.8)
MATCHES = PROBLEM.correspondences()
PAIR = standin_pair(pixels=30)
POINTS = PAIR.source.points
VOXEL = 9.5


class Call(NamedTuple):
    """A public function with keyword arguments that it can work with."""

    function: Callable[..., Any]
    arguments: dict[str, Any]

    def run(self, **changed: Any) -> Any:
        arguments = {**self.arguments, **changed}
        parameters = inspect.signature(self.function).parameters.values()
        spread = [
            arguments.pop(p.name) for p in parameters if p.kind is p.VAR_POSITIONAL and p.name in arguments
        ]
        result = self.function(*(value for values in spread for value in values), **arguments)
        return list(result) if inspect.isgenerator(result) else result


def called_names() -> set[str]:
    """Names of all public functions, and of classes that take arguments, such as "features.normals"."""
    parts = {
        name.removeprefix("cgroup.").rpartition("."): each.value for name, each in public_names().items()
    }
    return {
        f"{module}{dot}{name}"
        for (module, dot, name), value in parts.items()
        if module in MODULES and (name in INPUTS or inspect.isfunction(value))
    }


def public_calls(folder: Path) -> dict[str, Call]:
    """Make a call of each, with files in a folder."""
    arguments = {
        "": _grouping(),
        "features": _front_end(),
        "verification": _verification(),
        "registration": _registration(),
        **_judgement(),
        "io": _files(folder),
    }
    calls = {}
    for module, of_it in arguments.items():
        home = importlib.import_module(f"cgroup.{module}".rstrip("."))
        calls |= {f"{module}.{name}".lstrip("."): Call(getattr(home, name), of_it[name]) for name in of_it}
    return calls


def _grouping() -> dict[str, dict[str, Any]]:
    names = {info.function.__name__: (*info.fields, *info.optional_fields) for info in METHOD_INFO.values()}
    frames = ("source", "target", "source_lrf", "target_lrf")
    fields = {
        function: {name: getattr(PROBLEM, name) for name in taken if hasattr(PROBLEM, name)}
        for function, taken in (names | {"Correspondences": frames}).items()
    }
    group = {"correspondences": MATCHES, "method": "gc"}
    found = {"matches": MATCHES, "grouping": METHOD_INFO["gc"].function(**fields["gc"])}
    return fields | {
        "group": group,
        "group_many": {"problems": [MATCHES], "method": "gc"},
        "group_motions": {"matches": MATCHES},
        "match_probabilities": found,
        "certify": found,
    }


@cache
def _described() -> features.DescribedCloud:
    return registration.describe(PAIR.source, descriptor="rcs")


def _front_end() -> dict[str, dict[str, Any]]:
    cloud = features.Cloud(POINTS)
    points, keypoints, radius = {"points": cloud}, {"keypoints": [0, 300]}, {"radius": 20.0}
    normals = {"normals": features.normals(cloud)}
    corners = {"points": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]]}
    return {
        "Cloud": {"points": POINTS},
        "resolution": points,
        "within": {**points, "others": POINTS, "radius": 1.0},
        "voxel_downsample": {**points, "voxel": 10.0},
        "choose_voxel": {"clouds": [cloud, POINTS]},
        "normals": points,
        "mesh_normals": corners,
        "sample_mesh": {"mesh": PointCloud(corners["points"], faces=corners["faces"])},
        "harris3d": points,
        "iss": points,
        "drop_isolated": points | keypoints,
        "shot_lrf": points | keypoints | radius,
        "toldi_lrf": points | keypoints | radius,
        "shot": points | keypoints | radius | normals,
        "lfsh": points | keypoints | radius | normals,
        "fpfh": points | keypoints | radius | normals,
        "rcs": points | keypoints | radius,
        "match": {"source": np.eye(3), "target": np.eye(3)},
    }


def _verification() -> dict[str, dict[str, Any]]:
    normals = features.normals(POINTS)
    surface = verification.Surface(POINTS, normals, unit=0.4 * VOXEL)
    fine = verification.FineSurface(POINTS, VOXEL / 2)
    pair, pose = {"source": surface, "target": surface}, {"pose": np.eye(4)}
    return {
        "Surface": {"points": POINTS, "normals": normals, "unit": 0.4 * VOXEL},
        "FineSurface": {"points": POINTS, "spacing": VOXEL / 2},
        "align": {"source": fine, "target": fine} | pose,
        "places": pair | pose,
        "score_poses": pair | {"poses": [np.eye(4)]},
        "verify": pair | {"poses": [np.eye(4)], "matches": MATCHES},
    }


def _registration() -> dict[str, dict[str, Any]]:
    pair, voxel, scene = {"source": PAIR.source, "target": PAIR.target}, {"voxel": VOXEL}, PAIR.target
    described = _described()
    return {
        "DenseFront": {},
        "PaperFront": {},
        "correspond": pair,
        "describe": {"cloud": PAIR.source},
        "detect": {"cloud": PAIR.source},
        "surface_normals": {"cloud": PAIR.source},
        "match_described": {"source": described, "target": described},
        "prepare": {"cloud": PAIR.source} | voxel,
        "register": pair | voxel | {"effort": "low"},
        "assess": pair | voxel | {"T_target_source": PAIR.T_target_source},
        "refine": pair | voxel | {"T_target_source": PAIR.T_target_source},
        "false_accepts": {"results": [None]},
        "register_many": {"scans": [PAIR.source, PAIR.target]} | voxel,
        "recognize": {"models": {"a": PAIR.source}, "scene": scene} | voxel,
        "find_instances": {"model": PAIR.source, "scene": scene} | voxel,
    }


def _judgement() -> dict[str, dict[str, dict[str, Any]]]:
    pose, tolerance = {"T_target_source": np.eye(4)}, {"tolerance": 1.0}
    matched, poses = (
        {"source": PROBLEM.source, "target": PROBLEM.target},
        {"estimated": np.eye(4), "true": np.eye(4)},
    )
    mesh = {"model": np.eye(3), "model_faces": [[0, 1, 2]], "scene": np.eye(3), "scene_faces": [[0, 1, 2]]}
    rng = {"rng": np.random.default_rng(0)}
    pair = {"pair": standin_pair(pixels=60), "level": 0.9} | rng
    return {
        "evaluation": {
            "match_errors": matched | pose,
            "correct_matches": matched | pose | tolerance,
            "overlap": matched | pose | tolerance,
            "alignment_error": matched | poses | tolerance,
            "clutter_and_occlusion": mesh | {"T_scene_model": np.eye(4)} | tolerance,
            "ecdf": {"errors": [1.0, 2.0], "limits": [1.5]},
            "mean_average_accuracy": {"errors": [1.0, 2.0], "limits": [1.5]},
            "inlier_ratio": matched | pose,
            "redwood_error": poses | {"information": np.eye(6)},
            "registration_recall": {"registered": [True, False], "scenes": ["a", "b"]},
            "feature_matching_recall": {"inlier_ratios": [0.1, 0.2], "scenes": ["a", "b"]},
            "score_scene": {
                "poses": [np.eye(4)] * 2,
                "components": [[0, 1]],
                "truth": [np.eye(4)] * 2,
                "labels": ["here", "here"],
            },
            "score_group": {"mask": [True, False], "correct": [True, True]},
        },
        "targets": {"fit_targets": {"source": np.eye(4, 3), "target": np.eye(4, 3)}},
        "nuisances": {
            "add_noise": {"cloud": PAIR.source, "sigma": 0.1} | rng,
            "decimate": {"cloud": PAIR.source, "share": 0.5} | rng,
            "apply_nuisance": {"name": "noise"} | pair,
        },
        "rigid": {
            "apply": {"transform": np.eye(4), "points": POINTS},
            "invert": {"transform": np.eye(4)},
            "check_rigid": {"transform": np.eye(4)},
            "rotation_error": poses,
            "translation_error": poses,
        },
    }


def _files(folder: Path) -> dict[str, dict[str, Any]]:
    described = _described()
    write_cloud(folder / "cloud.ply", PAIR.source)
    np.save(folder / "depth.npy", np.ones((2, 2)))
    write_descriptors(folder / "described.npz", described)
    write_correspondences(folder / "matches.npz", MATCHES)
    write_transform(folder / "pose.txt", np.eye(4))
    (folder / "targets.csv").write_text("T1;1;2;3\n")
    model = write_model(folder / "sparse", make_views(), "txt")
    return {
        "read_colmap": {"folder": model},
        "write_colmap": {"folder": folder / "other", "model": read_colmap(model)},
        "read_cloud": {"path": folder / "cloud.ply"},
        "read_depth": {"path": folder / "depth.npy", "intrinsics": [500, 500, 1, 1]},
        "read_descriptors": {"path": folder / "described.npz"},
        "read_correspondences": {"path": folder / "matches.npz"},
        "read_targets": {"path": folder / "targets.csv"},
        "read_transform": {"path": folder / "pose.txt"},
        "read_transforms": {"path": folder / "pose.txt"},
        "merge_files": {"paths": [folder / "cloud.ply"], "poses": [np.eye(4)], "out": folder / "merged.las"},
        "transform_file": {
            "path": folder / "cloud.ply",
            "pose": np.eye(4),
            "out": folder / "moved.ply",
            "scale": 1.0,
        },
        "write_file": {"path": folder / "file", "content": b"content"},
        "write_cloud": {"path": folder / "other.ply", "cloud": PAIR.source},
        "write_descriptors": {"path": folder / "other.npz", "described": described},
        "write_keypoints": {"path": folder / "keypoints.ply", "cloud": PAIR.source, "indices": [0, 3]},
        "write_correspondences": {"path": folder / "others.npz", "correspondences": MATCHES},
        "write_mask": {"path": folder / "mask.npy", "mask": [True, False]},
        "write_transform": {"path": folder / "other.txt", "transform": np.eye(4)},
    }
