"""Plane-fit normals: smallest eigenvector of the neighbourhood's covariance, towards a viewpoint."""

import numpy as np
from numpy.typing import NDArray

from .neighborhood import FloatArray, ball, nearest


def plane(points: FloatArray) -> tuple[FloatArray, float]:
    """Normal and surface variation of the plane through some points; NaN where they leave it open."""
    if len(points) < 3:
        return np.full(3, np.nan), np.nan
    centered = points - points.mean(axis=0)
    values, vectors = np.linalg.eigh(centered.T @ centered / len(points))
    if values[1] <= 1e-12 * values[2]:
        return np.full(3, np.nan), np.nan
    return vectors[:, 0], max(values[0], 0) / values.sum()


def normals(
    points: FloatArray,
    *,
    neighbors: int | None = None,
    radius: float | None = None,
    viewpoint: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> FloatArray:
    result = np.empty_like(points)
    for i, point in enumerate(points):
        rows = nearest(points, i, neighbors or 20) if radius is None else ball(points, i, radius)[:neighbors]
        normal, _ = plane(points[rows])
        result[i] = -normal if normal @ (np.asarray(viewpoint) - point) < 0 else normal
    return result


def mesh_normals(points: FloatArray, faces: NDArray[np.integer]) -> FloatArray:
    """Area-weighted vertex normals of a mesh whose faces are wound alike."""
    result = np.zeros_like(points)
    for a, b, c in faces:
        result[[a, b, c]] += np.cross(points[b] - points[a], points[c] - points[a])
    return result / np.linalg.norm(result, axis=1, keepdims=True)
