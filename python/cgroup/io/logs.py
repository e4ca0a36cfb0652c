"""Redwood's lists of pairs: poses in ``gt.log`` and ``est.log``, information matrices in ``gt.info``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from cgroup.errors import InputError
from cgroup.io.files import load_text, number_lines
from cgroup.rigid import check_rigid
from cgroup.types import FloatArray, IndexArray


def read_log(path: Path) -> dict[tuple[int, int], FloatArray]:
    """Read a ``gt.log``, as 3DMatch, 3DLoMatch and FGR have it: ``T_i_j`` by (i, j), in the file's order.

    It has five lines per pair: ``i j n``, and a 4x4 transform that maps cloud j into the frame of cloud i.
    """
    return read_matrices(path, 4, check_rigid)


def read_matrices(
    path: Path, size: int, check: Callable[[FloatArray, str], FloatArray] = lambda matrix, _: matrix
) -> dict[tuple[int, int], FloatArray]:
    """Read a list of square matrices, each behind a line ``i j n``, by (i, j)."""
    found: dict[tuple[int, int], FloatArray] = {}
    lines = [line.split() for line in load_text(path).splitlines() if line.strip()]
    try:
        for start in range(0, len(lines), size + 1):
            first, second = (int(word) for word in lines[start][:2])
            rows = [[float(word) for word in line] for line in lines[start + 1 : start + size + 1]]
            matrix = np.array(rows).reshape(size, size)
            found[first, second] = check(matrix, f"pose {first} {second}")
    except (ValueError, OverflowError) as error:
        form = f"{size + 1} lines each: `i j n`, then a {size}x{size} matrix"
        raise InputError(f"{path}: not a list of poses; {form} ({error})") from error
    if len(found) * (size + 1) < len(lines):
        raise InputError(f"{path}: lists a pair twice; give each pair once")
    return found


def format_log(pairs: IndexArray, poses: FloatArray) -> str:
    """Write poses of pairs (n,2), exact to the last bit; some readers split lines at tabs only."""
    count = int(pairs.max(initial=-1)) + 1
    blocks = zip(pairs.tolist(), map(number_lines, poses), strict=True)
    lines = [line for (i, j), rows in blocks for line in (f"{i} {j} {count}", *rows)]
    return "".join(f"{line}\n" for line in lines).replace(" ", "\t")
