"""KITTI's odometry sequences: pairs of LiDAR scans some 10 m apart, the usual registration benchmark."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from cgroup.datasets.base import MatchingPair
from cgroup.datasets.file_datasets import FileDataset
from cgroup.errors import InputError
from cgroup.io import read_cloud, read_transform
from cgroup.io.files import load_numbers, load_text, parse_file
from cgroup.rigid import check_rigid, invert
from cgroup.types import FloatArray, PointCloud
from cgroup.verification import FineSurface, align

SEQUENCES = (8, 9, 10)  # the test sequences
DISTANCE = 10.0  # A scan is paired with the last one before the scanner is farther away than this, in m
LEFT_OUT = frozenset({(8, 15, 58)})  # pairs whose pose is known to be wrong
_AHEAD = 100  # scans that are looked through for a partner
_FINE_SPACING = 0.3  # m, of the surfaces on which poses are refined


class _Entry(NamedTuple):
    sequence: int
    source: int
    target: int


class KITTI(FileDataset[_Entry]):
    """Pairs ``sequence/source-target`` of KITTI's sequences 8 to 10, all 555 if available; unit m.

    The odometry's poses are some decimetres off. They are replaced by those in ``icp``, where FCGF has left
    its refined ones, or else refined here by `cgroup.verification.align`.
    """

    name, title = "kitti", "KITTI odometry"
    role, origin, single_views = "partial-partial", "real", True
    protocols = ("precision>0.1", "kitti", "kitti-2m")
    citation = "Geiger et al.: KITTI, CVPR 2012; Choy et al.: FCGF, ICCV 2019 (pairs)"
    folder, inside, example = "kitti", "sequences", "sequences/08/velodyne/000000.bin"
    url = "https://www.cvlibs.net/datasets/kitti/eval_odometry.php"

    def load(self, name: str) -> MatchingPair:
        """Read two scans, and refine their pose."""
        entry = self._entry(name)
        source, target = map(read_cloud, self._scans(entry))
        return MatchingPair(name, source, target, self._find_pose(name, entry, source, target))

    def note(self) -> str:
        """Return a sentence about pairs with missing scans, and sequences with missing poses."""
        files = [self._poses(sequence) for sequence in SEQUENCES]
        absent = ", ".join(path.name for path in files if not path.is_file())
        poses = f"no pairs are known of sequences without poses ({absent})" if absent else ""
        return "; ".join(filter(None, (super().note(), poses)))

    def _list_pairs(self) -> dict[str, _Entry]:
        """List the pairs, which depend on the poses only."""
        pairs: dict[str, _Entry] = {}
        for sequence in filter(lambda number: self._poses(number).is_file(), SEQUENCES):
            for source, target in pair_scans(_read_poses(self._poses(sequence))[:, :3, 3]):
                if (sequence, source, target) not in LEFT_OUT:
                    pairs[f"{sequence:02d}/{source}-{target}"] = _Entry(sequence, source, target)
        return pairs

    def _needed(self, entry: _Entry) -> list[tuple[Path, ...]]:
        either = self._calibration(entry), self._refined(entry)
        return [*((scan,) for scan in self._scans(entry)), either]

    def _poses(self, sequence: int) -> Path:
        return self._folder / "poses" / f"{sequence:02d}.txt"

    def _refined(self, entry: _Entry) -> Path:
        return self._folder / "icp" / f"{entry.sequence}_{entry.source}_{entry.target}.npy"

    def _calibration(self, entry: _Entry) -> Path:
        return self._folder / f"sequences/{entry.sequence:02d}/calib.txt"

    def _scans(self, entry: _Entry) -> list[Path]:
        home = self._folder / f"sequences/{entry.sequence:02d}/velodyne"
        return [home / f"{number:06d}.bin" for number in (entry.source, entry.target)]

    def _find_pose(self, name: str, entry: _Entry, source: PointCloud, target: PointCloud) -> FloatArray:
        refined = self._refined(entry)
        if refined.is_file():
            return read_transform(refined)
        poses = _read_poses(self._poses(entry.sequence))
        camera = _read_calibration(self._calibration(entry))
        rough = invert(poses[entry.target] @ camera) @ poses[entry.source] @ camera
        fixed, moved = FineSurface(target.points, _FINE_SPACING), FineSurface(source.points, _FINE_SPACING)
        return align(moved, fixed, check_rigid(rough, name)).T_target_source


def pair_scans(places: FloatArray) -> list[tuple[int, int]]:
    """Pair each source with the last scan before the distance exceeds `DISTANCE`, as 3DFeatNet and FCGF."""
    # `places` (m,3) are the positions of the scanner; the next pair begins after the target.
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
        raise InputError(f"{path}: not a list of poses, 12 numbers a line ({error})") from error


def _read_calibration(path: Path) -> FloatArray:
    """Read the pose of the scanner in the camera's frame."""
    for line in load_text(path).splitlines():
        name, _, numbers = line.partition(":")
        if name == "Tr":
            return _as_poses(np.array(numbers.split(), dtype=float)[None])[0]
    raise InputError(f"{path}: has no line that begins with Tr:")


def _as_poses(rows: FloatArray) -> FloatArray:
    """Return (m,4,4) poses from lines with their first three rows."""
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows.reshape(-1, 3, 4)
    return poses
