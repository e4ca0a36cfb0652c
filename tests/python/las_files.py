"""LAS files with random attributes, and poses to move files by."""

from typing import Any

import laspy
import numpy as np

from cgroup.rigid.transforms import turn

UTM = (432_100.7, 5_123_400.3, 312.5)


def make_pose(seed: int, away: Any = (3.0, -2.0, 1.0)) -> np.ndarray:
    quaternion = np.random.default_rng(seed).normal(size=4)
    pose = np.eye(4)
    pose[:3, :3] = turn(*(quaternion / np.linalg.norm(quaternion)))
    pose[:3, 3] = away
    return pose


def fill_attributes(data: laspy.LasData, rng: np.random.Generator, most: int | None = None) -> None:
    """Set all dimensions but the coordinates; integers to what the dimension holds, or at most to `most`."""
    for dimension in data.point_format.dimensions:
        if dimension.name in "XYZ":
            continue
        if dimension.kind == laspy.DimensionKind.FloatingPoint:
            data[dimension.name] = rng.normal(size=len(data.points))
            continue
        largest = dimension.max if dimension.is_standard or most is not None else 1000
        largest = largest if most is None else min(largest, most)
        data[dimension.name] = rng.integers(0, largest, len(data.points), endpoint=True)
