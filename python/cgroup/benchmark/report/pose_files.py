"""Poses of a run as scripts of others read them, and `cgroup evaluate`: ``SET/METHOD/SCENE/est.log``.

The true ones are beside them, ``SET/truth/SCENE/gt.log``; they map cloud j of a line ``i j`` into i.
"""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from cgroup.io import write_file
from cgroup.io._logs import format_log
from cgroup.io._results import make_folder

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from cgroup.benchmark.tables import PairPose
    from cgroup.types import FloatArray

TRUTH = "truth"
"""Folder of the true poses, beside those of the methods."""

_SOURCE_FIRST = {"3dmatch-test": False, "3dlomatch-test": False, "kitti": True}
"""Data sets whose pairs are named by a scene and the numbers of two clouds, and their order."""


def write_poses(out: Path, poses: Iterable[PairPose]) -> None:
    """Write poses of pairs whose clouds have numbers."""
    logs: dict[Path, dict[tuple[int, int], FloatArray]] = defaultdict(dict)
    for one in poses:
        if one.dataset not in _SOURCE_FIRST:
            continue
        *_, scene, numbers = one.pair.split("/")
        first, second = (int(number) for number in numbers.split("-"))
        clouds = (second, first) if _SOURCE_FIRST[one.dataset] else (first, second)
        folder = out / _name_folder(one.set_id)
        if one.found is not None:
            logs[folder / _name_folder(one.method) / scene / "est.log"][clouds] = one.found
        if one.true is not None:
            logs[folder / TRUTH / scene / "gt.log"][clouds] = one.true
    for path, log in logs.items():
        make_folder(path.parent)
        write_file(path, format_log(np.array(list(log)), np.array(list(log.values()))).encode())


def _name_folder(label: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_.+ " else "_" for letter in label)
