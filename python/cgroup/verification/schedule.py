"""Verify many poses: score all coarsely, then refine and score the best more finely."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from cgroup import _core
from cgroup._checks.arrays import as_floats
from cgroup._checks.values import as_instance, as_length, run_options
from cgroup.errors import InputError
from cgroup.rigid.transforms import as_poses
from cgroup.types import Correspondences, FloatArray, IndexArray
from cgroup.verification.surface import Surface, core_surfaces

# Angle, or displacement of the source's centre in units, beyond which two poses differ
DIFFERENT_DEGREES, DIFFERENT_UNITS = _core.DIFFERENT_POSES
MATCH_UNITS = 2.5  # distance within which a match supports a pose, in units: a voxel


@dataclass(frozen=True, eq=False)
class Verification:
    """The surviving poses, and the evidence of the surfaces for the best one.

    The best pose, its information and its open motion, of about one unit, are as for `Alignment`.

    Parameters
    ----------
    score : float
        Its agreement minus violations, at most 2; at most 0 for surfaces with nothing in common.
    margin : float
        Lead in ``ln score + 0.1 ln(1 + min(evidence, 20))`` over the best pose that differs by more than 10
        degrees or 20 units; infinite without a rival.
    fitness : float
        Fraction of the source's points on the target's surface: within 2 units of its plane, normals alike.
    inlier_rmse : float
        Root mean square of their distances to it, in the unit of the points; NaN without such points.
    poses : (k,4,4) array of float64
        Up to 12, best first; none within 3 units of a better one.
    scores : (k,) array of float64
        Of each.
    evidence : (k,) array of int64
        Number of matches that support each; 0 without matches.
    """

    T_target_source: FloatArray
    score: float
    margin: float
    fitness: float
    inlier_rmse: float
    information: FloatArray
    open_motion: FloatArray | None
    poses: FloatArray
    scores: FloatArray
    evidence: IndexArray

    def __repr__(self) -> str:
        return f"Verification(score={self.score:.3g}, margin={self.margin:.3g}, fitness={self.fitness:.3g})"


def verify(
    source: Surface,
    target: Surface,
    poses: ArrayLike,
    *,
    matches: Correspondences | None = None,
    match_tolerance: float | None = None,
    threads: int | None = None,
) -> Verification:
    """Find the best of many poses on the surfaces, and refine it.

    All are scored coarsely; the best ones are refined by point-to-plane steps (Y. Chen and G. Medioni,
    *Object modelling by registration of multiple range images*, 1992) and scored more finely, in two more
    rounds. They are ranked by ``ln score + 0.1 ln(1 + min(evidence, 20))``.

    Parameters
    ----------
    source, target : Surface
        Of the same unit.
    poses : (m,4,4) or (4,4) array_like of float
        Rigid transforms from the source into the target, from any method.
    matches : Correspondences, optional
        Putative matches; those that agree with a refined pose support it a little.
    match_tolerance : float, optional
        Distance within which a match agrees; 2.5 units, a voxel, by default.
    threads : int, optional
        Number of threads; all cores by default. The result does not depend on it.

    Returns
    -------
    Verification
        Always with a best pose, which may be wrong; `score` and `margin` show how reliable it is.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.verification import Surface, verify
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = features.resolution(points)
    >>> surface = Surface(points, features.normals(points), unit=0.4 * pr)
    >>> round(verify(surface, surface, np.eye(4)).score, 2)
    2.0
    """
    checked, evidence, surfaces = _as_some_poses(poses), None, core_surfaces(source, target)
    tolerance = MATCH_UNITS * target.unit
    if match_tolerance is not None:
        tolerance = as_length("match_tolerance", match_tolerance)
    if matches is not None:
        as_instance("matches", matches, Correspondences)
        evidence = (matches.source, matches.target, tolerance)
    parts = _core.verify(*surfaces, checked, evidence, run_options(threads))
    found, scores, counts, margin, (fitness, rmse, resistance) = parts
    return Verification(found[0], float(scores[0]), margin, fitness, rmse, *resistance, found, scores, counts)


def score_poses(
    source: Surface, target: Surface, poses: ArrayLike, *, threads: int | None = None
) -> FloatArray:
    """Return scores of poses as in the last round of `verify`, without refinement.

    The mean over the samples of either surface of their agreement with the other surface, minus violations of
    its free space; the score is the sum of both means. Parameters are as for `verify`.

    Returns
    -------
    (m,) array of float64
        At most 2, one per pose.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.verification import Surface, score_poses
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = features.resolution(points)
    >>> surface = Surface(points, features.normals(points), unit=0.4 * pr)
    >>> score_poses(surface, surface, np.eye(4)).round(2)
    array([2.])
    """
    return _core.score_poses(*core_surfaces(source, target), _as_some_poses(poses), run_options(threads))


def _as_some_poses(value: ArrayLike) -> FloatArray:
    """Return one or more rigid transforms, (m,4,4)."""
    poses = as_floats("poses", value)
    if poses.ndim not in {2, 3} or poses.size == 0:
        raise InputError("poses", f"shape {poses.shape}", "give (m,4,4), at least one rigid transform")
    return as_poses("poses", poses[None] if poses.ndim == 2 else poses)
