"""3DMatch and 3DLoMatch: pairs of fragments of indoor scans."""

from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

from cgroup.datasets.base import MatchingPair, fitting_pose, view_pair, voxel_means
from cgroup.datasets.file_datasets import FileDataset, manifest_pairs
from cgroup.io import read_cloud
from cgroup.io.transforms import read_log
from cgroup.rigid import check_rigid
from cgroup.types import FloatArray, PointCloud

# Edge length in m of the cells that fragments are downsampled to; the resolution is then about 16 mm.
VOXEL = 0.025
_DOWNSAMPLED = "_2.5cm"  # in the names of files that are downsampled already


class _Entry(NamedTuple):
    scene: str
    target: int
    source: int
    pose: FloatArray


class ThreeDMatch(FileDataset[_Entry]):
    """Pairs of the 3DMatch and 3DLoMatch test sets, downsampled to `VOXEL`; unit m.

    Pairs named ``3DMatch/scene/target-source`` overlap by at least 30 %, pairs named ``3DLoMatch/...`` by 10
    to 30 %, as their owners count; the fact ``overlap`` is measured. Pairs of both are listed twice.
    """

    name, title = "3dmatch", "3DMatch"
    role, origin = "partial-partial", "real"
    protocols = ("precision>0.1", "rmse<=1pr", "rmse<=5pr", "3dmatch")
    citation = "Zeng et al.: 3DMatch, CVPR 2017; Huang et al.: Predator, CVPR 2021 (3DLoMatch)"
    folder, inside, example = "threedmatch", "fragments", "<scene>-evaluation/gt.log"
    url = "https://3dmatch.cs.princeton.edu; poses of 3DLoMatch: https://github.com/prs-eth/OverlapPredator"

    benchmark: ClassVar[str] = ""  # pairs of this one only; all by default
    downsampled: ClassVar[bool] = True

    def subject_of(self, name: str) -> str:
        """Return the scene."""
        return self._entry(name).scene

    def load(self, name: str) -> MatchingPair:
        """Read two fragments, downsample them, and compute their overlap."""
        entry = self._entry(name)
        source, target = (self._read_fragment(entry.scene, each) for each in (entry.source, entry.target))
        pose = fitting_pose(entry.pose, source, target, origin=name)
        return view_pair(name, source, target, pose)

    def _list_pairs(self) -> dict[str, _Entry]:
        self._files: dict[tuple[str, str], Path] = {}
        for path in sorted(self._folder.rglob("cloud_bin_*")):
            self._files.setdefault((path.parent.name, path.name), path)
        entries = self._from_logs() or self._from_manifest()
        names = sorted((name for name in entries if name.startswith(self.benchmark)), key=_order)
        return {name: entries[name] for name in names}

    def _needed(self, entry: _Entry) -> list[tuple[Path, ...]]:
        return [self._places(entry.scene, number) for number in (entry.source, entry.target)]

    def _places(self, scene: str, number: int) -> tuple[Path, ...]:
        names = [f"cloud_bin_{number}{ending}" for ending in (".ply", ".pcd", f"{_DOWNSAMPLED}.npy")]
        found = tuple(self._files[scene, name] for name in names if (scene, name) in self._files)
        return found or (self._folder / scene / names[0],)

    def _read_fragment(self, scene: str, number: int) -> PointCloud:
        path = self._places(scene, number)[0]
        cloud = read_cloud(path)
        whole = _DOWNSAMPLED in path.name or not self.downsampled
        return cloud if whole else PointCloud(voxel_means(cloud.points, VOXEL))

    def _from_logs(self) -> dict[str, _Entry]:
        entries: dict[str, _Entry] = {}
        for path in sorted(self._folder.rglob("gt.log")):
            scene = path.parent.name.removesuffix("-evaluation")
            benchmark = "3DLoMatch" if "3DLoMatch" in path.relative_to(self._folder).parts else "3DMatch"
            for (target, source), pose in read_log(path).items():
                entries[f"{benchmark}/{scene}/{target}-{source}"] = _Entry(scene, target, source, pose)
        return entries

    def _from_manifest(self) -> dict[str, _Entry]:
        entries: dict[str, _Entry] = {}
        for pair in manifest_pairs(self._folder.parent, self.folder):
            name = f"{pair['benchmark']}/{pair['scene']}/{pair['tgt']}-{pair['src']}"
            pose = check_rigid(np.array(pair["T_src_to_tgt"]), name)
            entries[name] = _Entry(pair["scene"], pair["tgt"], pair["src"], pose)
        return entries


class ThreeDMatchTest(ThreeDMatch):
    """The pairs of 3DMatch's test set, all 1,623 if available; fragments are not downsampled."""

    name, title = "3dmatch-test", "3DMatch test set"
    benchmark, downsampled = "3DMatch/", False


class ThreeDLoMatchTest(ThreeDMatch):
    """The pairs of 3DLoMatch, all 1,781 if available; fragments are not downsampled."""

    name, title = "3dlomatch-test", "3DLoMatch test set"
    benchmark, downsampled = "3DLoMatch/", False


def _order(name: str) -> tuple[bool, str, list[int]]:
    benchmark, scene, pair = name.split("/")
    return benchmark == "3DLoMatch", scene, [int(number) for number in pair.split("-")]
