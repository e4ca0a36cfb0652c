"""Lists of pairs with their poses: Redwood's ``gt.log``, and the manifest of a data root."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup.errors import InputError
from cgroup.io._files import load_text
from cgroup.rigid import check_rigid

if TYPE_CHECKING:
    from pathlib import Path

    from cgroup.types import FloatArray


def read_log(path: Path) -> dict[tuple[int, int], FloatArray]:
    """Read a ``gt.log``, as 3DMatch, 3DLoMatch and FGR have it: ``T_i_j`` by (i, j), in the file's order.

    It has five lines per pair: ``i j n``, and a 4x4 transform that maps cloud j into the frame of cloud i.
    """
    try:
        lines = [line.split() for line in load_text(path).splitlines() if line.strip()]
        poses: dict[tuple[int, int], FloatArray] = {}
        for start in range(0, len(lines), 5):
            first, second = (int(word) for word in lines[start][:2])
            rows = [[float(word) for word in line] for line in lines[start + 1 : start + 5]]
            poses[first, second] = check_rigid(np.array(rows).reshape(4, 4), f"pose {first} {second}")
    except ValueError as error:
        message = f"{path}: not a list of poses; five lines each: `i j n`, then a 4x4 matrix ({error})"
        raise InputError(message) from error
    return poses


def manifest_pairs(root: Path, dataset: str) -> list[dict[str, Any]]:
    """Pairs of a data set in the root's ``manifest.json``, for data without a list by their owners."""
    path = root / "manifest.json"
    if not path.is_file():
        return []
    try:
        entries: Any = json.loads(load_text(path))
    except ValueError as error:
        message = f"{path}: not a readable manifest ({error})"
        raise InputError(message) from error
    if not isinstance(entries, dict) or not isinstance(entries.get(dataset, {}), dict):
        message = f"{path}: has to be an object with one object per data set"
        raise InputError(message)
    return entries[dataset]["pairs"] if entries.get(dataset) else []
