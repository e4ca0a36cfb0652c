"""FPFH-33: histograms of three angles between oriented points, weighted by inverse squared distance."""

from collections.abc import Iterable

import numpy as np

from .neighborhood import FloatArray, ball

BINS = 11
TIE = 1e-6


def fpfh(
    points: FloatArray,
    normals: FloatArray,
    *,
    radius: float,
    max_neighbors: int | None = 100,
    convention: str = "open3d",
) -> FloatArray:
    neighbors = [ball(points, i, radius)[:max_neighbors] for i in range(len(points))]
    simple = [
        simple_histogram(points, normals, i, near, keeps_flat=convention == "open3d")
        for i, near in enumerate(neighbors)
    ]
    rows = []
    for i, near in enumerate(neighbors):
        total = np.zeros((3, BINS))
        for j in near:
            square = np.sum((points[j] - points[i]) ** 2)
            if square > 0:
                total += simple[j] / square
        sums = total.sum(axis=1, keepdims=True)
        row = 100 * np.divide(total, sums, out=np.zeros_like(total), where=sums > 0)
        if convention == "open3d":
            row += simple[i]
        rows.append(row.ravel() if np.isfinite(normals[i]).all() else np.full(3 * BINS, np.nan))
    return np.array(rows).reshape(-1, 3 * BINS)


def simple_histogram(
    points: FloatArray, normals: FloatArray, i: int, near: Iterable[int], *, keeps_flat: bool
) -> FloatArray:
    """Percentages (3,11) of the pairs of point i with its neighbours; theta, alpha, phi."""
    histogram = np.zeros((3, BINS))
    others = [j for j in near if j != i and np.isfinite(normals[[i, j]]).all()]
    for j in others:
        angles = pair_angles(points[j] - points[i], normals[i], normals[j])
        if angles is None and keeps_flat:
            angles = 0.0, 0.0, 0.0
        if angles is not None:
            theta, alpha, phi = angles
            shares = np.array([(theta + np.pi) / (2 * np.pi), (alpha + 1) / 2, (phi + 1) / 2])
            histogram[range(3), np.clip(np.floor(BINS * shares).astype(int), 0, BINS - 1)] += 1
    return 100 * histogram / max(len(others), 1)


def pair_angles(line: FloatArray, normal: FloatArray, other: FloatArray) -> tuple[float, float, float] | None:
    """Angles in the Darboux frame of the point whose normal is closer to the line, the first of equal ones."""
    length = np.linalg.norm(line)
    if length == 0:
        return None
    direction = line / length
    if abs(normal @ direction) < (1 - TIE) * abs(other @ direction):
        direction, normal, other = -direction, other, normal
    across = np.cross(direction, normal)
    if not across.any():
        return None
    v = across / np.linalg.norm(across)
    w = np.cross(normal, v)
    y, x = w @ other, normal @ other
    theta = np.arctan2(0.0 if abs(y) <= TIE * abs(x) else y, x)
    return float(theta), float(v @ other), float(normal @ direction)
