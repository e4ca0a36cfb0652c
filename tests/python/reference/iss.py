"""ISS keypoints: maxima of the smallest eigenvalue of the scatter, where eigenvalues differ enough."""

import numpy as np

from .neighborhood import FloatArray, ball, local_maxima


def saliencies(
    points: FloatArray,
    *,
    salient_radius: float,
    gamma_21: float = 0.975,
    gamma_32: float = 0.975,
    min_neighbors: int = 5,
    density_weight: bool = False,
    covariance: str = "point",
) -> FloatArray:
    """Smallest eigenvalue (N,) where the tests pass, else 0."""
    balls = [ball(points, i, salient_radius) for i in range(len(points))]
    result = np.zeros(len(points))
    for i, rows in enumerate(balls):
        if len(rows) < min_neighbors:
            continue
        weights = np.array([1 / len(balls[j]) if density_weight else 1.0 for j in rows])
        middle = points[i] if covariance == "point" else np.average(points[rows], axis=0, weights=weights)
        offsets = points[rows] - middle
        scatter = (weights[:, None] * offsets).T @ offsets
        if density_weight or covariance == "mean":
            scatter /= weights.sum()
        third, second, first = np.linalg.eigvalsh(scatter)
        if second < gamma_21 * first and third < gamma_32 * second and third > 1e-13 * first:  # else a plane
            result[i] = third
    return result


def iss(points: FloatArray, scores: FloatArray, *, nms_radius: float, min_neighbors: int = 5) -> list[int]:
    return [i for i in local_maxima(points, scores, nms_radius, least=min_neighbors) if scores[i] > 0]
