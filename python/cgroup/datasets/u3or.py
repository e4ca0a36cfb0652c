"""UWA 3D Object Recognition: whole models in range scans of four or five heaped toys.

Mian, Bennamoun and Owens: Three-dimensional model-based object recognition and segmentation in cluttered
scenes, IEEE TPAMI 28(10), 2006.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from cgroup import features
from cgroup._checks.values import as_length
from cgroup.datasets.base import (
    Dataset,
    MatchingPair,
    dataset_folder,
    fitting_pose,
    missing_file,
    split_by_files,
)
from cgroup.datasets.cache import cached
from cgroup.datasets.generated.scanner import Mesh, merge, range_image
from cgroup.errors import InputError
from cgroup.evaluation import clutter_and_occlusion
from cgroup.evaluation.ground_truth import VISIBLE_WITHIN
from cgroup.io import read_cloud, read_transform
from cgroup.io._files import load_text
from cgroup.types import PointCloud

if TYPE_CHECKING:
    from pathlib import Path

    from cgroup.datasets.base import Origin, Role
    from cgroup.types import FloatArray, IndexArray

URL = "http://www.csse.uwa.edu.au/~ajmal/recognition.html (models, 50 scenes, ground truth)"

MODEL_FILES = {
    "chef": ("cheff.ply", "cheff_simple.ply"),
    "chicken": ("chicken_high.ply", "chicken2.ply"),
    "parasaurolophus": ("parasaurolophus_high.ply", "parasaurolophus_low_normals2.ply"),
    "T-rex": ("T-rex_high.ply", "trex_small.ply"),
}
"""Files of the models whose poses are published: the owners' first, then simplified ones in circulation."""

OFFSETS = {"trex_small.ply": (18.28188121, -50.54808168, -608.03780463)}
"""What has to be added to the vertices of a file that its maker centred, in mm."""

PIXEL = 2.2e-3
"""Angle between two rays of the simulated scanner in radians, as in the real scans."""

_EARLIER_POSES = {(6, "parasaurolophus"): "parasaurolophus-rs6-old.xf"}
"""Published beside a pose that puts the model behind the scanner; taken in its place."""

_OCCLUSION_NAMES = {"chef": "chef", "chicken": "chicken", "para": "parasaurolophus", "trex": "T-rex"}
_FITTING_WITHIN = 2.0  # pr
_SIMULATION = "1"  # to be raised when simulated scenes change, so that the cache is made anew


class _Posed(NamedTuple):
    """A model and the scene that it is in, as meshes."""

    model: PointCloud
    scene: PointCloud
    T_scene_model: FloatArray
    pr: float

    def measure_facts(self, bound: float) -> dict[str, float]:
        model, scene = self.model, self.scene
        clutter, occlusion = clutter_and_occlusion(
            model.points,
            _faces(model),
            scene.points,
            _faces(scene),
            self.T_scene_model,
            tolerance=as_length("bound", bound) * self.pr,
        )
        return {"clutter": clutter, "occlusion": occlusion}


class U3OR(Dataset):
    """The 188 published pairs of four models and 50 scenes; unit mm, scanner at the origin looking along -z.

    A scene whose scan is there is used as it is and its pairs are *real*. Any other is simulated: the models
    are posed as published and seen by a range scanner in software, without noise; its pairs are
    *semi-synthetic*. Simulated scenes hold only models with a published pose, so there is less clutter in
    them. They are kept in the cache (`cgroup.datasets.cache.cache_folder`).

    The fact ``occlusion`` is the published one, for simulated scenes too; where none is published for the
    pose, it is computed. ``clutter`` isn't published: it is computed from the scene that is used, by
    `cgroup.evaluation.clutter_and_occlusion`, with models and scenes as meshes.

    Parameters
    ----------
    root : path-like, optional
        Data root; see `data_root`. Its folder ``u3or`` holds models, scenes and ground truth, in any folders.
    """

    name: ClassVar[str] = "u3or"
    title: ClassVar[str] = "U3OR"
    role: ClassVar[Role] = "full-partial"
    origin: ClassVar[Origin] = "semi-synthetic"
    protocols: ClassVar[tuple[str, ...]] = ("precision>0.1", "rmse<=1pr", "rmse<=5pr")
    citation: ClassVar[str] = (
        "Mian, Bennamoun, Owens: Three-dimensional model-based object recognition, PAMI 2006"
    )

    def __init__(self, root: Path | str | None = None) -> None:
        self._folder = dataset_folder(root, "u3or", title=self.title, url=URL)
        self._poses = _pose_files(self._folder)
        self._meshes: dict[str, Path] = {}
        for path in sorted(self._folder.rglob("*.ply")):
            self._meshes.setdefault(path.name, path)
        listed = {f"rs{scene}-{model}": (scene, model) for scene, model in self._poses}
        self._pairs, self._lacking = split_by_files(listed, self._find_lacking)
        if not self._pairs:
            raise missing_file(next(iter(self._lacking.values())), self.title, URL)
        self._occlusions = _published_occlusions(self._folder)
        self._models: dict[str, PointCloud] = {}  # read once: each is in many pairs

    def pair_names(self) -> list[str]:
        """Return ``rs1-T-rex``, ``rs1-chef``, ... of all published poses."""
        return list(self._pairs)

    def origin_of(self, name: str) -> Origin:
        """Return "real" where the scan is there, else "semi-synthetic"."""
        scene, _ = self._parse(name)
        return "real" if self._has_scan(scene) else "semi-synthetic"

    def load(self, name: str) -> MatchingPair:
        """Read the model, and read or simulate the scene."""
        posed = self._pose(name)
        facts = posed.measure_facts(VISIBLE_WITHIN)
        facts["occlusion"] = self._occlusions.get(self._pairs[name], facts["occlusion"])
        # A scan's normals are turned towards the scanner, so the scene goes in without its faces.
        seen = PointCloud(posed.scene.points)
        return MatchingPair(name, posed.model, seen, posed.T_scene_model, normals="mesh", facts=facts)

    def measure_facts(self, name: str, *, bound: float) -> dict[str, float]:
        """Measure clutter and occlusion with another bound; occlusion also where it is published."""
        return self._pose(name).measure_facts(bound)

    def model(self, name: str) -> PointCloud:
        """Read a model mesh, in the frame that the poses are for."""
        if name not in self._models:
            path = self._model_file(name)
            cloud = read_cloud(path)
            offset = OFFSETS.get(path.name, (0.0, 0.0, 0.0))
            self._models[name] = PointCloud(cloud.points + offset, faces=_faces(cloud))
        return self._models[name]

    def scene(self, number: int) -> PointCloud:
        """Read the scan of a scene, with faces; or simulate it."""
        path = self._scan_file(number)
        return self.simulated_scene(number) if path is None else read_cloud(path)

    def simulated_scene(self, number: int) -> PointCloud:
        """Look at the posed models of a scene, with faces between neighbouring pixels."""
        poses = self._poses_in(number)
        key = [_SIMULATION, str(PIXEL), *self._content(poses)]
        arrays = cached("u3or", key, lambda: self._look_at(poses))
        return PointCloud(arrays["points"], faces=arrays["faces"])

    def _pose(self, name: str) -> _Posed:
        scene_number, model_name = self._parse(name)
        model, scene = self.model(model_name), self.scene(scene_number)
        pr = (features.resolution(model.points) + features.resolution(scene.points)) / 2
        path = self._poses[scene_number, model_name]
        pose = fitting_pose(
            read_transform(path),
            model.points,
            scene.points,
            tolerance=_FITTING_WITHIN * pr,
            origin=str(path),
        )
        return _Posed(model, scene, pose, pr)

    def _poses_in(self, number: int) -> dict[str, Path]:
        """Files with the poses of the models in a scene."""
        return {model: path for (scene, model), path in self._poses.items() if scene == number}

    def _content(self, poses: dict[str, Path]) -> list[bytes]:
        """All that a simulated scene is made of, as the cache needs to know it."""
        files = [file for model, path in poses.items() for file in (self._model_file(model), path)]
        return [file.read_bytes() for file in files]

    def _look_at(self, poses: dict[str, Path]) -> dict[str, FloatArray | IndexArray]:
        parts = [pose_before_scanner(self._mesh(model), path) for model, path in poses.items()]
        image = range_image(merge(parts), step=PIXEL, offset=np.array([1.0, 1.0]), two_sided=True)
        return {"points": image.points(), "faces": image.faces()}

    def _mesh(self, model: str) -> Mesh:
        cloud = self.model(model)
        return Mesh(cloud.points, _faces(cloud))

    def _find_lacking(self, pair: tuple[int, str]) -> Path | None:
        """Name a missing file of a pair: its pose, its model, or what its scene is simulated from."""
        scene, model = pair
        if not self._poses[pair].is_file():
            return self._poses[pair]
        posed = [other for number, other in self._poses if number == scene]
        needed = (model,) if self._has_scan(scene) else (model, *posed)
        lacking = [name for name in needed if self._find_model(name) is None]
        return self._folder / "models" / MODEL_FILES[lacking[0]][0] if lacking else None

    def _parse(self, name: str) -> tuple[int, str]:
        self.check_name(name)
        return self._pairs[name]

    def _has_scan(self, number: int) -> bool:
        return self._scan_file(number) is not None

    def _scan_file(self, number: int) -> Path | None:
        whole = (path for name, path in self._meshes.items() if name.startswith(f"rs{number}_"))
        return self._meshes.get(f"rs{number}.ply") or next(whole, None)

    def _find_model(self, name: str) -> Path | None:
        found = (self._meshes[file] for file in MODEL_FILES[name] if file in self._meshes)
        return next(found, None)

    def _model_file(self, name: str) -> Path:
        path = self._find_model(name)
        if path is None:
            raise missing_file(self._folder / "models" / MODEL_FILES[name][0], self.title, URL)
        return path


def _pose_files(folder: Path) -> dict[tuple[int, str], Path]:
    found: dict[tuple[int, str], Path] = {}
    for path in folder.rglob("*-rs*.xf"):
        match = re.fullmatch(r"(.+)-rs(\d+)", path.stem)
        if match and match[1] in MODEL_FILES:
            pair = int(match[2]), match[1]
            found[pair] = path.with_name(_EARLIER_POSES.get(pair, path.name))
    if not found:
        raise missing_file(folder / "GroundTruth_3Dscenes" / "chef-rs1.xf", U3OR.title, URL)
    return dict(sorted(found.items()))


def pose_before_scanner(mesh: Mesh, path: Path) -> Mesh:
    """Move a model into the scene, by the pose in a file."""
    posed = mesh.move(read_transform(path))
    if posed.vertices[:, 2].max() >= 0:
        message = f"{path}: this pose puts the model behind the scanner; it has to be model to scene, in mm"
        raise InputError(message)
    return posed


def _published_occlusions(folder: Path) -> dict[tuple[int, str], float]:
    """Shares by scene and model; the file's lines read ``scene object percent``."""
    path = next(iter(sorted(folder.rglob("occlusion.txt"))), None)
    if path is None:
        return {}
    rows = [line.split() for line in load_text(path).splitlines()[1:] if line.strip()]
    try:
        published = {(int(scene), _OCCLUSION_NAMES[item]): float(share) / 100 for scene, item, share in rows}
    except (KeyError, ValueError) as error:
        message = f"{path}: a line isn't `scene object percent` ({error})"
        raise InputError(message) from error
    return {pair: share for pair, share in published.items() if pair not in _EARLIER_POSES}


def _faces(cloud: PointCloud) -> IndexArray:
    if cloud.faces is None:
        message = "a model or scan of U3OR has no faces; clutter and normals need meshes"
        raise InputError(message)
    return cloud.faces
