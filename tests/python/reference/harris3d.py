"""Harris 3D keypoints: maxima of a function of C, the mean of n n^T over a ball.

Decisions
---------
* HARRIS responses are rounded to 2^-28, what PCL's single precision leaves of 0.04 + det - 0.04.
* A ball without normals has response 0.
"""

import numpy as np

from .neighborhood import FloatArray, ball, local_maxima
from .normals import normals as fit_normals
from .normals import plane


def responses(
    points: FloatArray, *, radius: float, response: str = "harris", normals: FloatArray | None = None
) -> FloatArray:
    """Response (N,) at every point."""
    if response == "curvature":
        return np.array([plane(points[ball(points, i, radius)])[1] for i in range(len(points))])
    if normals is None:
        normals = fit_normals(points, radius=radius)
    result = np.zeros(len(points))
    for i in range(len(points)):
        around = normals[ball(points, i, radius)]
        around = around[np.isfinite(around[:, 0])]
        if len(around):
            result[i] = of_tensor(np.mean([np.outer(n, n) for n in around], axis=0), response)
    return result


def of_tensor(tensor: FloatArray, response: str) -> float:
    trace, det = np.trace(tensor), np.linalg.det(tensor)
    if response == "noble":
        return det / trace
    if response == "lowe":
        return det / trace**2
    if response == "tomasi":
        return np.linalg.eigvalsh(tensor)[0]
    return np.round((0.04 + det - 0.04 * trace**2) * 2**28) / 2**28


def harris3d(
    points: FloatArray, scores: FloatArray, *, nms_radius: float, threshold: float, break_ties: bool = False
) -> list[int]:
    return [
        i for i in local_maxima(points, scores, nms_radius, break_ties=break_ties) if scores[i] >= threshold
    ]
