"""Matches in files, as registration methods publish them with their demos."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from cgroup.datasets.base import (
    CorrespondencePair,
    Dataset,
    dataset_folder,
    first_missing,
    missing_file,
    split_by_files,
)
from cgroup.evaluation.ground_truth import CORRECT_WITHIN
from cgroup.io import read_cloud, read_correspondences, read_transform
from cgroup.types import Correspondences

if TYPE_CHECKING:
    from pathlib import Path

    from cgroup.datasets.base import Origin, Role

TCF_URL = "the demo data of https://github.com/ShiPC-AI/TCF"

URL = (
    "the demo data of https://github.com/zhangxy0517/3D-Registration-with-Maximal-Cliques, "
    "https://github.com/danini/superansac or https://github.com/Laka-3DV/TurboReg"
)

INDOOR_INLIER = 0.1
"""Inlier distance of 3DMatch in m."""

OUTDOOR_INLIER = 0.6
"""Inlier distance of KITTI in m."""

TERRESTRIAL_INLIER = 0.3
"""Inlier distance of ETH's scans in m."""


@dataclass(frozen=True)
class _Files:
    source: Path
    target: Path | None  # None: the first file holds both, six columns
    pose: Path
    inlier_distance: float
    protocol: str


class CorrespondenceFiles(Dataset):
    """Ready-made matches with a pose; unit m.

    The resolution is set to a fifth of the inlier distance that the matches' makers use, so that 5 pr, the
    usual threshold here, is that distance. There are only positions, so methods that need a ratio or frames
    can't be run.

    Parameters
    ----------
    root : path-like, optional
        Data root; see `data_root`. Its folder ``corr`` holds folders in one of two layouts: ``corr.txt`` (six
        columns) with ``GTmat.txt``, as MAC and SuperRANSAC have them, taken to be of 3DMatch; or
        ``<id>_fpfh_kpts_src.txt``, ``<id>_fpfh_kpts_dst.txt`` and ``<id>_trans.txt``, as TurboReg has them,
        taken to be of KITTI.
    """

    name: ClassVar[str] = "corr"
    title: ClassVar[str] = "Correspondence files"
    role: ClassVar[Role] = "correspondences"
    origin: ClassVar[Origin] = "real"
    protocols: ClassVar[tuple[str, ...]] = ("precision>0.1", "3dmatch", "kitti", "kitti-2m")
    citation: ClassVar[str] = (
        "Zhang et al.: 3D registration with maximal cliques, CVPR 2023; Barath: SupeRANSAC, arXiv 2025; "
        "Yan et al.: TurboReg, ICCV 2025; Geiger et al.: KITTI, CVPR 2012; Zeng et al.: 3DMatch, CVPR 2017"
    )

    def __init__(self, root: Path | str | None = None) -> None:
        self._folder = dataset_folder(root, "corr", title=self.title, url=URL)
        self._pairs, self._lacking = split_by_files(
            self._find(), lambda files: first_missing(*filter(None, (files.source, files.target, files.pose)))
        )
        if not self._pairs:
            raise missing_file(next(iter(self._lacking.values()), self._usual_file()), self.title, self._url)

    _url: ClassVar[str] = URL

    def _usual_file(self) -> Path:
        return self._folder / "<pair>" / "corr.txt"

    def _find(self) -> dict[str, _Files]:
        return {**_six_columns(self._folder), **_two_files(self._folder)}

    def pair_names(self) -> list[str]:
        """Return the names of the folders, with the number of the pair where a folder holds several."""
        return list(self._pairs)

    def protocols_of(self, name: str) -> tuple[str, ...]:
        """Return the criteria of the benchmark that the matches come from."""
        self.check_name(name)
        protocol = self._pairs[name].protocol
        return tuple(
            known for known in self.protocols if known == "precision>0.1" or known.startswith(protocol)
        )

    def load(self, name: str) -> CorrespondencePair:
        """Read the matches and their pose."""
        self.check_name(name)
        files = self._pairs[name]
        if files.target is None:
            both = read_correspondences(files.source)
            source, target = both.source, both.target
        else:
            source, target = read_cloud(files.source).points, read_cloud(files.target).points
        matches = Correspondences(source, target, resolution=files.inlier_distance / CORRECT_WITHIN)
        return CorrespondencePair(name, matches, read_transform(files.pose))


class OneToThreeFiles(CorrespondenceFiles):
    """Ready-made matches of every source point with its three nearest, with a pose; LiDAR, unit m.

    Parameters
    ----------
    root : path-like, optional
        Data root; see `data_root`. Its folder ``corr`` holds ``<source>_<target>_top3.match`` (six columns)
        beside ``<source>-<target>.pose``, as TCF has them; of KITTI where the folder's name says so, else of
        ETH.
    """

    name: ClassVar[str] = "corr-three"
    title: ClassVar[str] = "One-to-three correspondence files"
    citation: ClassVar[str] = (
        "Shi et al.: TCF (https://github.com/ShiPC-AI/TCF); Geiger et al.: KITTI, CVPR 2012; "
        "Pomerleau et al.: Challenging data sets, IJRR 2012"
    )

    _url: ClassVar[str] = TCF_URL

    def _usual_file(self) -> Path:
        return self._folder / "<pair>_top3.match"

    def _find(self) -> dict[str, _Files]:
        return _three_nearest(self._folder)


def _three_nearest(folder: Path) -> dict[str, _Files]:
    pairs: dict[str, _Files] = {}
    for pose in sorted(folder.rglob("*-*.pose")):
        matches = pose.with_name(f"{pose.stem.replace('-', '_', 1)}_top3.match")
        within = OUTDOOR_INLIER if "kitti" in pose.parent.name else TERRESTRIAL_INLIER
        name = pose.with_suffix("").relative_to(folder).as_posix()
        pairs[name] = _Files(matches, None, pose, within, "kitti")
    return pairs


def _six_columns(folder: Path) -> dict[str, _Files]:
    listed = sorted(path.parent for name in ("corr.txt", "GTmat.txt") for path in folder.rglob(name))
    return {
        home.relative_to(folder).as_posix(): _Files(
            home / "corr.txt", None, home / "GTmat.txt", INDOOR_INLIER, "3dmatch"
        )
        for home in dict.fromkeys(listed)
    }


def _two_files(folder: Path) -> dict[str, _Files]:
    ending = "_fpfh_kpts_src.txt"
    pairs: dict[str, _Files] = {}
    for source in sorted(folder.rglob(f"*{ending}")):
        number = source.name.removesuffix(ending)
        target, pose = (source.with_name(f"{number}{rest}") for rest in ("_fpfh_kpts_dst.txt", "_trans.txt"))
        name = f"{source.parent.relative_to(folder).as_posix()}/{number}"
        pairs[name] = _Files(source, target, pose, OUTDOOR_INLIER, "kitti")
    return pairs
