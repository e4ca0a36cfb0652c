"""Range views of the Stanford 3D Scanning Repository, with Stanford's own alignment.

Partial views against partial views: they take the place of UWA 3D Modeling, whose poses aren't published.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from cgroup.datasets.base import (
    Dataset,
    MatchingPair,
    dataset_folder,
    measure_overlap,
    missing_file,
    split_by_files,
)
from cgroup.datasets.cache import cached
from cgroup.datasets.manifest import manifest_entry
from cgroup.errors import InputError
from cgroup.io import read_cloud
from cgroup.io._files import load_text
from cgroup.rigid import invert

if TYPE_CHECKING:
    from pathlib import Path

    from cgroup.datasets.base import Origin, Role
    from cgroup.features import Viewpoint
    from cgroup.types import FloatArray

URL = "http://graphics.stanford.edu/data/3Dscanrep (range data of bunny, happy buddha, ...)"

MIN_OVERLAP = 0.1
"""Pairs of views that share less than this are left out."""

SCANNER: Viewpoint = (0.0, 0.0, 10.0)
"""Cyberware's scanners look along -z at a scan's own frame, here from far away; in m."""


@dataclass(frozen=True, eq=False)
class _View:
    path: Path
    T_world_view: FloatArray


class _Listed(NamedTuple):
    folder: str
    source: str
    target: str


class StanfordViews(Dataset):
    """Pairs of range views with an overlap of at least `MIN_OVERLAP`; unit m.

    Parameters
    ----------
    root : path-like, optional
        Data root; see `data_root`. Its folder ``stanford_views`` holds one folder per object, each with the
        views and their ``.conf``, as in Stanford's archives.
    """

    name: ClassVar[str] = "stanford"
    title: ClassVar[str] = "Stanford views"
    role: ClassVar[Role] = "partial-partial"
    origin: ClassVar[Origin] = "real"
    protocols: ClassVar[tuple[str, ...]] = ("precision>0.1", "rmse<=1pr", "rmse<=5pr")
    citation: ClassVar[str] = (
        "Stanford 3D Scanning Repository; Turk, Levoy: Zippered polygon meshes, SIGGRAPH 1994"
    )
    single_views: ClassVar[bool] = True

    def __init__(self, root: Path | str | None = None) -> None:
        self._folder = dataset_folder(root, "stanford_views", title=self.title, url=URL)
        self._objects, self._absent = _objects(self._folder)
        self._listed, self._lacking = split_by_files(self._list_pairs(), self._find_lacking)
        if self._lacking and not self._listed:
            raise missing_file(next(iter(self._lacking.values())), self.title, URL)
        self._names = list(self._listed)

    def pair_names(self) -> list[str]:
        """Return ``object/source-target`` of all pairs that overlap enough.

        They are taken from the root's manifest where it lists them; else found by looking at all views, which
        takes a minute the first time.
        """
        if not self._names:
            self._names = self._overlapping()
        return list(self._names)

    def note(self) -> str:
        """Return a sentence about listed pairs, or views of Stanford's own lists, that aren't there."""
        if self._listed or not self._absent:
            return super().note()
        return (
            f"pairs of views that aren't there are left out ({len(self._absent)}, such as {self._absent[0]})"
        )

    def subject_of(self, name: str) -> str:
        """Return the object's folder."""
        self.check_name(name)
        return name.rpartition("/")[0]

    def load(self, name: str) -> MatchingPair:
        """Read two views and compute their overlap."""
        self.check_name(name)
        first, second = self._views(name)
        source, target = read_cloud(first.path), read_cloud(second.path)
        pose = _between(first, second)
        shared = measure_overlap(source, target, pose)
        return MatchingPair(name, source, target, pose, SCANNER, SCANNER, facts={"overlap": shared})

    def _find_lacking(self, pair: _Listed) -> Path | None:
        views = self._objects.get(pair.folder, {})
        lacking = [stem for stem in (pair.source, pair.target) if stem not in views]
        return self._folder / pair.folder / f"{lacking[0]}.ply" if lacking else None

    def _views(self, name: str) -> tuple[_View, _View]:
        folder, _, pair = name.rpartition("/")
        views = self._objects[folder]
        for source, target in itertools.permutations(views, 2):
            if pair == f"{source}-{target}":
                return views[source], views[target]
        message = f"{self.name}: has no pair {name!r}"
        raise InputError(message)

    def _list_pairs(self) -> dict[str, _Listed]:
        entry = manifest_entry(self._folder.parent, "stanford_views")
        pairs = [
            _Listed(pair["set"], _stem(pair["src"]), _stem(pair["tgt"]))
            for pair in (entry["pairs"] if entry else [])
        ]
        return {f"{pair.folder}/{pair.source}-{pair.target}": pair for pair in pairs}

    def _overlapping(self) -> list[str]:
        names: list[str] = []
        for folder, views in self._objects.items():
            pairs = list(itertools.combinations(views, 2))
            key = ["overlap", *(part for view in views.values() for part in _fingerprint(view))]
            clouds = {stem: view.path for stem, view in views.items()}
            shares = cached("stanford", key, lambda v=views, c=clouds: {"overlap": _all_overlaps(v, c)})[
                "overlap"
            ]
            listed = zip(pairs, shares, strict=True)
            names += [f"{folder}/{a}-{b}" for (a, b), share in listed if share >= MIN_OVERLAP]
        return names


def _objects(folder: Path) -> tuple[dict[str, dict[str, _View]], list[str]]:
    """List the views of each object, by the object's folder and the view's name; and those not there."""
    found: dict[str, dict[str, _View]] = {}
    absent: list[str] = []
    for configuration in sorted(folder.rglob("*.conf")):
        home = configuration.parent
        named = home.parent if home.name == "data" else home
        views, files = _read_configuration(configuration)
        absent += [(home / file).relative_to(folder).as_posix() for file in files]
        found.setdefault(named.relative_to(folder).as_posix(), {}).update(views)
    if not any(len(views) > 1 for views in found.values()):
        example = absent[0] if absent else "bunny/bun.conf"
        raise missing_file(folder / example, StanfordViews.title, URL)
    return found, absent


def _read_configuration(path: Path) -> tuple[dict[str, _View], list[str]]:
    """Read the views that are there, and name other files; lines read ``bmesh file tx ty tz qx qy qz qw``."""
    views: dict[str, _View] = {}
    absent: list[str] = []
    for line in load_text(path).splitlines():
        words = line.split()
        if len(words) != 9 or words[0] != "bmesh":
            continue
        if (path.parent / words[1]).is_file():
            try:
                numbers = np.array([float(word) for word in words[2:]])
            except ValueError as error:
                message = f"{path}: can't read the pose in the line {line!r}"
                raise InputError(message) from error
            views[_stem(words[1])] = _View(path.parent / words[1], _pose(numbers[:3], numbers[3:]))
        else:
            absent.append(words[1])
    return views, absent


def _pose(translation: FloatArray, quaternion: FloatArray) -> FloatArray:
    """View to world: p_world = R(q)^T p + t; Stanford's quaternions turn the other way round."""
    x, y, z, w = quaternion / np.linalg.norm(quaternion)
    transform = np.eye(4)
    transform[:3, :3] = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
            [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
            [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    transform[:3, 3] = translation
    return transform


def _between(source: _View, target: _View) -> FloatArray:
    return invert(target.T_world_view) @ source.T_world_view


def _all_overlaps(views: dict[str, _View], files: dict[str, Path]) -> FloatArray:
    clouds = {stem: read_cloud(path) for stem, path in files.items()}
    return np.array(
        [
            measure_overlap(clouds[a], clouds[b], _between(views[a], views[b]))
            for a, b in itertools.combinations(views, 2)
        ]
    )


def _fingerprint(view: _View) -> tuple[str, str, bytes]:
    return view.path.name, str(view.path.stat().st_size), view.T_world_view.tobytes()


def _stem(file: str) -> str:
    return file.rsplit(".", 1)[0]
