"""How well two correspondences agree (paper Eq. 12 and 13).

    ds_ij = |p_i - p_j|,  dt_ij = |p'_i - p'_j|
    distance_ratio       rho_ij   = min(ds/dt, dt/ds)   (ST, GTM, SI)
    distance_difference  delta_ij = |ds - dt|           (GC, CV)

Decisions where the paper is open
---------------------------------
* An edge has zero length when it is <= 1e-12 times the bounding-box diagonal of the
  points of its own side. rho is 0 there, so the diagonal of rho is 0 as well.
* Each side is centred on its own mean before anything else.
"""

import numpy as np

from .result import BoolArray, FloatArray

ZERO_EDGE = 1e-12


def centred(points: FloatArray) -> FloatArray:
    return points - points.mean(axis=0) if len(points) else points


def bounding_box_diagonal(points: FloatArray) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0


def edge_lengths(points: FloatArray) -> FloatArray:
    """(n,n) distances between all pairs of points."""
    local = centred(points)
    return np.linalg.norm(local[:, None, :] - local[None, :, :], axis=2)


def zero_edges(points: FloatArray) -> BoolArray:
    """(n,n) True where two points coincide; the diagonal is True."""
    return edge_lengths(points) <= ZERO_EDGE * bounding_box_diagonal(points)


def shares_an_endpoint(source: FloatArray, target: FloatArray) -> BoolArray:
    """(n,n) True where the source points or the target points coincide."""
    return zero_edges(source) | zero_edges(target)


def distance_ratio(source: FloatArray, target: FloatArray) -> FloatArray:
    """(n,n) rho_ij in [0,1], Eq. 12; 0 where either edge has zero length."""
    ds, dt = edge_lengths(source), edge_lengths(target)
    with np.errstate(divide="ignore", invalid="ignore"):
        rho = np.minimum(ds / dt, dt / ds)
    return np.where(shares_an_endpoint(source, target), 0.0, rho)


def distance_difference(source: FloatArray, target: FloatArray) -> FloatArray:
    """(n,n) delta_ij >= 0 in the unit of the data, left side of Eq. 13."""
    return np.abs(edge_lengths(source) - edge_lengths(target))
