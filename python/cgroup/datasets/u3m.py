"""UWA 3D Modeling: pairs of range views of four toys.

Mian, Bennamoun and Owens: A novel representation and feature matching algorithm for automatic pairwise
registration of range images, IJCV 66(1), 2006.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from cgroup import features
from cgroup.datasets.base import (
    Dataset,
    MatchingPair,
    dataset_folder,
    first_missing,
    fitting_pose,
    missing_file,
    split_by_files,
)
from cgroup.errors import InputError
from cgroup.evaluation import overlap
from cgroup.evaluation.ground_truth import OVERLAP_WITHIN
from cgroup.io import read_cloud
from cgroup.io._files import load_text
from cgroup.rigid import check_rigid

if TYPE_CHECKING:
    from pathlib import Path

    from cgroup.datasets.base import Origin, Role
    from cgroup.types import FloatArray

URL = "http://www.csse.uwa.edu.au/~ajmal/3Dmodeling.html (views; the poses aren't published)"

LIST_FILE = "pairs.txt"
"""In each model's folder: one line per pair, file of the source, file of the target, and 16 numbers, a 4x4
transform row by row that maps source points into the target's frame."""

_WORDS = 18  # of a line
_FITTING_WITHIN = 2.0  # pr


@dataclass(frozen=True, eq=False)
class _Entry:
    source: Path
    target: Path
    pose: FloatArray


class U3M(Dataset):
    """Pairs of views listed with a pose; unit mm, scanner at the origin of each view.

    The owners publish the views, one folder per model, but no poses: whoever has made or been given some puts
    them in a `LIST_FILE` beside the views.

    Parameters
    ----------
    root : path-like, optional
        Data root; see `data_root`. Its folder ``u3m`` holds one folder per model with its views.
    """

    name: ClassVar[str] = "u3m"
    title: ClassVar[str] = "U3M"
    role: ClassVar[Role] = "partial-partial"
    origin: ClassVar[Origin] = "real"
    protocols: ClassVar[tuple[str, ...]] = ("precision>0.1", "rmse<=1pr", "rmse<=5pr")
    citation: ClassVar[str] = "Mian, Bennamoun, Owens: A novel representation and feature matching, IJCV 2006"

    def __init__(self, root: Path | str | None = None) -> None:
        self._folder = dataset_folder(root, "u3m", title=self.title, url=URL)
        listed: dict[str, _Entry] = {}
        for path in sorted(self._folder.rglob(LIST_FILE)):
            home = path.parent.relative_to(self._folder).as_posix()
            for entry in _read_list(path):
                listed[f"{home}/{entry.source.stem}-{entry.target.stem}"] = entry
        self._entries, self._lacking = split_by_files(
            listed, lambda entry: first_missing(entry.source, entry.target)
        )
        if not self._entries:
            example = next(iter(self._lacking.values()), self._folder / "<model>" / LIST_FILE)
            raise missing_file(example, self.title, URL)

    def pair_names(self) -> list[str]:
        """Return ``model/source-target`` of all listed pairs whose views are there."""
        return list(self._entries)

    def load(self, name: str) -> MatchingPair:
        """Read two views and compute their overlap."""
        self.check_name(name)
        entry = self._entries[name]
        source, target = read_cloud(entry.source), read_cloud(entry.target)
        pr = (features.resolution(source.points) + features.resolution(target.points)) / 2
        tolerance = _FITTING_WITHIN * pr
        pose = fitting_pose(entry.pose, source.points, target.points, tolerance=tolerance, origin=name)
        shared = overlap(source.points, target.points, pose, tolerance=OVERLAP_WITHIN * pr)
        return MatchingPair(name, source, target, pose, facts={"overlap": shared})


def _read_list(path: Path) -> list[_Entry]:
    entries: list[_Entry] = []
    for number, line in enumerate(load_text(path).splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        where = f"{path}, line {number}"
        try:
            pose = np.array([float(word) for word in words[2:]])
        except ValueError as error:
            message = f"{where}: {error}; give two file names and 16 numbers"
            raise InputError(message) from error
        if len(words) != _WORDS:
            message = f"{where}: has {len(words)} words; give two file names and 16 numbers"
            raise InputError(message)
        source, target = (path.parent / word for word in words[:2])
        entries.append(_Entry(source, target, check_rigid(pose.reshape(4, 4), where)))
    return entries
