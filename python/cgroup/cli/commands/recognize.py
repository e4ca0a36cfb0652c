"""``cgroup recognize``: find models in a scene."""

from __future__ import annotations

import itertools
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cgroup import io
from cgroup._checks.arrays import in_double
from cgroup.cli import options
from cgroup.cli.command import command, make_app
from cgroup.cli.inputs import describe_cloud, read_cloud
from cgroup.cli.options import Point, argument, option
from cgroup.cli.pose_files import name_frames, name_of_pair, refuse_others, write_pose
from cgroup.cli.show.json import Document
from cgroup.cli.show.tables import Column, print_table, show_length
from cgroup.cli.show.terminal import print_clouds, print_facts, print_files, show_stages
from cgroup.errors import InputError, NoConsensusError
from cgroup.io._files import check_outputs
from cgroup.io._results import Results
from cgroup.registration import recognize
from cgroup.registration.motions import say_direction
from cgroup.rigid import apply, rotation_error
from cgroup.rigid.transforms import axis_of

if TYPE_CHECKING:
    from cgroup.types import FloatArray, RealArray

_COLUMNS = (
    Column("model", is_text=True),
    Column("found", is_text=True),
    Column("probability"),
    Column("visible %"),
    Column("residual"),
)

app = make_app()


def _print_models(document: Document, *, wide: bool) -> None:
    """Print which models are in the scene, from the document."""
    results = document["results"]
    print_clouds(document["inputs"][:1])
    rows: list[tuple[str, ...]] = []
    for name in (Path(one["file"]).stem for one in document["inputs"][1:]):
        copies = [one for one in results["found"] if one["model"] == name]
        if not copies:
            rows.append((name, "no", "", "", ""))
        for place, one in enumerate(copies, 1):
            which = "yes" if len(copies) == 1 else f"{place} of {len(copies)}"
            numbers = f"{one['probability']:.3f}", f"{100 * one['fitness']:.0f}", f"{one['inlier_rmse']:.3g}"
            rows.append((name, which, *numbers))
    print_table(_COLUMNS, rows, wide=wide)
    if results["found"]:
        print_facts(*((Path(one["file"]).stem, _say_place(one)) for one in results["found"]))
        print_facts(
            ("voxel", f"{results['voxel']:.4g} (in the files' unit, as all lengths)"),
            ("time", f"{results['seconds']:.2f} s"),
        )
        print_files(document)


def _say_place(one: Document) -> str:
    """Return where the middle of a model is in the scene, and how the model is turned."""
    pose, middle = np.array(one["T_target_source"]), ", ".join(show_length(value) for value in one["middle"])
    turn = f"{rotation_error(pose, np.eye(4)):.3g} degrees about the axis {say_direction(axis_of(pose))}"
    return f"its middle at ({middle}), turned by {turn}"


@command(
    app,
    "recognize",
    "cgroup recognize chef.ply T-rex.ply --scene scan.ply --viewpoint 0 0 0",
    "",
    "# how many bolts, and where",
    "cgroup recognize bolt.stl --scene box.pcd --voxel 0.002 --json",
    show=_print_models,
)
def recognize_command(
    models: list[Path] = argument(
        "MODEL", f"Whole models, in the scene's unit; meshes are best: {options.FORMATS}."
    ),
    *,
    scene: Path = option(..., "CLOUD", "What they are looked for in.", options.CLOUDS),
    voxel: float | None = option(
        None,
        "LENGTH",
        "Edge length of the voxels, in the files' unit.",
        options.CLOUDS,
        "leaves about 10,000 voxels",
    ),
    viewpoint: Point | None = option(
        None,
        "X Y Z",
        "Where the scanner stood, if the scene is one single scan: tells far more.",
        options.CLOUDS,
    ),
    view_direction: Point | None = option(
        None, "X Y Z", "Where the scanner looked, where its place isn't known.", options.CLOUDS
    ),
    most: int | None = option(
        None, "COUNT", "Copies of each model to look for.", options.SEARCH, "any number", min=1
    ),
    out: Path = options.OUT,
    as_json: bool = options.JSON,
    wide: bool = options.WIDE,
) -> Document:
    """Say which models are in a scene, and where (exit status 3 if none is).

    Writes the pose and the posed cloud of each model found: MODEL_in_SCENE.txt and MODEL_in_SCENE.ply; of
    further copies MODEL_in_SCENE-2.txt and so on.
    """
    files = {file.stem: file for file in models}
    if len(files) < len(models):
        name = Counter(file.stem for file in models).most_common(1)[0][0]
        message = f"models: got two files named {name!r}; rename one"
        raise InputError(message)
    with show_stages() as begin:
        clouds = {name: read_cloud(file, begin) for name, file in files.items()}
        target = read_cloud(scene, begin)
        results = {name: Results(out, f"recognize {_stem(file, scene, 1)}") for name, file in files.items()}
        for name, file in files.items():
            first = _files_of(out, file, scene, 1)
            check_outputs(first)
            refuse_others(first[:1], name_frames(file, scene))
            results[name].check(first)
        found = recognize(
            clouds,
            target,
            voxel=voxel,
            viewpoint=viewpoint,
            view_direction=view_direction,
            most=most,
            progress=begin,
        )
    by_model = {name: [one for other, one in found if other == name] for name in files}
    outputs = {
        name: [_files_of(out, files[name], scene, copy) for copy in range(1, 1 + len(copies))]
        for name, copies in by_model.items()
    }
    for name, pairs in outputs.items():
        results[name].check(itertools.chain.from_iterable(pairs))
    for name, copies in by_model.items():
        with results[name].writing():
            for one, (pose, posed) in zip(copies, outputs[name], strict=True):
                write_pose(pose, one.T_target_source, name_frames(files[name], scene))
                io.write_cloud(posed, clouds[name].transformed(one.T_target_source))
    left = {name: iter(pairs) for name, pairs in outputs.items()}
    written = [next(left[name]) for name, _ in found]
    poses = [
        {
            "model": name,
            "file": pose.name,
            "T_target_source": one.T_target_source,
            "middle": apply(one.T_target_source, _middle(clouds[name].points)[None])[0],
            "probability": one.probability,
            "fitness": one.fitness,
            "inlier_rmse": one.inlier_rmse,
        }
        for (name, one), (pose, _) in zip(found, written, strict=True)
    ]
    said: Document = {
        "inputs": [
            describe_cloud("scene", scene, target),
            *(describe_cloud("model", file, clouds[name]) for name, file in files.items()),
        ],
        "results": {
            "found": poses,
            "not_found": [name for name in clouds if not by_model[name]],
            "voxel": found[0][1].voxel if found else None,
            "seconds": sum(found[0][1].seconds.values()) if found else None,
        },
        "files": list(itertools.chain.from_iterable(written)),
    }
    if not found:
        if not as_json:  # an error is an object of its own
            _print_models(said, wide=wide)
        hint = "; if the scene is one single scan, say where the scanner stood: --viewpoint"
        message = f"none of the models was found in {scene.name}{'' if viewpoint else hint}"
        raise NoConsensusError(message)
    return said


def _middle(points: RealArray) -> FloatArray:
    """Return the middle of the box around points, (3,)."""
    return (in_double(points.min(axis=0)) + in_double(points.max(axis=0))) / 2


def _stem(model: Path, scene: Path, copy: int) -> str:
    """Return what the files of a copy are called."""
    return name_of_pair(model, scene, "in") + (f"-{copy}" if copy > 1 else "")


def _files_of(folder: Path, model: Path, scene: Path, copy: int) -> tuple[Path, Path]:
    """Return where the pose and the posed cloud of a copy go."""
    stem = _stem(model, scene, copy)
    return folder / f"{stem}.txt", folder / f"{stem}.ply"
