"""Sets of scans with true poses, of one place, or mixed from several places and objects."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cgroup.datasets.file_datasets import data_root
from cgroup.datasets.generated.stones import random_pose, standin_pair
from cgroup.datasets.threedmatch import ThreeDMatch
from cgroup.datasets.views import read_views
from cgroup.errors import InputError
from cgroup.io import read_cloud
from cgroup.io.files import load_json, load_text
from cgroup.rigid import apply, check_rigid, invert
from cgroup.types import FloatArray

_TURNS, _PIXELS = (0.0, 36.0, 72.0, 108.0, 144.0, 180.0), 90
_MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])


@dataclass(frozen=True, eq=False)
class ScanSet:
    """Scans in frames of their own, with true poses."""

    scans: list[FloatArray]  # points (n,3) of each
    truth: FloatArray  # (N,4,4), map each scan into the frame of its place
    labels: list[str]  # the place or object of each scan
    at_scanner: bool = False  # whether the scanner is at the origin of each scan

    def mirrored(self) -> ScanSet:
        """Reflect every place; its scans fit each other as before, but no scan of the original place."""
        scans = [points @ _MIRROR[:3, :3] for points in self.scans]
        labels = [f"{each}, mirrored" for each in self.labels]
        return ScanSet(scans, _MIRROR @ self.truth @ _MIRROR, labels, self.at_scanner)


def pool_sets(sets: Iterable[ScanSet], rng: np.random.Generator) -> ScanSet:
    """Shuffle the scans of several sets, each in a random frame about its scanner or its centroid."""
    pool = [
        (*each, part.at_scanner)
        for part in sets
        for each in zip(part.scans, part.truth, part.labels, strict=True)
    ]
    moved: list[tuple[FloatArray, FloatArray, str]] = []
    for row in rng.permutation(len(pool)):
        points, pose, label, at_scanner = pool[row]
        frame = np.eye(4)
        frame[:3, :3] = random_pose(rng)[:3, :3]
        if not at_scanner:
            spread = points.std(axis=0).max()
            frame[:3, 3] = spread * rng.normal(size=3) - frame[:3, :3] @ points.mean(axis=0)
        moved.append((apply(frame, points), pose @ invert(frame), label))
    truth = np.array([pose for _, pose, _ in moved])
    return ScanSet([points for points, _, _ in moved], truth, [label for *_, label in moved])


def make_views(seed: int) -> ScanSet:
    """Scan a generated stone from six sides, 36 degrees apart; unit mm."""
    pairs = [standin_pair(seed=seed, turn=turn, pixels=_PIXELS) for turn in _TURNS[1:]]
    scans = [pairs[0].source.points, *(pair.target.points for pair in pairs)]
    truth = [np.eye(4), *(invert(pair.T_target_source) for pair in pairs)]
    return ScanSet([np.asarray(each, np.float64) for each in scans], np.array(truth), [f"stone {seed}"] * 6)


def read_folder(folder: Path) -> ScanSet:
    """Read a folder with a ``set.json``, whose `scans` have a `file` and the pose `world_from_scan`."""
    path = folder / "set.json"
    try:
        entries: Any = load_json(load_text(path))["scans"]
        files = [(str(each["file"]), each["world_from_scan"]) for each in entries]
    except (ValueError, KeyError, TypeError) as error:
        message = f"{path}: not a list of scans, each with `file` and `world_from_scan` ({error!r})"
        raise InputError(message) from error
    truth = np.array([check_rigid(pose, f"{path}: {file}") for file, pose in files])
    scans = [_read(folder / file) for file, _ in files]
    return ScanSet(scans, truth, [folder.name] * len(files), at_scanner=True)


def read_stanford(folder: Path) -> ScanSet:
    """Read the views of one object, placed by the ``.conf`` file in its folder; unit m."""
    views = read_views(folder)
    truth = np.array([pose for _, pose in views])
    return ScanSet([_read(path) for path, _ in views], truth, [folder.name] * len(views))


def read_fragments(folder: Path) -> ScanSet:
    """Read the fragments of a scene of 3DMatch, placed by chains of its pairs; unit m."""
    dataset = ThreeDMatch(folder.parents[1])
    names = [name for name in dataset.pair_names() if dataset.subject_of(name) == folder.name]
    pairs = {name: tuple(map(int, name.split("/")[-1].split("-"))) for name in names}
    if not pairs:
        raise InputError(f"{folder}: no poses of this scene; put its gt.log into {folder}-evaluation")
    poses: dict[int, FloatArray] = {}
    scans: dict[int, FloatArray] = {}
    while reached := next(
        (each for each in pairs if not poses or len(poses.keys() & pairs[each]) == 1), None
    ):
        pair = dataset.load(reached)
        target, source = pairs[reached]
        if not poses or target in poses:
            poses[source] = poses.setdefault(target, np.eye(4)) @ pair.T_target_source
        else:
            poses[target] = poses[source] @ invert(pair.T_target_source)
        for row, cloud in ((target, pair.target), (source, pair.source)):
            scans[row] = np.asarray(cloud.points, dtype=np.float64)
    rows = sorted(poses)
    truth = np.array([poses[row] for row in rows])
    return ScanSet([scans[row] for row in rows], truth, [folder.name] * len(rows))


def load_scan_set(names: Iterable[str], root: Path | None, seed: int, *, mirrored: bool = False) -> ScanSet:
    """Load and mix places; each is ``stone:SEED``, or a folder below the data root."""
    parts = [find_scan_set(name, root)() for name in names]
    if mirrored:
        parts += [each.mirrored() for each in parts]
    return pool_sets(parts, np.random.default_rng(seed))


def find_scan_set(name: str, root: Path | None) -> Callable[[], ScanSet]:
    """Find the scans of one place, and return their loader."""
    if name.startswith("stone:"):
        seed = name.removeprefix("stone:")
        if not seed.isdecimal():
            raise InputError("stone", repr(seed), "give its seed, a whole number, as in stone:0")
        return partial(make_views, int(seed))
    folder = data_root(root) / name
    readers = {"set.json": read_folder, "cloud_bin_*": read_fragments, "*.conf": read_stanford}
    for pattern, read in readers.items():
        if any(folder.glob(pattern)):
            return partial(read, folder)
    raise InputError(f"{folder}: no scans with poses: no set.json, no .conf file, no cloud_bin_* of 3DMatch")


def _read(path: Path) -> FloatArray:
    return np.asarray(read_cloud(path).points, dtype=np.float64)
