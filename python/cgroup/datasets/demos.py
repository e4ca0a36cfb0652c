"""Matches, LiDAR scans and range views with a pose, published with the code of registration methods."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cgroup import features
from cgroup.datasets.base import CorrespondencePair, MatchingPair, fitting_pose, mean_resolution, view_pair
from cgroup.datasets.file_datasets import FileDataset
from cgroup.errors import InputError
from cgroup.evaluation import overlap
from cgroup.evaluation.ground_truth import CORRECT_WITHIN
from cgroup.io import read_cloud, read_correspondences, read_transform
from cgroup.io.files import read_content
from cgroup.io.numpy_files import read_arrays
from cgroup.io.transforms import read_log
from cgroup.types import Correspondences, FloatArray, IndexArray, PointCloud

TCF_URL = "https://github.com/ShiPC-AI/TCF"
_TURBOREG_URL = "https://github.com/Laka-3DV/TurboReg"
_MAC_URL = "https://github.com/zhangxy0517/3D-Registration-with-Maximal-Cliques"

_INLIER = {"3DMatch": 0.1, "KITTI": 0.6, "ETH": 0.3}  # m, inlier distances that are usual on these data

# Overlap of LiDAR scans counts points within the voxel that leaves about this number of points.
_VOXELS = 5000

# Of the target and the source: gt.log maps cloud 1 into the frame of cloud 0.
_CLOUDS = ("Depth_0000.ply", "Depth_0001.ply")
_FEATURES = ("features_0000.bin", "features_0001.bin")
_NEIGHBORS = "fpfh_nn.npz"


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

    Files of MAC and SuperRANSAC are taken to be of 3DMatch, those of TurboReg to be of KITTI.
    """

    name, title = "corr", "Correspondence files"
    role, origin = "correspondences", "real"
    protocols = ("precision>0.1", "3dmatch", "kitti", "kitti-2m")
    citation = (
        "Zhang et al.: 3D registration with maximal cliques, CVPR 2023; Barath: SupeRANSAC, arXiv 2025; "
        "Yan et al.: TurboReg, ICCV 2025; Geiger et al.: KITTI, CVPR 2012; Zeng et al.: 3DMatch, CVPR 2017"
    )
    folder, example = "corr", "<pair>/corr.txt"
    url = f"the demo data of {_MAC_URL}, https://github.com/danini/superansac or {_TURBOREG_URL}"

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
            pairs[self._name_of(home)] = _Matches(*files, _INLIER["3DMatch"], "3dmatch")
        ending = "_fpfh_kpts_src.txt"
        for source in sorted(self._folder.rglob(f"*{ending}")):
            stem = source.with_name(source.name.removesuffix(ending))
            files = source, _with(stem, "_fpfh_kpts_dst.txt"), _with(stem, "_trans.txt")
            pairs[self._name_of(stem)] = _Matches(*files, _INLIER["KITTI"], "kitti")
        return pairs

    def _name_of(self, path: Path) -> str:
        return path.relative_to(self._folder).as_posix()


class OneToThreeFiles(CorrespondenceFiles):
    """Ready-made matches of every source point with its three nearest, with a pose; LiDAR, unit m.

    Files of TCF: of KITTI if the folder's name contains that, else of ETH.
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
            near = _INLIER["KITTI"] if "kitti" in pose.parent.name else _INLIER["ETH"]
            pairs[self._name_of(pose.with_suffix(""))] = _Matches(matches, None, pose, near, "kitti")
        return pairs


class LidarScans(FileDataset[_Scans]):
    """Pairs of LiDAR scans, each in its sensor's frame; unit m.

    LiDAR scans are dense along a ring and sparse across, so that the mean distance of nearest points says
    little; the fact ``overlap`` counts points within a voxel, see `_VOXELS`.
    """

    name, title = "lidar", "LiDAR scans"
    role, origin, single_views = "partial-partial", "real", True
    own_subjects = True  # no place is in two pairs
    protocols = ("precision>0.1", "kitti", "kitti-2m")
    citation = (
        "Geiger et al.: KITTI, CVPR 2012; Pomerleau et al.: Challenging data sets, IJRR 2012; "
        "Koide: small_gicp, JOSS 2024"
    )
    folder, example = "lidar", "lidar/<name>_source.ply"
    url = f"the demo data of {_TURBOREG_URL}, https://github.com/koide3/small_gicp or {TCF_URL}"

    def load(self, name: str) -> MatchingPair:
        """Read two scans, and compute their overlap."""
        files = self._entry(name)
        source, target = read_cloud(files.source), read_cloud(files.target)
        near = features.choose_voxel(source.points, target.points, voxels=_VOXELS)
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
                name = path.with_suffix("").relative_to(self._folder).as_posix()
                pairs[name] = _Scans(source, target, path)
        return pairs


class _FGRPairs(FileDataset[Path]):
    """Pairs named after their folders; subclasses define their content."""

    origin = "synthetic"
    citation = "Zhou, Park, Koltun: Fast global registration, ECCV 2016"
    folder, example = "fgr", "pairwise_noise_xyz_level_01_01_rot_05/gt.log"
    url = "https://github.com/isl-org/FastGlobalRegistration (folder dataset)"

    def _list_pairs(self) -> dict[str, Path]:
        return {path.parent.name: path.parent for path in sorted(self._folder.rglob("gt.log"))}

    def _needed(self, entry: Path) -> list[tuple[Path, ...]]:
        return [(entry / file,) for file in _CLOUDS]

    def _read(self, name: str) -> tuple[PointCloud, PointCloud, FloatArray]:
        folder = self._entry(name)
        target, source = (read_cloud(folder / file) for file in _CLOUDS)
        pose = read_log(folder / "gt.log").get((0, 1))
        if pose is None:
            raise InputError(f"{folder / 'gt.log'}: has no pose of cloud 1 in the frame of cloud 0")
        return source, target, pose


class FGR(_FGRPairs):
    """Matches of mutual nearest FPFH features, FGR's initial matches; synthetic range data.

    They have a ratio, but neither a similarity nor frames.
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
        unit, center = mean_resolution(source, target), source.points.mean(axis=0)
        points = source.points[rows], target.points[partners]
        matches = Correspondences(*points, ratio=ratio, resolution=unit, source_centroid=center)
        return CorrespondencePair(name, matches, pose)


class FGRClouds(_FGRPairs):
    """The clouds of FGR's pairs, without the features; synthetic, the viewpoints aren't known."""

    name, title, role = "fgr-clouds", "FGR's clouds", "partial-partial"

    def load(self, name: str) -> MatchingPair:
        """Read both clouds, and compute their overlap."""
        source, target, pose = self._read(name)
        return view_pair(name, source, target, pose)


def _matches(folder: Path) -> tuple[IndexArray, IndexArray, FloatArray]:
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
        raise InputError(f"{path}: not nearest neighbours of features both ways ({error})") from error
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


def _with(stem: Path, ending: str) -> Path:
    return stem.with_name(stem.name + ending)
