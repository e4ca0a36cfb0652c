"""UWA 3D Object Recognition: complete models in range scans of four or five toys."""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cgroup.datasets.base import MatchingPair, Origin, faces_of, fitting_pose, measure_clutter
from cgroup.datasets.cache import cached
from cgroup.datasets.file_datasets import FileDataset
from cgroup.datasets.generated.scanner import Mesh, RangeImage, merge, range_image
from cgroup.errors import InputError
from cgroup.io import read_cloud, read_transform
from cgroup.io.files import load_text
from cgroup.types import PointCloud

MODEL_FILES = {
    "chef": ("cheff.ply", "cheff_simple.ply"),
    "chicken": ("chicken_high.ply", "chicken2.ply"),
    "parasaurolophus": ("parasaurolophus_high.ply", "parasaurolophus_low_normals2.ply"),
    "T-rex": ("T-rex_high.ply", "trex_small.ply"),
}
"""Files of the models whose poses are published: the owners' first, then simplified ones in circulation."""

# What has to be added to the vertices of a file that its maker centred, in mm.
OFFSETS = {"trex_small.ply": (18.28188121, -50.54808168, -608.03780463)}
PIXEL = 2.2e-3  # angle between two rays of the simulated scanner in radians, as in the real scans

# Published beside a pose that puts the model behind the scanner; taken in its place.
_EARLIER_POSES = {(6, "parasaurolophus"): "parasaurolophus-rs6-old.xf"}
_OCCLUSION_NAMES = {"chef": "chef", "chicken": "chicken", "para": "parasaurolophus", "trex": "T-rex"}
_SIMULATION = "1"  # to be raised when simulated scenes change, so that the cache is made anew


class _Posed(NamedTuple):
    scene: int
    model: str


class U3OR(FileDataset[_Posed]):
    """The 188 published pairs of four models and 50 scenes; unit mm, scanner at the origin looking along -z.

    A scene without a scan is simulated from the posed models, and its pairs are semi-synthetic. The fact
    ``occlusion`` is the published value, if any; ``clutter`` is computed from the scene in use.
    """

    name, title = "u3or", "U3OR"
    role, origin = "full-partial", "semi-synthetic"
    citation = "Mian, Bennamoun, Owens: Three-dimensional model-based object recognition, PAMI 2006"
    folder, example = "u3or", "GroundTruth_3Dscenes/chef-rs1.xf"
    url = "http://www.csse.uwa.edu.au/~ajmal/recognition.html (models, 50 scenes, ground truth)"

    def origin_of(self, name: str) -> Origin:
        """Return "real" if the scan is available, else "semi-synthetic"."""
        return "semi-synthetic" if self._scan_file(self._entry(name).scene) is None else "real"

    def load(self, name: str) -> MatchingPair:
        """Read the model; read or simulate the scene."""
        entry = self._entry(name)
        model, scene, path = self.model(entry.model), self.scene(entry.scene), self._poses[entry]
        pose = fitting_pose(read_transform(path), model, scene, origin=str(path))
        facts = measure_clutter(model, scene, pose)
        facts["occlusion"] = self._occlusions.get(entry, facts["occlusion"])
        # A scan's normals are oriented to the scanner, so the scene is used without its faces.
        return MatchingPair(name, model, PointCloud(scene.points), pose, normals="mesh", facts=facts)

    def model(self, name: str) -> PointCloud:
        """Read a model mesh, in the frame that the poses are for."""
        if name not in self._models:
            path = self._locate(self._model_places(name))
            cloud = read_cloud(path)
            offset = OFFSETS.get(path.name, (0.0, 0.0, 0.0))
            self._models[name] = PointCloud(cloud.points + offset, faces=faces_of(cloud))
        return self._models[name]

    def scene(self, number: int) -> PointCloud:
        """Read the scan of a scene, with faces; or simulate it."""
        path = self._scan_file(number)
        return self.simulated_scene(number) if path is None else read_cloud(path)

    def simulated_scene(self, number: int) -> PointCloud:
        """Simulate the scan of a scene's posed models, with faces between neighbouring pixels."""

        def simulate() -> dict[str, object]:
            image = self._look(number)
            return {"points": image.points(), "faces": image.faces()}

        arrays = cached("u3or", [_SIMULATION, str(PIXEL), *self._content(number)], simulate)
        return PointCloud(arrays["points"], faces=arrays["faces"])

    def _list_pairs(self) -> dict[str, _Posed]:
        """List ``rs1-T-rex``, ``rs1-chef``, ... of all published poses."""
        self._models: dict[str, PointCloud] = {}  # read once: each is in many pairs
        self._meshes: dict[str, Path] = {}
        for path in sorted(self._folder.rglob("*.ply")):
            self._meshes.setdefault(path.name, path)
        poses: dict[_Posed, Path] = {}
        for path in self._folder.rglob("*-rs*.xf"):
            match = re.fullmatch(r"(.+)-rs(\d+)", path.stem)
            if match and match[1] in MODEL_FILES:
                pair = _Posed(int(match[2]), match[1])
                poses[pair] = path.with_name(_EARLIER_POSES.get(pair, path.name))
        self._poses = dict(sorted(poses.items()))
        self._occlusions = _published_occlusions(self._folder)
        return {f"rs{pair.scene}-{pair.model}": pair for pair in self._poses}

    def _needed(self, entry: _Posed) -> list[tuple[Path, ...]]:
        """Return the files of the pose, the model, and the models of a simulated scene."""
        posed = self._poses_in(entry.scene) if self._scan_file(entry.scene) is None else []
        return [(self._poses[entry],), *(self._model_places(model) for model in (entry.model, *posed))]

    def _poses_in(self, number: int) -> dict[str, Path]:
        return {model: path for (scene, model), path in self._poses.items() if scene == number}

    def _content(self, number: int) -> list[bytes]:
        """Return all inputs of a simulated scene, as the key of the cache."""
        poses = self._poses_in(number).items()
        files = [file for model, path in poses for file in (self._locate(self._model_places(model)), path)]
        return [file.read_bytes() for file in files]

    def _look(self, number: int) -> RangeImage:
        posed: list[Mesh] = []
        for model, path in self._poses_in(number).items():
            cloud = self.model(model)
            posed.append(Mesh(cloud.points, faces_of(cloud)).move(read_transform(path)))
            if posed[-1].vertices[:, 2].max() >= 0:
                got = f"{path}: this pose puts the model behind the scanner"
                raise InputError(f"{got}; it has to be model to scene, in mm")
        return range_image(merge(posed), step=PIXEL, offset=np.array([1.0, 1.0]), two_sided=True)

    def _scan_file(self, number: int) -> Path | None:
        whole = (path for name, path in self._meshes.items() if name.startswith(f"rs{number}_"))
        return self._meshes.get(f"rs{number}.ply") or next(whole, None)

    def _model_places(self, name: str) -> tuple[Path, ...]:
        return tuple(self._meshes.get(file, self._folder / "models" / file) for file in MODEL_FILES[name])


def _published_occlusions(folder: Path) -> dict[tuple[int, str], float]:
    """Return fractions by scene and model, from lines ``scene object percent``."""
    path = next(iter(sorted(folder.rglob("occlusion.txt"))), None)
    if path is None:
        return {}
    rows = [line.split() for line in load_text(path).splitlines()[1:] if line.strip()]
    try:
        published = {(int(scene), _OCCLUSION_NAMES[item]): float(share) / 100 for scene, item, share in rows}
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: a line isn't `scene object percent` ({error})") from error
    return {pair: share for pair, share in published.items() if pair not in _EARLIER_POSES}
