"""Is a pose right? Poses judged and refined on the two surfaces, wherever the poses come from.

=============  ====================================================================================
`Surface`      points and normals made ready once, and kept for all poses and partners
`verify`       many poses in, the best few out: refined, scored, with what the surfaces say of the best
`score_poses`  scores of poses as they are
=============  ====================================================================================

Matches alone cannot tell a wrong pose that many of them happen to support from a right one with few. The
surfaces can: under a right pose they coincide where they overlap, and neither lies where the other's scanner
saw through. Lengths are in the unit of the points; `unit` scales every tolerance. Functions take ``threads``
(int or None, None for all cores); results do not depend on it. Input that can't be worked with raises
`InputError`, a `ValueError`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cgroup import _core
from cgroup._arguments import as_floats, as_length, as_number, as_place, real_points
from cgroup._options import run_options
from cgroup.errors import InputError
from cgroup.rigid import RIGID_TOLERANCE

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.types import Correspondences, FloatArray, IndexArray

__all__ = ["Surface", "Verification", "score_poses", "verify"]

MATCH_UNITS = 2.5
"""Distance within which a match speaks for a pose, in units: a voxel."""


class Surface:
    """A surface made ready once: nearest points, ranges and samples, for any number of poses and partners.

    Memory grows with the points and their surface, some kilobytes per point, not with the box around them.
    Threads may share a surface.

    Parameters
    ----------
    points : (N,3) array_like of float
        Ten or more, finite, about evenly spread: thin a raw scan to voxels first.
    normals : (N,3) array_like of float
        Of any length; NaN or zero for none.
    unit : float
        0.4 of the voxel, or of the distance between points. All tolerances are multiples of it. Both surfaces
        of a pair need the same.
    viewpoint : (3,) array_like of float, optional
        Where the scanner stood, if the points are one single scan with normals towards it. What lies before
        the scanned surface then counts against a pose. Leave it out for points fused from several scans.
    oriented : bool, optional
        Whether the normals point to the same side of the surface in both clouds; otherwise a normal and its
        opposite are the same. None stands for whether there is a viewpoint.
    threads : int, optional
        Threads to compute on, None for all cores.

    Raises
    ------
    InputError
        For a wrong shape, a coordinate that is not finite, fewer than 10 points with a normal, or points that
        span fewer than 10 units or so many that the unit can't be meant.

    Examples
    --------
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.verification import Surface
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = features.resolution(points)
    >>> Surface(points, features.normals(points), unit=0.4 * pr, viewpoint=(0, 0, 0))
    Surface(n=2554)
    """

    __slots__ = ("_core", "_unit")

    def __init__(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        *,
        unit: float,
        viewpoint: ArrayLike | None = None,
        oriented: bool | None = None,
        threads: int | None = None,
    ) -> None:
        rows, directions = real_points("points", points), real_points("normals", normals)
        if len(rows) != len(directions):
            message = (
                f"normals: got {len(directions)} for {len(rows)} points; give one per point, NaN for none"
            )
            raise InputError(message)
        self._unit = as_number("unit", unit)
        eye = None if viewpoint is None else as_place("viewpoint", viewpoint)
        known = eye is not None if oriented is None else oriented
        self._core = _core.Surface(rows, directions, run_options(threads), self._unit, eye, known)

    @property
    def unit(self) -> float:
        """The length that all tolerances are multiples of."""
        return self._unit

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self._core)

    def __repr__(self) -> str:
        return f"Surface(n={len(self)})"


@dataclass(frozen=True, eq=False)
class Verification:
    """The poses that survived, and what the surfaces say of the best.

    Attributes
    ----------
    T_target_source : (4,4) array of float64
        The best pose, which moves the source's points onto the target.
    score : float
        Its agreement less violations, at most 2; 0 or less for nothing in common.
    margin : float
        Lead in ln score (and evidence, see `verify`) over the best pose that differs by more than 10 degrees
        or 20 units; infinite where there is none.
    fitness : float
        Share of the source's points that lie on the target's surface: within 2 units of its plane, normals
        alike.
    inlier_rmse : float
        Root mean square of their distances to it, in the unit of the points; NaN where there are none.
    information : (6,6) array of float64
        ``sum w J^T J`` of a point-to-plane step at the best pose, for a rotation vector about the target's
        origin (first) and a translation. Divide by the variance of the distances for the information of a
        pose graph.
    open_motion : (6,) array of float64 or None
        Where the surfaces leave a motion open (a plane, a cylinder, a sphere): the one they resist least, in
        the same coordinates, of a size that moves them by about one unit. None where they fix all six.
    poses : (k,4,4) array of float64
        Up to 12, best first; none within 3 units of a better one.
    scores : (k,) array of float64
        Of each.
    evidence : (k,) array of int64
        Matches that each lays together; 0 without matches.
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

    All are scored with 300 samples of either surface and a tolerance of 8 units; the 150 best, none within 10
    units of another, are refined by 12 point-to-plane steps and scored with 1,000 samples and 3 units; the 12
    best by 15 more steps and scored with 2,500 samples and 2 units. These are ranked by
    ``ln score + 0.1 ln(1 + min(evidence, 20))``. The steps are those of Y. Chen and G. Medioni, *Object
    modelling by registration of multiple range images*, 1992.

    Parameters
    ----------
    source, target : Surface
        Of the same unit.
    poses : (m,4,4) or (4,4) array_like of float
        Rigid transforms from the source into the target: a grouping's model, its alternatives, one per match,
        your own.
    matches : Correspondences, optional
        Putative matches; those that a refined pose lays together speak a little for it.
    match_tolerance : float, optional
        Distance within which they do; 2.5 units, a voxel, unless given.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    Verification
        Always with a best pose, which may be wrong: see its `score` and `margin`.

    Raises
    ------
    InputError
        For no pose, one that is not rigid (the message names it), or surfaces of different units.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.verification import Surface, verify
    >>> pair = standin_pair(pixels=80)
    >>> pr = features.resolution(pair.source.points)
    >>> source, target = (
    ...     Surface(scan.points, features.normals(scan.points), unit=0.4 * pr, viewpoint=(0, 0, 0))
    ...     for scan in (pair.source, pair.target)
    ... )
    >>> near = pair.T_target_source.copy()
    >>> near[:3, 3] += 2 * pr
    >>> found = verify(source, target, [np.eye(4), near])
    >>> bool(np.abs(found.T_target_source - pair.T_target_source).max() < pr)
    True
    """
    checked, evidence = _poses(poses), None
    if matches is not None:
        tolerance = MATCH_UNITS * target.unit if match_tolerance is None else match_tolerance
        evidence = (matches.source, matches.target, as_length("match_tolerance", tolerance))
    found, scores, counts, margin, overlap = _core.verify(
        source._core,  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] - not for users
        target._core,  # noqa: SLF001 # pyright: ignore[reportPrivateUsage]
        checked,
        evidence,
        run_options(threads),
    )
    return Verification(found[0], float(scores[0]), margin, *overlap, found, scores, counts)


def score_poses(
    source: Surface, target: Surface, poses: ArrayLike, *, threads: int | None = None
) -> FloatArray:
    """Score poses as they are, by the measure of the last round of `verify`.

    A sample x of one surface, moved onto the other, finds the nearest point y with normal m (nearest to the
    centre of a cell of 1 unit, up to 4 units away). With ``e^2 = ((x - y).m)^2 + 0.15 |x - y|^2`` it counts
    ``1 - e^2/t^2`` where that is positive, t = 2 units, and the normals' cosine exceeds 0.8. One that finds
    none counts -1 where it lies more than 3 units before what the other's scanner saw, and -0.3 before its
    background while facing the scanner. The score is the sum of both means.

    Parameters
    ----------
    source, target : Surface
        Of the same unit.
    poses : (m,4,4) or (4,4) array_like of float
        Rigid transforms from the source into the target.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    (m,) array of float64
        At most 2, one per pose.

    Raises
    ------
    InputError
        For a pose that is not rigid (the message names it), or surfaces of different units.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.verification import Surface, score_poses
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = features.resolution(points)
    >>> surface = Surface(points, features.normals(points), unit=0.4 * pr)
    >>> away = np.eye(4)
    >>> away[0, 3] = 100 * pr
    >>> [round(score, 2) for score in score_poses(surface, surface, [np.eye(4), away]).tolist()]
    [2.0, 0.0]
    """
    return _core.score_poses(
        source._core,  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] - not for users
        target._core,  # noqa: SLF001 # pyright: ignore[reportPrivateUsage]
        _poses(poses),
        run_options(threads),
    )


def _poses(value: ArrayLike) -> FloatArray:
    """Return (m,4,4) rigid transforms."""
    poses = as_floats("poses", value)
    if poses.ndim == 2:
        poses = poses[None]
    if poses.ndim != 3 or poses.shape[1:] != (4, 4) or len(poses) == 0:
        message = f"poses: got shape {poses.shape}; give (m,4,4), at least one rigid transform"
        raise InputError(message)
    rotations = poses[:, :3, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        squares = np.einsum("kji,kjl->kil", rotations, rotations)
        right = np.isfinite(poses).all(axis=(1, 2)) & (
            np.abs(squares - np.eye(3)).max(axis=(1, 2)) <= RIGID_TOLERANCE
        )
        right &= (np.abs(poses[:, 3] - (0, 0, 0, 1)).max(axis=1) <= 1e-9) & (np.linalg.det(rotations) > 0)
    if not right.all():
        message = (
            f"poses: pose {int(np.argmin(right))} of {len(poses)} is not rigid: [R t; 0 0 0 1] with a "
            "rotation R; leave out those of matches without frames"
        )
        raise InputError(message)
    return poses
