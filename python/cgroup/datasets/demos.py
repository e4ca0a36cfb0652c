"""Matches and LiDAR scans with a pose, as registration methods publish them with their demos.

Geiger, Lenz and Urtasun: Are we ready for autonomous driving? The KITTI vision benchmark suite, CVPR 2012.
Pomerleau et al.: Challenging data sets for point cloud registration algorithms, IJRR 2012 (ETH).
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from cgroup import features
from cgroup.datasets.base import CorrespondencePair, MatchingPair, fitting_pose
from cgroup.datasets.file_datasets import FileDataset
from cgroup.evaluation import overlap
from cgroup.evaluation.ground_truth import CORRECT_WITHIN
from cgroup.io import read_cloud, read_correspondences, read_transform
from cgroup.types import Correspondences

TCF_URL = "https://github.com/ShiPC-AI/TCF"

INDOOR_INLIER = 0.1
"""Inlier distance of 3DMatch in m."""

OUTDOOR_INLIER = 0.6
"""Inlier distance of KITTI in m."""

TERRESTRIAL_INLIER = 0.3
"""Inlier distance of ETH's scans in m."""

VOXELS = 5000
"""Overlap of LiDAR scans counts points within a voxel of the size that leaves the scans about so many."""


class _Scans(NamedTuple):
    source: Path
    target: Path
    pose: Path


class _Matches(NamedTuple):
    source: Path
    target: Path | None  # None: the first file holds both, six columns
    pose: Path
    inlier_distance: float
    protocol: str


class CorrespondenceFiles(FileDataset[_Matches]):
    """Ready-made matches with a pose; unit m.

    The resolution is a fifth of the inlier distance that the matches' makers use, so that 5 pr, the usual
    threshold here, is that distance. Methods that need a ratio or frames can't be run: there are none.

    The folder ``corr`` holds folders in one of two layouts: ``corr.txt`` (six columns) with ``GTmat.txt``, as
    MAC and SuperRANSAC have them, taken to be of 3DMatch; or ``<id>_fpfh_kpts_src.txt``,
    ``<id>_fpfh_kpts_dst.txt`` and ``<id>_trans.txt``, as TurboReg has them, taken to be of KITTI. Pairs are
    named as the folders, with the number of the pair where a folder holds several.
    """

    name, title = "corr", "Correspondence files"
    role, origin = "correspondences", "real"
    protocols = ("precision>0.1", "3dmatch", "kitti", "kitti-2m")
    citation = (
        "Zhang et al.: 3D registration with maximal cliques, CVPR 2023; Barath: SupeRANSAC, arXiv 2025; "
        "Yan et al.: TurboReg, ICCV 2025; Geiger et al.: KITTI, CVPR 2012; Zeng et al.: 3DMatch, CVPR 2017"
    )
    folder, example = "corr", "<pair>/corr.txt"
    url = (
        "the demo data of https://github.com/zhangxy0517/3D-Registration-with-Maximal-Cliques, "
        "https://github.com/danini/superansac or https://github.com/Laka-3DV/TurboReg"
    )

    def protocols_of(self, name: str) -> tuple[str, ...]:
        """Return the criteria of the benchmark that the matches come from."""
        own = self._entry(name).protocol
        return tuple(known for known in self.protocols if known.startswith(("precision>0.1", own)))

    def load(self, name: str) -> CorrespondencePair:
        """Read the matches and their pose."""
        files = self._entry(name)
        if files.target is None:
            both = read_correspondences(files.source)
            source, target = both.source, both.target
        else:
            source, target = read_cloud(files.source).points, read_cloud(files.target).points
        matches = Correspondences(source, target, resolution=files.inlier_distance / CORRECT_WITHIN)
        return CorrespondencePair(name, matches, read_transform(files.pose))

    def _list_pairs(self) -> dict[str, _Matches]:
        pairs: dict[str, _Matches] = {}
        homes = sorted(path.parent for name in ("corr.txt", "GTmat.txt") for path in self._folder.rglob(name))
        for home in homes:
            files = home / "corr.txt", None, home / "GTmat.txt"
            pairs[self._name_of(home)] = _Matches(*files, INDOOR_INLIER, "3dmatch")
        ending = "_fpfh_kpts_src.txt"
        for source in sorted(self._folder.rglob(f"*{ending}")):
            stem = source.with_name(source.name.removesuffix(ending))
            files = source, _with(stem, "_fpfh_kpts_dst.txt"), _with(stem, "_trans.txt")
            pairs[self._name_of(stem)] = _Matches(*files, OUTDOOR_INLIER, "kitti")
        return pairs

    def _needed(self, entry: _Matches) -> list[tuple[Path, ...]]:
        return [(path,) for path in (entry.source, entry.target, entry.pose) if path is not None]

    def _name_of(self, path: Path) -> str:
        return path.relative_to(self._folder).as_posix()


class OneToThreeFiles(CorrespondenceFiles):
    """Ready-made matches of every source point with its three nearest, with a pose; LiDAR, unit m.

    The folder ``corr`` holds ``<source>_<target>_top3.match`` (six columns) beside
    ``<source>-<target>.pose``, as TCF has them; of KITTI where the folder's name says so, else of ETH.
    """

    name, title = "corr-three", "One-to-three correspondence files"
    citation = (
        f"Shi et al.: TCF ({TCF_URL}); Geiger et al.: KITTI, CVPR 2012; "
        "Pomerleau et al.: Challenging data sets, IJRR 2012"
    )
    example = "<pair>_top3.match"
    url = f"the demo data of {TCF_URL}"

    def _list_pairs(self) -> dict[str, _Matches]:
        pairs: dict[str, _Matches] = {}
        for pose in sorted(self._folder.rglob("*-*.pose")):
            matches = pose.with_name(f"{pose.stem.replace('-', '_', 1)}_top3.match")
            near = OUTDOOR_INLIER if "kitti" in pose.parent.name else TERRESTRIAL_INLIER
            pairs[self._name_of(pose.with_suffix(""))] = _Matches(matches, None, pose, near, "kitti")
        return pairs


class LidarScans(FileDataset[_Scans]):
    """Pairs of LiDAR scans, each in its sensor's frame; unit m.

    LiDAR scans are dense along a ring and sparse across, so that the mean distance of nearest points says
    little; the fact ``overlap`` counts points within a voxel, see `VOXELS`.

    The folders ``lidar`` and ``corr`` hold files in one of three layouts: ``<name>_source.ply``,
    ``<name>_target.ply`` and ``<name>_T_target_source.txt``; ``<number>_pts_src.ply``,
    ``<number>_pts_dst.ply`` and ``<number>_trans.txt``, as TurboReg has them; ``<source>-<target>.pose``
    beside ``<source>_*.pcd`` and ``<target>_*.pcd``, as TCF has them. Pairs are named by the path below the
    data root, with the name or number of the pair.
    """

    name, title = "lidar", "LiDAR scans"
    role, origin, single_views = "partial-partial", "real", True
    protocols = ("precision>0.1", "kitti", "kitti-2m")
    citation = (
        "Geiger et al.: KITTI, CVPR 2012; Pomerleau et al.: Challenging data sets, IJRR 2012; "
        "Koide: small_gicp, JOSS 2024"
    )
    folder, example = "lidar", "lidar/<name>_source.ply"
    url = (
        "the demo data of https://github.com/Laka-3DV/TurboReg, https://github.com/koide3/small_gicp or "
        f"{TCF_URL}"
    )

    def subject_of(self, name: str) -> str:
        """Return the name of the pair: no place is in two of them."""
        self.check_name(name)
        return name

    def load(self, name: str) -> MatchingPair:
        """Read two scans, and compute their overlap."""
        files = self._entry(name)
        source, target = read_cloud(files.source), read_cloud(files.target)
        near = features.choose_voxel(source.points, target.points, voxels=VOXELS)
        pose = fitting_pose(read_transform(files.pose), source, target, tolerance=near, origin=name)
        shared = overlap(source.points, target.points, pose, tolerance=near)
        return MatchingPair(name, source, target, pose, facts={"overlap": shared})

    def _find_folder(self, root: Path) -> Path:
        if not (root / "corr").is_dir():
            super()._find_folder(root)
        return root

    def _list_pairs(self) -> dict[str, _Scans]:
        pairs: dict[str, _Scans] = {}
        for folder, *endings in (
            ("lidar", "_source.ply", "_target.ply", "_T_target_source.txt"),
            ("corr", "_pts_src.ply", "_pts_dst.ply", "_trans.txt"),
        ):
            for path in sorted((self._folder / folder).rglob(f"*{endings[-1]}")):
                stem = path.with_name(path.name.removesuffix(endings[-1]))
                files = _Scans(*(_with(stem, ending) for ending in endings))
                if files.source.is_file() or files.target.is_file():  # else it is a pose of matches alone
                    pairs[stem.relative_to(self._folder).as_posix()] = files
        for path in sorted((self._folder / "corr").rglob("*-*.pose")):
            stems = path.stem.split("-", 1)
            found = [sorted(path.parent.glob(f"{stem}_*.pcd")) for stem in stems]
            if any(found):
                usual = [path.with_name(f"{stem}_cloud.pcd") for stem in stems]
                source, target = ((there or [other])[0] for there, other in zip(found, usual, strict=True))
                pairs[path.with_suffix("").relative_to(self._folder).as_posix()] = _Scans(
                    source, target, path
                )
        return pairs

    def _needed(self, entry: _Scans) -> list[tuple[Path, ...]]:
        return [(entry.source,), (entry.target,)]


def _with(stem: Path, ending: str) -> Path:
    return stem.with_name(stem.name + ending)
