"""Poses of a run as scripts of others read them, and `cgroup evaluate`: ``SET/METHOD/SCENE/est.log``.

The true ones are beside them, ``SET/truth/SCENE/gt.log``; they map cloud j of a line ``i j`` into i.
"""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark import tables
from cgroup.io import write_file
from cgroup.io._logs import format_log
from cgroup.io._results import make_folder

if TYPE_CHECKING:
    from pathlib import Path

    from cgroup.types import FloatArray

POSES, TRUTH = "poses", "truth"
"""Folder of a run for them, and that of the true ones in a set's."""

_SOURCE_FIRST = {"3dmatch-test": False, "3dlomatch-test": False, "kitti": True}
"""Data sets whose pairs are named by a scene and the numbers of two clouds, and their order."""


def write_poses(out: Path) -> bool:
    """Write the poses of a run, of pairs with numbers; tell whether there are any."""
    found: dict[Path, dict[tuple[int, int], FloatArray]] = defaultdict(dict)
    for set_id, method, dataset, pair, pose, truth in tables.load_poses(out):
        if dataset not in _SOURCE_FIRST:
            continue
        *_, scene, numbers = pair.split("/")
        first, second = (int(number) for number in numbers.split("-"))
        clouds = (second, first) if _SOURCE_FIRST[dataset] else (first, second)
        folder = out / POSES / _name_folder(set_id)
        for name, file, matrix in ((_name_folder(method), "est.log", pose), (TRUTH, "gt.log", truth)):
            if matrix is not None:
                found[folder / name / scene / file][clouds] = matrix
    for path, poses in found.items():
        make_folder(path.parent)
        write_file(path, format_log(np.array(list(poses)), np.array(list(poses.values()))).encode())
    return bool(found)


def _name_folder(label: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_.+ " else "_" for letter in label)
