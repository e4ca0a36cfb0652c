"""Synthetic range pairs of Fast Global Registration, with the FPFH features that its authors computed.

Zhou, Park and Koltun: Fast global registration, ECCV 2016.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from cgroup import features
from cgroup.datasets.base import (
    CorrespondencePair,
    Dataset,
    MatchingPair,
    dataset_folder,
    first_missing,
    measure_overlap,
    missing_file,
    split_by_files,
)
from cgroup.datasets.redwood_log import read_log
from cgroup.errors import InputError
from cgroup.io import read_cloud
from cgroup.io._files import read_content
from cgroup.io._numpy_files import read_arrays
from cgroup.types import Correspondences

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from cgroup.datasets.base import Origin, Role
    from cgroup.types import FloatArray, IndexArray, PointCloud

URL = "https://github.com/isl-org/FastGlobalRegistration (folder dataset)"

_NEIGHBORS = "fpfh_nn.npz"
_SOURCE, _TARGET = 1, 0  # gt.log maps cloud 1 into the frame of cloud 0


class _FGRPairs(Dataset):
    """Pairs in folders; what is made of them is left to subclasses."""

    origin: ClassVar[Origin] = "synthetic"
    citation: ClassVar[str] = "Zhou, Park, Koltun: Fast global registration, ECCV 2016"

    def __init__(self, root: Path | str | None = None) -> None:
        self._folder = dataset_folder(root, "fgr", title=self.title, url=URL)
        listed = {path.parent.name: path.parent for path in sorted(self._folder.rglob("gt.log"))}
        self._pairs, self._lacking = split_by_files(listed, self._find_lacking)
        if not self._pairs:
            usual = self._folder / "pairwise_noise_xyz_level_01_01_rot_05" / "gt.log"
            raise missing_file(next(iter(self._lacking.values()), usual), self.title, URL)

    def _find_lacking(self, folder: Path) -> Path | None:
        return first_missing(*(_cloud_file(folder, number) for number in (_TARGET, _SOURCE)))

    def pair_names(self) -> list[str]:
        """Return the names of the pairs' folders."""
        return list(self._pairs)

    def _read(self, name: str) -> tuple[PointCloud, PointCloud, FloatArray]:
        """Read source, target and pose."""
        self.check_name(name)
        folder = self._pairs[name]
        target, source = (read_cloud(_cloud_file(folder, number)) for number in (_TARGET, _SOURCE))
        pose = read_log(folder / "gt.log").get((_TARGET, _SOURCE))
        if pose is None:
            message = f"{folder / 'gt.log'}: has no pose of cloud 1 in the frame of cloud 0"
            raise InputError(message)
        return source, target, pose


class FGR(_FGRPairs):
    """Matches of FPFH features that are nearest to each other, as FGR begins with; synthetic range data.

    Every point of cloud 1 whose nearest feature in cloud 0 has it for its own nearest is a match. They have a
    ratio, but neither a similarity nor frames. The resolution is that of the clouds.

    Parameters
    ----------
    root : path-like, optional
        Data root; see `data_root`. Its folder ``fgr`` holds one folder per pair with ``Depth_0000.ply``,
        ``Depth_0001.ply``, ``gt.log`` and the features: ``features_0000.bin`` and ``features_0001.bin``, or
        their nearest neighbours both ways, ``fpfh_nn.npz``.
    """

    name: ClassVar[str] = "fgr"
    title: ClassVar[str] = "FGR"
    role: ClassVar[Role] = "correspondences"
    protocols: ClassVar[tuple[str, ...]] = ("precision>0.1",)

    def _find_lacking(self, folder: Path) -> Path | None:
        cloud = super()._find_lacking(folder)
        if cloud or (folder / _NEIGHBORS).is_file():
            return cloud
        return first_missing(*(_feature_file(folder, number) for number in (_TARGET, _SOURCE)))

    def load(self, name: str) -> CorrespondencePair:
        """Read both clouds, and match their features."""
        clouds = self._read(name)
        source, target, pose = clouds[0].points, clouds[1].points, clouds[2]
        folder = self._pairs[name]
        rows, partners, ratio = _matches(folder)
        if len(rows) and (rows.max() >= len(source) or partners.max() >= len(target)):
            message = f"{folder}: the features belong to other clouds; there are fewer points than features"
            raise InputError(message)
        correspondences = Correspondences(
            source[rows],
            target[partners],
            ratio=ratio,
            resolution=(features.resolution(source) + features.resolution(target)) / 2,
            source_centroid=source.mean(axis=0),
        )
        return CorrespondencePair(name, correspondences, pose)


class FGRClouds(_FGRPairs):
    """The clouds of FGR's pairs; synthetic, the viewpoints aren't known.

    Parameters
    ----------
    root : path-like, optional
        Data root; see `data_root`. Its folder ``fgr`` is that of `FGR`; the features aren't needed.
    """

    name: ClassVar[str] = "fgr-clouds"
    title: ClassVar[str] = "FGR's clouds"
    role: ClassVar[Role] = "partial-partial"
    protocols: ClassVar[tuple[str, ...]] = ("precision>0.1", "rmse<=1pr", "rmse<=5pr")

    def load(self, name: str) -> MatchingPair:
        """Read both clouds, and compute their overlap."""
        source, target, pose = self._read(name)
        shared = measure_overlap(source, target, pose)
        return MatchingPair(name, source, target, pose, facts={"overlap": shared})


def _cloud_file(folder: Path, number: int) -> Path:
    return folder / f"Depth_{number:04d}.ply"


def _feature_file(folder: Path, number: int) -> Path:
    return folder / f"features_{number:04d}.bin"


def _matches(folder: Path) -> tuple[IndexArray, IndexArray, FloatArray]:
    """Rows of the source, their partners in the target, and the ratio of each match."""
    neighbors = folder / _NEIGHBORS
    if neighbors.is_file():
        return _mutual(neighbors)
    target, source = (_read_features(_feature_file(folder, number)) for number in (_TARGET, _SOURCE))
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
        message = f"{path}: says {count} points of {dimensions} numbers, but holds {len(numbers)} numbers"
        raise InputError(message)
    return numbers.reshape(count, 3 + dimensions)[:, 3:].astype(np.float32)
