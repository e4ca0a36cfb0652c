"""Range views of single objects, from Stanford's repository and UWA 3D Modeling."""

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cgroup.datasets.base import MatchingPair, fitting_pose, measure_overlap, view_pair
from cgroup.datasets.cache import cached
from cgroup.datasets.file_datasets import FileDataset, manifest_pairs
from cgroup.errors import InputError
from cgroup.features import Viewpoint
from cgroup.io import read_cloud
from cgroup.io.files import load_text
from cgroup.rigid import check_rigid, invert
from cgroup.rigid.transforms import turn
from cgroup.types import FloatArray

MIN_OVERLAP = 0.1  # pairs of Stanford's views that share less than this are left out

# M. Cyberware's scanners look along -z at a scan's own frame, here from far away.
SCANNER: Viewpoint = (0.0, 0.0, 10.0)


class _View(NamedTuple):
    path: Path
    T_world_view: FloatArray


class _ViewNames(NamedTuple):
    home: str
    source: str
    target: str


class StanfordViews(FileDataset[_ViewNames]):
    """Pairs ``object/source-target`` of range views with an overlap of at least `MIN_OVERLAP`; unit m.

    Pairs are read from the root's manifest if it lists them; else all views are compared, which takes a
    minute the first time.
    """

    name, title = "stanford", "Stanford views"
    role, origin, single_views = "partial-partial", "real", True
    citation = "Stanford 3D Scanning Repository; Turk, Levoy: Zippered polygon meshes, SIGGRAPH 1994"
    folder = "stanford_views"
    url = "http://graphics.stanford.edu/data/3Dscanrep (range data of bunny, happy buddha, ...)"

    def pair_names(self) -> list[str]:
        """Return the names of the listed pairs, or of all that overlap enough."""
        if not self._pairs:
            self._pairs = {_name_of(entry): entry for entry in self._overlapping()}
        return list(self._pairs)

    def note(self) -> str:
        """Return a sentence about missing pairs, or missing views of Stanford's lists."""
        if self._are_listed or not self._absent:
            return super().note()
        example = f"{len(self._absent)}, such as {self._absent[0]}"
        return f"pairs of views that aren't there are left out ({example})"

    def subject_of(self, name: str) -> str:
        """Return the object's folder."""
        return self._entry(name).home

    def load(self, name: str) -> MatchingPair:
        """Read two views and compute their overlap."""
        entry = self._entry(name)
        first, second = (self._objects[entry.home][stem] for stem in (entry.source, entry.target))
        clouds = read_cloud(first.path), read_cloud(second.path)
        return view_pair(name, *clouds, _between(first, second), SCANNER)

    def _list_pairs(self) -> dict[str, _ViewNames]:
        self._objects: dict[str, dict[str, _View]] = {}
        self._absent: list[str] = []
        for configuration in sorted(self._folder.rglob("*.conf")):
            home = configuration.parent
            named = home.parent if home.name == "data" else home
            views, files = _read_configuration(configuration)
            self._absent += [(home / file).relative_to(self._folder).as_posix() for file in files]
            self._objects.setdefault(named.relative_to(self._folder).as_posix(), {}).update(views)
        if not any(len(views) > 1 for views in self._objects.values()):
            raise self._missing(self._folder / (self._absent[0] if self._absent else "bunny/bun.conf"))
        pairs = manifest_pairs(self._folder.parent, self.folder)
        entries = [_ViewNames(pair["set"], _stem(pair["src"]), _stem(pair["tgt"])) for pair in pairs]
        self._are_listed = bool(entries)
        return {_name_of(entry): entry for entry in entries}

    def _find_lacking(self, entry: _ViewNames) -> Path | None:
        views = self._objects.get(entry.home, {})
        lacking = [stem for stem in (entry.source, entry.target) if stem not in views]
        return self._folder / entry.home / f"{lacking[0]}.ply" if lacking else None

    def _overlapping(self) -> list[_ViewNames]:
        found: list[_ViewNames] = []
        for home, views in self._objects.items():
            key: list[str | bytes] = ["overlap"]
            for view in views.values():
                key += [view.path.name, str(view.path.stat().st_size), view.T_world_view.tobytes()]
            shares = cached("stanford", key, lambda each=views: {"overlap": _all_overlaps(each)})["overlap"]
            pairs = zip(itertools.combinations(views, 2), shares, strict=True)
            found += [_ViewNames(home, *pair) for pair, share in pairs if share >= MIN_OVERLAP]
        return found


def _name_of(entry: _ViewNames) -> str:
    return f"{entry.home}/{entry.source}-{entry.target}"


def _read_configuration(path: Path) -> tuple[dict[str, _View], list[str]]:
    """Return available and missing views, from lines ``bmesh file tx ty tz qx qy qz qw``."""
    views: dict[str, _View] = {}
    absent: list[str] = []
    for line in load_text(path).splitlines():
        words = line.split()
        if len(words) != 9 or words[0] != "bmesh":
            continue
        if not (path.parent / words[1]).is_file():
            absent.append(words[1])
            continue
        try:
            numbers = np.array([float(word) for word in words[2:]])
        except ValueError as error:
            raise InputError(f"{path}: can't read the pose in the line {line!r}") from error
        pose = np.eye(4)  # Stanford's quaternions turn the other way round
        pose[:3, :3] = turn(*(numbers[3:] / np.linalg.norm(numbers[3:]))).T
        pose[:3, 3] = numbers[:3]
        views[_stem(words[1])] = _View(path.parent / words[1], pose)
    return views, absent


def read_views(folder: Path) -> list[tuple[Path, FloatArray]]:
    """Read the files of an object's views, and the poses that map them into its frame."""
    found = (_read_configuration(path)[0] for path in sorted(folder.glob("*.conf")))
    return [(path, pose) for views in found for path, pose in views.values()]


def _between(source: _View, target: _View) -> FloatArray:
    return invert(target.T_world_view) @ source.T_world_view


def _all_overlaps(views: dict[str, _View]) -> FloatArray:
    clouds = {stem: read_cloud(view.path) for stem, view in views.items()}
    pairs = itertools.combinations(views, 2)
    return np.array([measure_overlap(clouds[a], clouds[b], _between(views[a], views[b])) for a, b in pairs])


def _stem(file: str) -> str:
    return file.rsplit(".", 1)[0]


LIST_FILE = "pairs.txt"
"""In each model's folder: one line per pair, file of the source, file of the target, and 16 numbers, a 4x4
transform row by row that maps source points into the target's frame."""


class _PosedFiles(NamedTuple):
    source: Path
    target: Path
    pose: FloatArray


class U3M(FileDataset[_PosedFiles]):
    """Pairs ``model/source-target`` of views listed with a pose; unit mm, scanner at the origin of each view.

    The owners publish the views, one folder per model, but no poses: put your own poses in a
    `LIST_FILE` beside the views.
    """

    name, title = "u3m", "U3M"
    role, origin = "partial-partial", "real"
    citation = "Mian, Bennamoun, Owens: A novel representation and feature matching, IJCV 2006"
    folder, example = "u3m", f"<model>/{LIST_FILE}"
    url = "http://www.csse.uwa.edu.au/~ajmal/3Dmodeling.html (views; the poses aren't published)"

    def load(self, name: str) -> MatchingPair:
        """Read two views and compute their overlap."""
        entry = self._entry(name)
        source, target = read_cloud(entry.source), read_cloud(entry.target)
        return view_pair(name, source, target, fitting_pose(entry.pose, source, target, origin=name))

    def _list_pairs(self) -> dict[str, _PosedFiles]:
        pairs: dict[str, _PosedFiles] = {}
        for path in sorted(self._folder.rglob(LIST_FILE)):
            home = path.parent.relative_to(self._folder).as_posix()
            for entry in _read_list(path):
                pairs[f"{home}/{entry.source.stem}-{entry.target.stem}"] = entry
        return pairs


def _read_list(path: Path) -> Iterator[_PosedFiles]:
    for number, line in enumerate(load_text(path).splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        where = f"{path}, line {number}"
        try:
            pose = np.array([float(word) for word in words[2:]])
        except ValueError as error:
            raise InputError(f"{where}: {error}; give two file names and 16 numbers") from error
        if len(words) != 18:
            raise InputError(f"{where}: has {len(words)} words; give two file names and 16 numbers")
        source, target = (path.parent / word for word in words[:2])
        yield _PosedFiles(source, target, check_rigid(pose.reshape(4, 4), where))
