"""Every step of the front end on given arrays: what holds for any of them is tested on this table."""

from collections.abc import Callable
from typing import Any

import numpy as np

from cgroup import features


def steps_of(
    points: Any, normals: Any, *, unit: float, rows: Any, faces: Any, threads: int | None = None
) -> dict[str, Callable[[], Any]]:
    """Return calls by their names; the unit is about the distance of two points, the rows are keypoints."""
    ball, support = {"radius": 3 * unit, "threads": threads}, {"radius": 4 * unit, "threads": threads}
    return {
        "resolution": lambda: features.resolution(points, threads=threads),
        "normals": lambda: features.normals(points, threads=threads),
        "normals in a ball": lambda: features.normals(points, **ball),
        "mesh normals": lambda: features.mesh_normals(points, faces),
        "voxels": lambda: (
            features.voxel_downsample(points, unit / 2, normals=normals, threads=threads).points
        ),
        "harris3d": lambda: features.harris3d(points, normals=normals, **ball),
        "iss": lambda: features.iss(points, resolution=unit, threads=threads),
        "drop_isolated": lambda: features.drop_isolated(points, rows, radius=3 * unit, min_points=5),
        "shot_lrf": lambda: features.shot_lrf(points, rows, **support),
        "toldi_lrf": lambda: features.toldi_lrf(points, rows, **support),
        "shot": lambda: features.shot(points, normals, rows, **support),
        "lfsh": lambda: features.lfsh(points, normals, rows, **support),
        "rcs": lambda: features.rcs(points, rows, **support),
        "fpfh": lambda: features.fpfh(points, normals, rows, **ball),
    }


def cosines(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """Cosine of each row with its counterpart."""
    ours, theirs = ours.astype(float), theirs.astype(float)
    return np.sum(ours * theirs, axis=1) / np.linalg.norm(ours, axis=1) / np.linalg.norm(theirs, axis=1)
