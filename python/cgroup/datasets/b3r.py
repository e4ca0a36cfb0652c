"""Bologna 3D Retrieval: complete models against complete, noisy copies."""

import configparser
from pathlib import Path
from typing import ClassVar, NamedTuple

from cgroup import features
from cgroup.datasets.base import FITTING_WITHIN, MatchingPair, fitting_pose, posed_pair
from cgroup.datasets.file_datasets import FileDataset
from cgroup.errors import InputError
from cgroup.io import read_cloud, read_transform
from cgroup.io.files import load_text
from cgroup.rigid import apply
from cgroup.types import FloatArray, PointCloud

# Of the published scenes; the unit is the mean edge length of the model's mesh, 1.4 to 1.6 pr.
NOISE_LEVELS = (0.1, 0.3, 0.5)


class _Entry(NamedTuple):
    number: int
    config: Path
    noise: float


class B3RClean(FileDataset[_Entry]):
    """The 18 scenes of B3R without noise: posed copies of the models, as input of nuisances."""

    name, title = "b3r-clean", "B3R"
    role, origin = "full-full", "real"
    citation = "Tombari, Salti, Di Stefano: Unique signatures of histograms, ECCV 2010"
    folder, example = "b3r", "**/ConfigScene0.ini"
    url = "http://vision.deis.unibo.it/research/80-shot (University of Bologna, Stanford Retrieval)"

    levels: ClassVar[tuple[float, ...]] = (0.0,)

    def load(self, name: str) -> MatchingPair:
        """Read or rebuild the scene, or pose the model."""
        entry = self._entry(name)
        model, pose = self._posed_model(entry)
        scene = self._noisy_scene(entry, model, pose) if entry.noise else model.transformed(pose)
        return posed_pair(name, model, scene, pose, noise=entry.noise)

    def _list_pairs(self) -> dict[str, _Entry]:
        paths = self._folder.rglob("ConfigScene*.ini")
        found = {int(path.stem.removeprefix("ConfigScene")): path for path in paths}
        return {
            f"scene{number}-noise{noise}" if noise else f"scene{number}": _Entry(number, path, noise)
            for number, path in sorted(found.items())
            for noise in self.levels
        }

    def _needed(self, entry: _Entry) -> list[tuple[Path, ...]]:
        try:
            config = _read_config(entry.config)
        except InputError:
            return []  # the error is raised on loading
        noisy = self._scene_places(entry, NOISE_LEVELS[0])
        return [self._model_places(config), self._pose_places(config), noisy[::-1]]

    def _posed_model(self, entry: _Entry) -> tuple[PointCloud, FloatArray]:
        config = _read_config(entry.config)
        model = read_cloud(self._locate(self._model_places(config)))
        pose = read_transform(self._locate(self._pose_places(config)))
        scene = self._published_scene(entry)
        tolerance = FITTING_WITHIN * features.resolution(model.points)
        return model, fitting_pose(pose, model, scene, tolerance=tolerance, origin=f"scene {entry.number}")

    def _noisy_scene(self, entry: _Entry, model: PointCloud, pose: FloatArray) -> PointCloud:
        published = next(filter(Path.is_file, self._scene_places(entry, entry.noise)), None)
        if published is not None:
            return read_cloud(published)
        lowest = self._published_scene(entry)
        if len(lowest) != len(model):
            counts = f"{len(lowest)} vertices, its model {len(model)}"
            raise InputError(f"{self._folder}: scene {entry.number} has {counts}")
        clean = apply(pose, model.points)
        points = clean + entry.noise / NOISE_LEVELS[0] * (lowest.points - clean)
        return PointCloud(points, faces=model.faces)

    def _published_scene(self, entry: _Entry) -> PointCloud:
        own, gathered = self._scene_places(entry, NOISE_LEVELS[0])
        return read_cloud(own if own.is_file() else self._locate((gathered,)))

    def _scene_places(self, entry: _Entry, noise: float) -> tuple[Path, Path]:
        stem, _, suffix = _path_in(_read_config(entry.config)["SCENE"]["PATH"]).rpartition(".")
        noisy = f"{stem}_{noise}.{suffix}"
        return self._folder / noisy, self._folder / "scenes" / noisy.rsplit("/", 1)[-1]

    def _model_places(self, config: configparser.ConfigParser) -> tuple[Path, Path]:
        """Owners' path below the data set's folder, or ``models/<name of its folder>.ply``."""
        path = _path_in(config["MODELS"]["MODEL_0"])
        return self._folder / path, self._folder / "models" / f"{path.split('/')[-2]}.ply"

    def _pose_places(self, config: configparser.ConfigParser) -> tuple[Path, Path]:
        path = _path_in(config["MODELS"]["MODEL_0_GROUNDTRUTH"])
        return self._folder / path, self._folder / "gt" / path.rsplit("/", 1)[-1]


class B3R(B3RClean):
    """The 54 pairs of B3R as published: 18 scenes, each with three levels of noise.

    If only the scenes with the lowest noise exist, the others are rebuilt: the published noise vectors
    of one scene are multiples of one another, and vertex i of a scene is vertex i of its model.
    """

    name = "b3r"
    levels = NOISE_LEVELS


def _read_config(path: Path) -> configparser.ConfigParser:
    config = configparser.ConfigParser()
    try:
        config.read_string(load_text(path))
        for section, key in (("MODELS", "MODEL_0"), ("MODELS", "MODEL_0_GROUNDTRUTH"), ("SCENE", "PATH")):
            config[section][key]
    except (OSError, UnicodeDecodeError, configparser.Error, KeyError) as error:
        raise InputError(f"{path}: not a readable scene configuration ({error})") from error
    return config


def _path_in(written: str) -> str:
    """Return a relative path; paths in the configurations are quoted and begin with a slash."""
    return written.strip().strip('"').replace("\\", "/").lstrip("/")
