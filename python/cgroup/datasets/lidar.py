"""LiDAR scans with a pose, as registration methods publish them with their demos.

Geiger, Lenz and Urtasun: Are we ready for autonomous driving? The KITTI vision benchmark suite, CVPR 2012.
Pomerleau et al.: Challenging data sets for point cloud registration algorithms, IJRR 2012 (ETH).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from cgroup import features
from cgroup.datasets.base import (
    Dataset,
    MatchingPair,
    data_root,
    dataset_folder,
    first_missing,
    fitting_pose,
    missing_file,
    split_by_files,
)
from cgroup.evaluation import overlap
from cgroup.io import read_cloud, read_transform

if TYPE_CHECKING:
    from pathlib import Path

    from cgroup.datasets.base import Origin, Role

URL = (
    "the demo data of https://github.com/Laka-3DV/TurboReg, https://github.com/koide3/small_gicp or "
    "https://github.com/ShiPC-AI/TCF"
)

VOXELS = 5000
"""Overlap counts points within a voxel of the size that leaves the scans about so many."""


@dataclass(frozen=True)
class _Files:
    source: Path
    target: Path
    pose: Path


class LidarScans(Dataset):
    """Pairs of LiDAR scans, each in its sensor's frame; unit m.

    LiDAR scans are dense along a ring and sparse across, so that the mean distance of nearest points says
    little; the fact ``overlap`` counts points within a voxel, see `VOXELS`.

    Parameters
    ----------
    root : path-like, optional
        Data root; see `data_root`. Files in its folders ``lidar`` and ``corr``, in one of three layouts:
        ``<name>_source.ply``, ``<name>_target.ply`` and ``<name>_T_target_source.txt``;
        ``<number>_pts_src.ply``, ``<number>_pts_dst.ply`` and ``<number>_trans.txt``, as TurboReg has them;
        ``<source>-<target>.pose`` beside ``<source>_*.pcd`` and ``<target>_*.pcd``, as TCF has them.
    """

    name: ClassVar[str] = "lidar"
    title: ClassVar[str] = "LiDAR scans"
    role: ClassVar[Role] = "partial-partial"
    origin: ClassVar[Origin] = "real"
    protocols: ClassVar[tuple[str, ...]] = ("precision>0.1", "kitti", "kitti-2m")
    citation: ClassVar[str] = (
        "Geiger et al.: KITTI, CVPR 2012; Pomerleau et al.: Challenging data sets, IJRR 2012; "
        "Koide: small_gicp, JOSS 2024"
    )
    single_views: ClassVar[bool] = True

    def __init__(self, root: Path | str | None = None) -> None:
        folder = data_root(root)
        if not (folder / "corr").is_dir():
            dataset_folder(root, "lidar", title=self.title, url=URL)
        listed = {**_named(folder), **_numbered(folder), **_posed(folder)}
        self._pairs, self._lacking = split_by_files(
            listed, lambda files: first_missing(files.source, files.target)
        )
        if not self._pairs:
            example = next(iter(self._lacking.values()), folder / "lidar" / "<name>_source.ply")
            raise missing_file(example, self.title, URL)

    def pair_names(self) -> list[str]:
        """Return the path below the data root, with the name or number of the pair."""
        return list(self._pairs)

    def subject_of(self, name: str) -> str:
        """Return the name of the pair: no place is in two of them."""
        self.check_name(name)
        return name

    def load(self, name: str) -> MatchingPair:
        """Read two scans, and compute their overlap."""
        self.check_name(name)
        files = self._pairs[name]
        source, target = read_cloud(files.source), read_cloud(files.target)
        near = features.choose_voxel(source.points, target.points, voxels=VOXELS)
        given = read_transform(files.pose)
        pose = fitting_pose(given, source.points, target.points, tolerance=near, origin=name)
        shared = overlap(source.points, target.points, pose, tolerance=near)
        return MatchingPair(name, source, target, pose, facts={"overlap": shared})


def _named(root: Path) -> dict[str, _Files]:
    return _together(root, "lidar", "_T_target_source.txt", "_source.ply", "_target.ply")


def _numbered(root: Path) -> dict[str, _Files]:
    return _together(root, "corr", "_trans.txt", "_pts_src.ply", "_pts_dst.ply")


def _together(root: Path, folder: str, pose: str, source: str, target: str) -> dict[str, _Files]:
    """Find files whose names differ in the ending alone."""
    pairs: dict[str, _Files] = {}
    for path in sorted((root / folder).rglob(f"*{pose}")):
        stem = path.name.removesuffix(pose)
        files = _Files(path.with_name(stem + source), path.with_name(stem + target), path)
        if files.source.is_file() or files.target.is_file():  # else it is a pose of matches alone
            pairs[path.with_name(stem).relative_to(root).as_posix()] = files
    return pairs


def _posed(root: Path) -> dict[str, _Files]:
    pairs: dict[str, _Files] = {}
    for path in sorted((root / "corr").rglob("*-*.pose")):
        source, target = (sorted(path.parent.glob(f"{stem}_*.pcd")) for stem in path.stem.split("-", 1))
        if source or target:
            stems = path.stem.split("-", 1)
            usual = [path.with_name(f"{stem}_cloud.pcd") for stem in stems]
            files = _Files((source or usual)[0], (target or usual[1:])[0], path)
            pairs[path.with_suffix("").relative_to(root).as_posix()] = files
    return pairs
