"""UWA 3D Modeling: pairs of range views of four toys.

Mian, Bennamoun and Owens: A novel representation and feature matching algorithm for automatic pairwise
registration of range images, IJCV 66(1), 2006.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cgroup.datasets.base import MatchingPair, fitting_pose, measure_overlap
from cgroup.datasets.file_datasets import FileDataset
from cgroup.errors import InputError
from cgroup.io import read_cloud
from cgroup.io.files import load_text
from cgroup.rigid import check_rigid
from cgroup.types import FloatArray

LIST_FILE = "pairs.txt"
"""In each model's folder: one line per pair, file of the source, file of the target, and 16 numbers, a 4x4
transform row by row that maps source points into the target's frame."""


class _Entry(NamedTuple):
    source: Path
    target: Path
    pose: FloatArray


class U3M(FileDataset[_Entry]):
    """Pairs ``model/source-target`` of views listed with a pose; unit mm, scanner at the origin of each view.

    The owners publish the views, one folder per model, but no poses: whoever has some puts them in a
    `LIST_FILE` beside the views.
    """

    name, title = "u3m", "U3M"
    role, origin = "partial-partial", "real"
    citation = "Mian, Bennamoun, Owens: A novel representation and feature matching, IJCV 2006"
    folder, example = "u3m", f"<model>/{LIST_FILE}"
    url = "http://www.csse.uwa.edu.au/~ajmal/3Dmodeling.html (views; the poses aren't published)"

    def load(self, name: str) -> MatchingPair:
        """Read two views and compute their overlap."""
        entry = self._entry(name)
        source, target = read_cloud(entry.source), read_cloud(entry.target)
        pose = fitting_pose(entry.pose, source, target, origin=name)
        shared = measure_overlap(source, target, pose)
        return MatchingPair(name, source, target, pose, facts={"overlap": shared})

    def _list_pairs(self) -> dict[str, _Entry]:
        pairs: dict[str, _Entry] = {}
        for path in sorted(self._folder.rglob(LIST_FILE)):
            home = path.parent.relative_to(self._folder).as_posix()
            for entry in _read_list(path):
                pairs[f"{home}/{entry.source.stem}-{entry.target.stem}"] = entry
        return pairs

    def _needed(self, entry: _Entry) -> list[tuple[Path, ...]]:
        return [(entry.source,), (entry.target,)]


def _read_list(path: Path) -> Iterator[_Entry]:
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
        if len(words) != 18:
            message = f"{where}: has {len(words)} words; give two file names and 16 numbers"
            raise InputError(message)
        source, target = (path.parent / word for word in words[:2])
        yield _Entry(source, target, check_rigid(pose.reshape(4, 4), where))
