"""Colours of the scans of a scene, and its poses as text."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cgroup.io.files import number_lines
from cgroup.io.scan_names import list_names
from cgroup.pose_graph.files import motion_lines
from cgroup.types import FloatArray

_FIRST_COLORS = bytes.fromhex("E69F00 0072B2 009E73 CC79A7 56B4E9 D55E00 B8AC1B 7A5195")
"""Colours that are distinct for every common kind of colour vision."""

_GOLDEN = 0.618
"""Turn between the hues of consecutive scans, which keeps them apart."""

POSE_FORMATS = (".tum", ".kitti", ".log")
WITHOUT_NAMES = (".kitti", ".log")
"""Formats without comments: many readers expect numbers in each line."""


def scan_colors(count: int) -> NDArray[np.uint8]:
    """Return red, green and blue of a number of scans."""
    first = np.frombuffer(_FIRST_COLORS, np.uint8).reshape(-1, 3)
    further = [
        colorsys.hls_to_rgb(_GOLDEN * number % 1, (0.42, 0.58, 0.7)[number % 3], 0.62)
        for number in range(len(first), count)
    ]
    bytes_of = np.rint(255 * np.reshape(further, (-1, 3)))
    return np.concatenate([first, bytes_of]).astype(np.uint8)[:count]


def format_poses(suffix: str, poses: FloatArray, rows: Sequence[int], names: Sequence[str]) -> str:
    """Format poses of scans, their rows, and the names of all scans."""
    if suffix == ".kitti":
        lines = number_lines(poses[:, :3].reshape(-1, 12))
    elif suffix == ".tum":
        lines = [f"# {line}" for line in (*list_names(names, rows), "row of the scan, tx ty tz qx qy qz qw")]
        lines += [f"{row} {line}" for row, line in zip(rows, motion_lines(poses), strict=True)]
    else:
        blocks = zip(rows, map(number_lines, poses), strict=True)
        lines = [line for row, pose in blocks for line in (f"{row} {row} {row + 1}", *pose)]
    return "".join(f"{line}\n" for line in lines)
