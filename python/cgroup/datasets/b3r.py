"""Bologna 3D Retrieval: whole models against whole, noisy copies of them.

Tombari, Salti and Di Stefano: Unique signatures of histograms for local surface description, ECCV 2010.
"""

from __future__ import annotations

import configparser
import re
from typing import TYPE_CHECKING, ClassVar

from cgroup import features
from cgroup.datasets.base import (
    Dataset,
    MatchingPair,
    dataset_folder,
    fitting_pose,
    missing_file,
    split_by_files,
)
from cgroup.errors import InputError
from cgroup.features import ORIGIN
from cgroup.io import read_cloud, read_transform
from cgroup.io._files import load_text
from cgroup.rigid import apply
from cgroup.types import PointCloud

if TYPE_CHECKING:
    from pathlib import Path

    from cgroup.datasets.base import Origin, Role
    from cgroup.types import FloatArray

URL = "http://vision.deis.unibo.it/research/80-shot (University of Bologna, Stanford Retrieval)"

NOISE_LEVELS = (0.1, 0.3, 0.5)
"""Of the published scenes; the unit is the mean edge length of the model's mesh, 1.4 to 1.6 pr."""

_FITTING_WITHIN = 2.0  # pr


class B3RClean(Dataset):
    """The 18 scenes of B3R without noise: posed copies of the models, for noise and decimation to go on top.

    Parameters
    ----------
    root : path-like, optional
        Data root; see `data_root`.
    """

    name: ClassVar[str] = "b3r-clean"
    title: ClassVar[str] = "B3R"
    role: ClassVar[Role] = "full-full"
    origin: ClassVar[Origin] = "real"
    protocols: ClassVar[tuple[str, ...]] = ("precision>0.1", "rmse<=1pr", "rmse<=5pr")
    citation: ClassVar[str] = "Tombari, Salti, Di Stefano: Unique signatures of histograms, ECCV 2010"

    def __init__(self, root: Path | str | None = None) -> None:
        self._folder = dataset_folder(root, "b3r", title=self.title, url=URL)
        self._scenes = _scene_files(self._folder)
        names = {name: number for number in self._scenes for name in self._names_of(number)}
        self._names, self._lacking = split_by_files(names, self._find_lacking)
        if not self._names:
            raise missing_file(next(iter(self._lacking.values())), self.title, URL)

    def _names_of(self, number: int) -> list[str]:
        return [f"scene{number}"]

    def _find_lacking(self, number: int) -> Path | None:
        """Name a missing file of a scene: its model, its pose, or the published scene of the lowest noise."""
        try:
            config = _read_config(self._scenes[number])["MODELS"]
        except InputError:
            return None  # loading it says why
        for places in (self._model_files(config["MODEL_0"]), self._pose_files(config["MODEL_0_GROUNDTRUTH"])):
            if not any(place.is_file() for place in places):
                return places[0]
        places = self._scene_files(number, NOISE_LEVELS[0])
        return None if any(place.is_file() for place in places) else places[1]

    def pair_names(self) -> list[str]:
        """Return ``scene0`` to ``scene17``."""
        return list(self._names)

    def load(self, name: str) -> MatchingPair:
        """Pose the model."""
        self.check_name(name)
        model, pose = self._posed_model(int(name.removeprefix("scene")))
        return _pair(name, model, model.transformed(pose), pose, noise=0.0)

    def _posed_model(self, number: int) -> tuple[PointCloud, FloatArray]:
        config = _read_config(self._scenes[number])
        model = read_cloud(_first(self._model_files(config["MODELS"]["MODEL_0"]), self.title))
        pose = read_transform(_first(self._pose_files(config["MODELS"]["MODEL_0_GROUNDTRUTH"]), self.title))
        scene = self._published_scene(number, NOISE_LEVELS[0])
        pr = features.resolution(model.points)
        tolerance = _FITTING_WITHIN * pr
        return model, fitting_pose(
            pose, model.points, scene.points, tolerance=tolerance, origin=f"scene {number}"
        )

    def _published_scene(self, number: int, noise: float) -> PointCloud:
        path = self._scene_file(number, noise)
        if path is None:
            raise missing_file(self._scene_files(number, noise)[1], self.title, URL)
        return read_cloud(path)

    def _scene_file(self, number: int, noise: float) -> Path | None:
        return next((place for place in self._scene_files(number, noise) if place.is_file()), None)

    def _scene_files(self, number: int, noise: float) -> tuple[Path, Path]:
        path = _unquote(_read_config(self._scenes[number])["SCENE"]["PATH"])
        stem, _, suffix = path.rpartition(".")
        noisy = f"{stem}_{noise}.{suffix}"
        return self._folder / noisy, self._folder / "scenes" / noisy.rsplit("/", 1)[-1]

    def _model_files(self, written: str) -> tuple[Path, Path]:
        """Owners' path below the data set's folder, or ``models/<name of its folder>.ply``."""
        path = _unquote(written)
        return self._folder / path, self._folder / "models" / f"{path.split('/')[-2]}.ply"

    def _pose_files(self, written: str) -> tuple[Path, Path]:
        path = _unquote(written)
        return self._folder / path, self._folder / "gt" / path.rsplit("/", 1)[-1]


class B3R(B3RClean):
    """The 54 pairs of B3R as published: 18 scenes, each with three levels of noise.

    Where only the scenes with the lowest noise are there, the others are rebuilt: the published noise vectors
    of one scene are multiples of one another, and vertex i of a scene is vertex i of its model.

    Parameters
    ----------
    root : path-like, optional
        Data root; see `data_root`.
    """

    name: ClassVar[str] = "b3r"

    def _names_of(self, number: int) -> list[str]:
        return [f"scene{number}-noise{noise}" for noise in NOISE_LEVELS]

    def pair_names(self) -> list[str]:
        """Return ``scene0-noise0.1`` to ``scene17-noise0.5``."""
        return super().pair_names()

    def load(self, name: str) -> MatchingPair:
        """Read the model and its noisy scene."""
        self.check_name(name)
        scene, _, level = name.partition("-noise")
        number, noise = int(scene.removeprefix("scene")), float(level)
        model, pose = self._posed_model(number)
        return _pair(name, model, self._noisy_scene(number, noise, model, pose), pose, noise=noise)

    def _noisy_scene(self, number: int, noise: float, model: PointCloud, pose: FloatArray) -> PointCloud:
        published = self._scene_file(number, noise)
        if published is not None:
            return read_cloud(published)
        lowest = self._published_scene(number, NOISE_LEVELS[0])
        if len(lowest) != len(model):
            message = f"{self._folder}: scene {number} has {len(lowest)} vertices, its model {len(model)}"
            raise InputError(message)
        clean = apply(pose, model.points)
        points = clean + noise / NOISE_LEVELS[0] * (lowest.points - clean)
        return PointCloud(points, faces=model.faces)


def _pair(name: str, model: PointCloud, scene: PointCloud, pose: FloatArray, *, noise: float) -> MatchingPair:
    """Move the viewpoint with the model, so that normals have the same sign in both clouds."""
    x, y, z = (float(value) for value in pose[:3, 3])
    facts = {"noise": noise}
    return MatchingPair(name, model, scene, pose, ORIGIN, (x, y, z), normals="pca", facts=facts)


def _scene_files(folder: Path) -> dict[int, Path]:
    found = {int(path.stem.removeprefix("ConfigScene")): path for path in folder.rglob("ConfigScene*.ini")}
    if not found:
        raise missing_file(folder / "**" / "ConfigScene0.ini", "B3R", URL)
    return dict(sorted(found.items()))


def _read_config(path: Path) -> configparser.ConfigParser:
    config = configparser.ConfigParser()
    try:
        config.read_string(load_text(path))
        for section, key in (("MODELS", "MODEL_0"), ("MODELS", "MODEL_0_GROUNDTRUTH"), ("SCENE", "PATH")):
            config[section][key]
    except (OSError, UnicodeDecodeError, configparser.Error, KeyError) as error:
        message = f"{path}: not a readable scene configuration ({error})"
        raise InputError(message) from error
    return config


def _unquote(path: str) -> str:
    """Path as a relative one; the configurations begin theirs with a slash, in quotes."""
    return re.sub(r"\\", "/", path.strip().strip('"')).lstrip("/")


def _first(places: tuple[Path, ...], title: str) -> Path:
    for place in places:
        if place.is_file():
            return place
    raise missing_file(places[0], title, URL)
