"""Synthetic range pairs of Fast Global Registration, with the FPFH features that its authors computed.

Zhou, Park and Koltun: Fast global registration, ECCV 2016.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cgroup import features
from cgroup.datasets.base import CorrespondencePair, MatchingPair, mean_resolution, measure_overlap
from cgroup.datasets.file_datasets import FileDataset
from cgroup.errors import InputError
from cgroup.io import read_cloud
from cgroup.io.files import read_content
from cgroup.io.numpy_files import read_arrays
from cgroup.io.transforms import read_log
from cgroup.types import Correspondences, FloatArray, IndexArray, PointCloud

# Of the target and the source: gt.log maps cloud 1 into the frame of cloud 0.
_CLOUDS = ("Depth_0000.ply", "Depth_0001.ply")
_FEATURES = ("features_0000.bin", "features_0001.bin")
_NEIGHBORS = "fpfh_nn.npz"


class _FGRPairs(FileDataset[Path]):
    """Pairs in folders, named as these; what is made of them is left to subclasses."""

    origin = "synthetic"
    citation = "Zhou, Park, Koltun: Fast global registration, ECCV 2016"
    folder, example = "fgr", "pairwise_noise_xyz_level_01_01_rot_05/gt.log"
    url = "https://github.com/isl-org/FastGlobalRegistration (folder dataset)"

    def _list_pairs(self) -> dict[str, Path]:
        return {path.parent.name: path.parent for path in sorted(self._folder.rglob("gt.log"))}

    def _needed(self, entry: Path) -> list[tuple[Path, ...]]:
        return [(entry / file,) for file in _CLOUDS]

    def _read(self, name: str) -> tuple[PointCloud, PointCloud, FloatArray]:
        """Read source, target and pose."""
        folder = self._entry(name)
        target, source = (read_cloud(folder / file) for file in _CLOUDS)
        pose = read_log(folder / "gt.log").get((0, 1))
        if pose is None:
            message = f"{folder / 'gt.log'}: has no pose of cloud 1 in the frame of cloud 0"
            raise InputError(message)
        return source, target, pose


class FGR(_FGRPairs):
    """Matches of FPFH features that are nearest to each other, as FGR begins with; synthetic range data.

    Every point of cloud 1 whose nearest feature in cloud 0 has it for its own nearest is a match. They have a
    ratio, but neither a similarity nor frames. The resolution is that of the clouds.

    The folder ``fgr`` holds one folder per pair with ``Depth_0000.ply``, ``Depth_0001.ply``, ``gt.log`` and
    the features: ``features_0000.bin`` and ``features_0001.bin``, or their nearest neighbours both ways,
    ``fpfh_nn.npz``.
    """

    name, title, role = "fgr", "FGR", "correspondences"
    protocols = ("precision>0.1",)

    def _needed(self, entry: Path) -> list[tuple[Path, ...]]:
        return [*super()._needed(entry), *((entry / file, entry / _NEIGHBORS) for file in _FEATURES)]

    def load(self, name: str) -> CorrespondencePair:
        """Read both clouds, and match their features."""
        source, target, pose = self._read(name)
        folder = self._entry(name)
        rows, partners, ratio = _matches(folder)
        if len(rows) and (rows.max() >= len(source) or partners.max() >= len(target)):
            message = f"{folder}: the features belong to other clouds; there are fewer points than features"
            raise InputError(message)
        matches = Correspondences(
            source.points[rows],
            target.points[partners],
            ratio=ratio,
            resolution=mean_resolution(source, target),
            source_centroid=source.points.mean(axis=0),
        )
        return CorrespondencePair(name, matches, pose)


class FGRClouds(_FGRPairs):
    """The clouds of FGR's pairs, without the features; synthetic, the viewpoints aren't known."""

    name, title, role = "fgr-clouds", "FGR's clouds", "partial-partial"

    def load(self, name: str) -> MatchingPair:
        """Read both clouds, and compute their overlap."""
        source, target, pose = self._read(name)
        shared = measure_overlap(source, target, pose)
        return MatchingPair(name, source, target, pose, facts={"overlap": shared})


def _matches(folder: Path) -> tuple[IndexArray, IndexArray, FloatArray]:
    """Rows of the source, their partners in the target, and the ratio of each match."""
    neighbors = folder / _NEIGHBORS
    if neighbors.is_file():
        return _mutual(neighbors)
    target, source = (_read_features(folder / file) for file in _FEATURES)
    found = features.match(source, target, mutual=True)
    return found.source_indices, found.target_indices, found.ratio


def _mutual(path: Path) -> tuple[IndexArray, IndexArray, FloatArray]:
    try:
        arrays = read_arrays(path, ("src1_to_0", "src0_to_1", "ratio1"))
        forward, backward = (arrays[name].astype(np.int64) for name in ("src1_to_0", "src0_to_1"))
        ratio = arrays["ratio1"].astype(np.float64)
        rows = np.flatnonzero(backward[forward] == np.arange(len(forward)))
    except (ValueError, IndexError) as error:
        message = f"{path}: not nearest neighbours of features both ways ({error})"
        raise InputError(message) from error
    return rows, forward[rows], ratio[rows]


def _read_features(path: Path) -> NDArray[np.float32]:
    """Read FGR's format: two int32 (points, dimensions); per point, x y z and its feature in float32."""
    content = read_content(path)
    whole = content[: len(content) // 4 * 4].ljust(8, b"\0")
    count, dimensions = (int(number) for number in np.frombuffer(whole[:8], dtype="<i4"))
    numbers = np.frombuffer(whole[8:], dtype="<f4")
    if min(count, dimensions) < 1 or len(numbers) != count * (3 + dimensions):
        message = f"{path}: declares {count} points of {dimensions} numbers, but has {len(numbers)} numbers"
        raise InputError(message)
    return numbers.reshape(count, 3 + dimensions)[:, 3:].astype(np.float32)
