"""KITTI's odometry sequences: pairs of LiDAR scans some 10 m apart, the usual registration benchmark.

Geiger, Lenz and Urtasun: Are we ready for autonomous driving? The KITTI vision benchmark suite, CVPR 2012.
Choy, Park and Koltun: Fully convolutional geometric features, ICCV 2019 (the pairs).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from cgroup.datasets.base import (
    Dataset,
    MatchingPair,
    data_root,
    dataset_folder,
    first_missing,
    missing_file,
    split_by_files,
)
from cgroup.errors import InputError
from cgroup.io import read_cloud, read_transform
from cgroup.io._files import load_numbers, load_text, parse_file
from cgroup.rigid import check_rigid, invert
from cgroup.verification import FineSurface, align

if TYPE_CHECKING:
    from pathlib import Path

    from cgroup.datasets.base import Origin, Role
    from cgroup.types import FloatArray, PointCloud

URL = "https://www.cvlibs.net/datasets/kitti/eval_odometry.php"

SEQUENCES = (8, 9, 10)
"""The test sequences."""

DISTANCE = 10.0
"""A scan is paired with the last one before the scanner is farther away than this, in m."""

LEFT_OUT = frozenset({(8, 15, 58)})
"""Pairs whose pose is known to be wrong."""

_AHEAD = 100  # scans that are looked through for a partner
_FINE_SPACING = 0.3  # m, of the surfaces on which poses are refined


class _Entry(NamedTuple):
    sequence: int
    source: int
    target: int

    @property
    def name(self) -> str:
        return f"{self.sequence:02d}/{self.source}-{self.target}"


class KITTI(Dataset):
    """Pairs of KITTI's sequences 8 to 10, all 555 if they are there; unit m.

    The odometry's poses are some decimetres off. They are replaced by those in ``icp``, where FCGF has left
    its refined ones, or else refined here by `cgroup.verification.align`.

    Parameters
    ----------
    root : path-like, optional
        Data root; see `data_root`. Its folder ``kitti``, or the root itself, holds
        ``sequences/08/velodyne/*.bin``, ``sequences/08/calib.txt`` and ``poses/08.txt``; ``icp/8_0_13.npy``
        may be there.
    """

    name: ClassVar[str] = "kitti"
    title: ClassVar[str] = "KITTI odometry"
    role: ClassVar[Role] = "partial-partial"
    origin: ClassVar[Origin] = "real"
    protocols: ClassVar[tuple[str, ...]] = ("precision>0.1", "kitti", "kitti-2m")
    citation: ClassVar[str] = "Geiger et al.: KITTI, CVPR 2012; Choy et al.: FCGF, ICCV 2019 (pairs)"
    single_views: ClassVar[bool] = True

    def __init__(self, root: Path | str | None = None) -> None:
        base = data_root(root)
        inside = not (base / "kitti").is_dir() and (base / "sequences").is_dir()
        self._folder = base if inside else dataset_folder(root, "kitti", title=self.title, url=URL)
        listed = [entry for number in SEQUENCES for entry in self._list_pairs(number)]
        wanted = {entry.name: entry for entry in listed if tuple(entry) not in LEFT_OUT}
        self._entries, self._lacking = split_by_files(wanted, self._find_lacking)
        if not self._entries:
            example = next(iter(self._lacking.values()), self._scan(SEQUENCES[0], 0))
            raise missing_file(example, self.title, URL)

    def pair_names(self) -> list[str]:
        """Return ``sequence/source-target``, with the numbers of the scans."""
        return list(self._entries)

    def load(self, name: str) -> MatchingPair:
        """Read two scans, and refine their pose."""
        self.check_name(name)
        entry = self._entries[name]
        source, target = (self._read_scan(entry.sequence, number) for number in (entry.source, entry.target))
        return MatchingPair(name, source, target, self._find_pose(entry, source, target))

    def _list_pairs(self, sequence: int) -> list[_Entry]:
        """List the pairs of a sequence, which depend on the poses alone."""
        poses = self._poses(sequence)
        if not poses.is_file():
            return []
        return [_Entry(sequence, *both) for both in pair_scans(_read_poses(poses)[:, :3, 3])]

    def note(self) -> str:
        """Return a sentence about the pairs whose scans, and the sequences whose poses, aren't there."""
        absent = [self._poses(number) for number in SEQUENCES if not self._poses(number).is_file()]
        listed = ", ".join(path.name for path in absent)
        poses = f"no pairs are known of sequences without poses ({listed})" if absent else ""
        return "; ".join(filter(None, (super().note(), poses)))

    def _find_lacking(self, entry: _Entry) -> Path | None:
        scans = first_missing(*(self._scan(entry.sequence, number) for number in entry[1:]))
        if scans or self._refined(entry).is_file():
            return scans
        return first_missing(self._calibration(entry.sequence))

    def _poses(self, sequence: int) -> Path:
        return self._folder / "poses" / f"{sequence:02d}.txt"

    def _refined(self, entry: _Entry) -> Path:
        return self._folder / "icp" / f"{entry.sequence}_{entry.source}_{entry.target}.npy"

    def _calibration(self, sequence: int) -> Path:
        return self._folder / "sequences" / f"{sequence:02d}" / "calib.txt"

    def _find_pose(self, entry: _Entry, source: PointCloud, target: PointCloud) -> FloatArray:
        refined = self._refined(entry)
        if refined.is_file():
            return read_transform(refined)
        poses = _read_poses(self._poses(entry.sequence))
        camera = self._read_calibration(entry.sequence)
        rough = invert(poses[entry.target] @ camera) @ poses[entry.source] @ camera
        fixed, moved = FineSurface(target.points, _FINE_SPACING), FineSurface(source.points, _FINE_SPACING)
        return align(moved, fixed, check_rigid(rough, entry.name)).T_target_source

    def _read_calibration(self, sequence: int) -> FloatArray:
        """Read the pose of the scanner in the camera's frame."""
        path = self._calibration(sequence)
        for line in load_text(path).splitlines():
            name, _, numbers = line.partition(":")
            if name == "Tr":
                return _as_poses(np.array(numbers.split(), dtype=float)[None])[0]
        message = f"{path}: has no line that begins with Tr:"
        raise InputError(message)

    def _scan(self, sequence: int, number: int) -> Path:
        return self._folder / "sequences" / f"{sequence:02d}" / "velodyne" / f"{number:06d}.bin"

    def _read_scan(self, sequence: int, number: int) -> PointCloud:
        return read_cloud(self._scan(sequence, number))


def pair_scans(places: FloatArray) -> list[tuple[int, int]]:
    """Pair scans as 3DFeatNet and FCGF do: from each on to the last before the scanner is `DISTANCE` away.

    Parameters
    ----------
    places : (m,3) array of float64
        Where the scanner stood.

    Returns
    -------
    list of (int, int)
        Source and target; the next pair begins behind the target.
    """
    pairs: list[tuple[int, int]] = []
    source = 0
    while source < len(places):
        ahead = np.linalg.norm(places[source : source + _AHEAD] - places[source], axis=1)
        far = np.flatnonzero(ahead > DISTANCE)
        if len(far):
            target = source + int(far[0]) - 1
            pairs.append((source, target))
            source = target
        source += 1
    return pairs


def _read_poses(path: Path) -> FloatArray:
    try:
        return _as_poses(parse_file(path, load_numbers))
    except ValueError as error:
        message = f"{path}: not a list of poses, 12 numbers a line ({error})"
        raise InputError(message) from error


def _as_poses(rows: FloatArray) -> FloatArray:
    """Return (m,4,4) poses from their first three rows in a line."""
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows.reshape(-1, 3, 4)
    return poses
