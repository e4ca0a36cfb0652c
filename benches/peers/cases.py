"""Seeded cases, drawn by `cgroup.datasets.make_problem` and written once for Python and C++.

Lengths are in pr. A case holds

- ``src``, ``tgt`` (n,3): matched points;
- ``lrf_src``, ``lrf_tgt`` (n,3,3): local reference frames, rows are the axes;
- ``sim``, ``ratio`` (n,): descriptor similarity (higher is better) and d1/d2 (lower is better);
- ``gt`` (n,) uint8: 1 where the true pose leaves at most `INLIER_RESIDUAL`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

Array: TypeAlias = "NDArray[np.float64]"
Mask: TypeAlias = "NDArray[np.bool_]"
Case: TypeAlias = "dict[str, NDArray]"

SEED = 20240711
INLIER_RESIDUAL = 5.0
PROBLEM = {"noise": 0.5, "frame_error": 5.0, "random_frames": 0.0, "repeated_targets": 0.0, "radius": 38.0}

MAGIC = b"CGC2"
FIELDS = {"src": (3,), "tgt": (3,), "lrf_src": (3, 3), "lrf_tgt": (3, 3), "sim": (), "ratio": (), "gt": ()}
"""Shape of a row, in the order of the file: little-endian, magic, uint32 n, then float32, `gt` uint8."""


def make_case(n: int, share: float) -> Case:
    """Draw n matches of which a share is right; the same arrays for the same arguments."""
    from cgroup.datasets import make_problem  # noqa: PLC0415 - the libraries' environment lacks cgroup

    rng = np.random.default_rng([SEED, n, round(share * 1e4)])
    problem = make_problem(rng, n, inlier_ratio=share, **PROBLEM)
    case = {
        "src": problem.source,
        "tgt": problem.target,
        "lrf_src": problem.source_lrf,
        "lrf_tgt": problem.target_lrf,
        "sim": problem.similarity,
        "ratio": problem.ratio,
        "gt": problem.inlier_mask,
    }
    return {key: np.ascontiguousarray(values, _kind(key)) for key, values in case.items()}


def ensure_case(folder: Path, n: int, share: float) -> Path:
    """Write a case unless it is there; its path."""
    path = folder / f"n{n:06d}_inliers{round(share * 1000):03d}.bin"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".partial")
        write_case(partial, make_case(n, share))
        partial.replace(path)
    return path


def write_case(path: Path, case: Case) -> None:
    """Write a case in the layout of `FIELDS`, which `pcl_peers.cpp` reads too."""
    with path.open("wb") as file:
        file.write(MAGIC + np.array(len(case["gt"]), "<u4").tobytes())
        for key in FIELDS:
            file.write(case[key].tobytes())


def load_case(path: Path) -> Case:
    """Read a case."""
    data = path.read_bytes()
    if data[:4] != MAGIC:
        message = f"{path}: not a case"
        raise ValueError(message)
    n = int(np.frombuffer(data, "<u4", 1, 4)[0])
    case, offset = {}, 8
    for key, row in FIELDS.items():
        kind = np.dtype(_kind(key))
        count = n * math.prod(row)
        case[key] = np.frombuffer(data, kind, count, offset).reshape(n, *row)
        offset += count * kind.itemsize
    return case


def _kind(key: str) -> str:
    return "u1" if key == "gt" else "<f4"
