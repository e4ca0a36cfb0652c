"""3DMatch and 3DLoMatch: pairs of fragments of indoor scans.

Zeng et al.: 3DMatch: Learning local geometric descriptors from RGB-D reconstructions, CVPR 2017.
Huang et al.: Predator: Registration of 3D point clouds with low overlap, CVPR 2021 (3DLoMatch).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from cgroup import features
from cgroup.datasets.base import (
    Dataset,
    MatchingPair,
    data_root,
    dataset_folder,
    fitting_pose,
    missing_file,
    split_by_files,
)
from cgroup.datasets.manifest import manifest_entry
from cgroup.datasets.redwood_log import read_log
from cgroup.datasets.voxels import voxel_means
from cgroup.evaluation import overlap
from cgroup.evaluation.ground_truth import OVERLAP_WITHIN
from cgroup.io import read_cloud
from cgroup.rigid import check_rigid
from cgroup.types import PointCloud

if TYPE_CHECKING:
    from pathlib import Path

    from cgroup.datasets.base import Origin, Role
    from cgroup.types import FloatArray

URL = "https://3dmatch.cs.princeton.edu; poses of 3DLoMatch: https://github.com/prs-eth/OverlapPredator"

VOXEL = 0.025
"""Edge length in m of the cells that fragments are thinned out to; the resolution is then about 16 mm."""

_THINNED = "_2.5cm"  # in the names of files that are thinned out already
_FITTING_WITHIN = 2.0  # pr


@dataclass(frozen=True, eq=False)
class _Entry:
    scene: str
    target: int
    source: int
    pose: FloatArray


class ThreeDMatch(Dataset):
    """Pairs of the 3DMatch and 3DLoMatch test sets, thinned out to `VOXEL`; unit m.

    Pairs named ``3DMatch/...`` overlap by at least 30 %, pairs named ``3DLoMatch/...`` by 10 to 30 %, as
    their owners count; the fact ``overlap`` is computed like that of the other data sets. A pair that both
    benchmarks list is listed twice.

    Parameters
    ----------
    root : path-like, optional
        Data root; see `data_root`. Its folder ``threedmatch`` holds a folder of ``cloud_bin_*`` per scene.
        Poses are read from every ``gt.log`` in it: in ``<scene>-evaluation`` as 3DMatch has them, or in
        ``3DLoMatch/<scene>`` as Predator has them; where there is none, from the root's manifest. The root
        may be that folder itself, if it holds ``fragments`` and ``gt_result``, as PointDSC has them.

    Attributes
    ----------
    benchmark : str
        Pairs of this one only; all by default.
    thinned : bool
        Whether fragments are thinned out.
    """

    name: ClassVar[str] = "3dmatch"
    title: ClassVar[str] = "3DMatch"
    role: ClassVar[Role] = "partial-partial"
    origin: ClassVar[Origin] = "real"
    protocols: ClassVar[tuple[str, ...]] = ("precision>0.1", "rmse<=1pr", "rmse<=5pr", "3dmatch")
    citation: ClassVar[str] = "Zeng et al.: 3DMatch, CVPR 2017; Huang et al.: Predator, CVPR 2021 (3DLoMatch)"

    benchmark: ClassVar[str] = ""
    thinned: ClassVar[bool] = True

    def __init__(self, root: Path | str | None = None) -> None:
        self._folder = _find_folder(root, self.title)
        entries = _from_logs(self._folder) or _from_manifest(self._folder)
        wanted = {name: each for name, each in entries.items() if name.startswith(self.benchmark)}
        self._files = _find_fragments(self._folder)
        self._entries, self._lacking = split_by_files(wanted, self._find_lacking)
        if not self._entries:
            usual = self._folder / "<scene>-evaluation" / "gt.log"
            raise missing_file(next(iter(self._lacking.values()), usual), self.title, URL)

    def pair_names(self) -> list[str]:
        """Return ``benchmark/scene/target-source``, numbered as in ``gt.log``."""
        return list(self._entries)

    def subject_of(self, name: str) -> str:
        """Return the scene."""
        self.check_name(name)
        return self._entries[name].scene

    def load(self, name: str) -> MatchingPair:
        """Read two fragments, thin them out, and compute their overlap."""
        self.check_name(name)
        entry = self._entries[name]
        source, target = (self._fragment(entry.scene, number) for number in (entry.source, entry.target))
        pr = (features.resolution(source.points) + features.resolution(target.points)) / 2
        tolerance = _FITTING_WITHIN * pr
        pose = fitting_pose(entry.pose, source.points, target.points, tolerance=tolerance, origin=name)
        shared = overlap(source.points, target.points, pose, tolerance=OVERLAP_WITHIN * pr)
        return MatchingPair(name, source, target, pose, facts={"overlap": shared})

    def _find_lacking(self, entry: _Entry) -> Path | None:
        for number in (entry.source, entry.target):
            if self._fragment_file(entry.scene, number) is None:
                return self._folder / entry.scene / _fragment_names(number)[0]
        return None

    def _fragment_file(self, scene: str, number: int) -> Path | None:
        found = (self._files.get((scene, name)) for name in _fragment_names(number))
        return next((path for path in found if path is not None), None)

    def _fragment(self, scene: str, number: int) -> PointCloud:
        path = self._fragment_file(scene, number)
        if path is None:
            raise missing_file(self._folder / scene / _fragment_names(number)[0], self.title, URL)
        cloud = read_cloud(path)
        whole = _THINNED in path.name or not self.thinned
        return cloud if whole else PointCloud(voxel_means(cloud.points, VOXEL))


class ThreeDMatchTest(ThreeDMatch):
    """The pairs of 3DMatch's test set, all 1,623 if they are there; its fragments aren't thinned out."""

    name: ClassVar[str] = "3dmatch-test"
    title: ClassVar[str] = "3DMatch test set"
    benchmark: ClassVar[str] = "3DMatch/"
    thinned: ClassVar[bool] = False


class ThreeDLoMatchTest(ThreeDMatch):
    """The pairs of 3DLoMatch, all 1,781 if they are there; its fragments aren't thinned out."""

    name: ClassVar[str] = "3dlomatch-test"
    title: ClassVar[str] = "3DLoMatch test set"
    benchmark: ClassVar[str] = "3DLoMatch/"
    thinned: ClassVar[bool] = False


def _find_folder(root: Path | str | None, title: str) -> Path:
    """Folder of the data set below the data root, or the root itself where that is laid out like one."""
    base = data_root(root)
    if not (base / "threedmatch").is_dir() and (base / "fragments").is_dir():
        return base
    return dataset_folder(root, "threedmatch", title=title, url=URL)


def _fragment_names(number: int) -> tuple[str, ...]:
    """Names that the file of a fragment may have; the first there is taken."""
    return f"cloud_bin_{number}.ply", f"cloud_bin_{number}.pcd", f"cloud_bin_{number}{_THINNED}.npy"


def _find_fragments(folder: Path) -> dict[tuple[str, str], Path]:
    """Find the files of all fragments, by scene and name."""
    found: dict[tuple[str, str], Path] = {}
    for path in sorted(folder.rglob("cloud_bin_*")):
        found.setdefault((path.parent.name, path.name), path)
    return found


def _from_logs(folder: Path) -> dict[str, _Entry]:
    entries: dict[str, _Entry] = {}
    for path in sorted(folder.rglob("gt.log")):
        scene = path.parent.name.removesuffix("-evaluation")
        benchmark = "3DLoMatch" if "3DLoMatch" in path.relative_to(folder).parts else "3DMatch"
        for (target, source), pose in read_log(path).items():
            entries[f"{benchmark}/{scene}/{target}-{source}"] = _Entry(scene, target, source, pose)
    return dict(sorted(entries.items(), key=lambda item: _order(item[0])))


def _from_manifest(folder: Path) -> dict[str, _Entry]:
    entry = manifest_entry(folder.parent, "threedmatch")
    entries: dict[str, _Entry] = {}
    for pair in entry["pairs"] if entry else []:
        name = f"{pair['benchmark']}/{pair['scene']}/{pair['tgt']}-{pair['src']}"
        pose = check_rigid(np.array(pair["T_src_to_tgt"]), name)
        entries[name] = _Entry(pair["scene"], pair["tgt"], pair["src"], pose)
    return dict(sorted(entries.items(), key=lambda item: _order(item[0])))


def _order(name: str) -> tuple[bool, str, list[int]]:
    benchmark, scene, pair = name.split("/")
    return benchmark == "3DLoMatch", scene, [int(number) for number in pair.split("-")]
