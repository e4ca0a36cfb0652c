"""Voxel down-sampling by a dictionary of cells."""

import numpy as np

from .neighborhood import FloatArray


def voxel_downsample(
    points: FloatArray, normals: FloatArray, voxel: float
) -> tuple[FloatArray, FloatArray, list[int]]:
    """Means (M,3), their normals (M,3) and the voxel of every point; cells along x first."""
    cells = [tuple(cell[::-1]) for cell in np.floor((points - points.min(axis=0)) / voxel + 0.5).astype(int)]
    numbers = {cell: number for number, cell in enumerate(sorted(set(cells)))}
    indices = np.array([numbers[cell] for cell in cells])
    members = [np.flatnonzero(indices == number) for number in range(len(numbers))]
    return (
        np.array([points[rows].mean(axis=0) for rows in members]),
        np.array([mean_direction(normals[rows]) for rows in members]),
        indices.tolist(),
    )


def mean_direction(normals: FloatArray) -> FloatArray:
    """Sum of the normals that are known, of unit length."""
    total = normals[np.isfinite(normals).all(axis=1)].sum(axis=0)
    length = np.linalg.norm(total)
    return total / length if length > 1e-12 else np.full(3, np.nan)
