"""Random matching problems with a known answer: matches between a bumpy ellipsoid and its moved copy.

Points, frames, similarities and ratios are drawn directly, without clouds. In Rust ``tests/common/mod.rs``
draws from the same distribution.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cgroup.errors import InputError
from cgroup.rigid import apply
from cgroup.rigid.transforms import turn
from cgroup.types import BoolArray, Correspondences, FloatArray
from cgroup.types.fields import FIELDS

CORRECT_WITHIN = 5.0  # pr. A match is correct where the true pose leaves no greater distance
_AXES = np.array([1.0, 0.7, 0.5])  # of the ellipsoid, in units of the longest
_DISTANCE = 50.0  # pr, standard deviation of the translation per axis
_SHARES = (  # options of a problem that are shares
    *("inlier_ratio", "repeated_targets", "duplicated_sources", "clutter"),
    *("missing_frames", "random_frames", "zero_descriptors", "missing_second"),
)
_FEW_INLIERS = 0.1  # share below which the ratios of inliers are nearly those of outliers


@dataclass(frozen=True, repr=False)
class MatchingProblem:
    """Matches between two sides, and the mask of the correct ones.

    Further fields as for `Correspondences`; the similarity is -inf, and frames are NaN, for missing ones.

    Parameters
    ----------
    inlier_mask : (n,) ndarray of bool
        Whether the true pose maps the source point to within `CORRECT_WITHIN` of its partner.
    T_target_source : (4,4) ndarray of float64
        The true pose.
    recipe : str
        The parameters of the draw, for messages.
    """

    source: FloatArray
    target: FloatArray
    ratio: FloatArray
    similarity: FloatArray
    source_lrf: FloatArray
    target_lrf: FloatArray
    resolution: float
    source_centroid: FloatArray
    inlier_mask: BoolArray
    T_target_source: FloatArray
    recipe: str = ""

    def __repr__(self) -> str:
        return f"MatchingProblem({self.recipe or f'n={len(self)}, inliers={int(self.inlier_mask.sum())}'})"

    def __len__(self) -> int:
        return len(self.source)

    def correspondences(self) -> Correspondences:
        """Return the input of a grouping method.

        Returns
        -------
        Correspondences
            With every field but candidates.
        """
        return Correspondences(**{name: getattr(self, name) for name in FIELDS if hasattr(self, name)})

    def subset(self, rows: NDArray[np.intp]) -> MatchingProblem:
        """Return the problem with some of its matches.

        Parameters
        ----------
        rows : (m,) array of int
            Which, in their new order.

        Returns
        -------
        MatchingProblem
            With the same pose.

        Raises
        ------
        IndexError
            For a row that isn't there.
        """
        names = ("source", "target", "ratio", "similarity", "source_lrf", "target_lrf", "inlier_mask")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


def make_problem(
    rng: np.random.Generator,
    n: int,
    *,
    inlier_ratio: float = 0.5,
    noise: float = 1.5,
    repeated_targets: float = 0.2,
    duplicated_sources: float = 0.0,
    clutter: float = 0.0,
    missing_frames: float = 0.0,
    random_frames: float = 0.3,
    frame_error: float = 8.0,
    zero_descriptors: float = 0.0,
    missing_second: float = 0.0,
    radius: float = 100.0,
    scale: float = 1.0,
    offset: float = 0.0,
) -> MatchingProblem:
    """Draw a matching problem.

    Source points are drawn on a bumpy ellipsoid. An inlier's partner is its image under a random rigid
    motion, plus noise; an outlier's is anywhere else on the moved surface. Ratios and similarities are
    beta-distributed: better for inliers, with much overlap.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of all randomness: the same state and arguments give the same problem.
    n : int
        Number of matches.
    inlier_ratio : float
        Fraction of correct matches. Below 0.1 their ratios are hardly better than those of others.
    noise : float
        Standard deviation per axis of the inliers' partners, in pr.
    repeated_targets : float
        Fraction of outliers with the partner of another match.
    duplicated_sources : float
        Fraction of matches whose source point and frame are copied from another match.
    clutter : float
        Fraction of outliers at random positions in twice the target's bounding box.
    missing_frames, random_frames : float
        Fraction of matches with no frame on one side, and with an unrelated one on the target's.
    frame_error : float
        Angle in degrees by which the frames of inliers are off.
    zero_descriptors, missing_second : float
        Fraction of matches with similarity -inf, and with ratio 1 by convention.
    radius : float
        Mean radius of the ellipsoid, in pr.
    scale : float
        Length of one pr.
    offset : float
        Distance of both sides from the origin, in pr.

    Returns
    -------
    MatchingProblem
        Its arrays are the caller's own.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.datasets import make_problem
    >>> make_problem(np.random.default_rng(0), 1000, inlier_ratio=0.1)
    MatchingProblem(n=1000, inliers=98)
    """
    given = dict(locals())
    if n < 0:
        raise InputError("n", n, "give a number of matches, 0 or more")
    for name in _SHARES:
        if not 0.0 <= given[name] <= 1.0:
            raise InputError(name, given[name], "give a share from 0 to 1")
    source = _surface(_directions(rng, n), radius)
    rotation, translation = random_rotations(rng, 1)[0], rng.normal(size=3) * _DISTANCE
    is_inlier = rng.permutation(n) < round(inlier_ratio * n)

    copies = np.flatnonzero(rng.random(n) < duplicated_sources)
    originals = rng.integers(0, max(n, 1), size=len(copies))
    source[copies] = source[originals]
    source_lrf = random_rotations(rng, n)
    source_lrf[copies] = source_lrf[originals]

    target = source @ rotation.T + translation + rng.normal(size=(n, 3)) * noise
    target_lrf = _turned(rng, source_lrf @ rotation.T, frame_error)
    directions = _directions(rng, n)
    near = are_near(source, _surface(directions, radius), CORRECT_WITHIN)  # these would be right by accident
    elsewhere = _surface(np.where(near, -directions, directions), radius) @ rotation.T + translation
    target[~is_inlier] = elsewhere[~is_inlier]
    unrelated = ~is_inlier | (rng.random(n) < random_frames)
    target_lrf[unrelated] = random_rotations(rng, n)[unrelated]

    kind = rng.random(n)
    box = 2.0 * np.ptp(target, axis=0) if n else np.zeros(3)
    anywhere = translation + (rng.random(target.shape) - 0.5) * box
    scattered, repeated = ~is_inlier & (kind < clutter), ~is_inlier & (kind >= 1.0 - repeated_targets)
    target[scattered] = anywhere[scattered]
    partners = rng.integers(0, max(n, 1), size=int(repeated.sum()))
    target[repeated], target_lrf[repeated] = target[partners], target_lrf[partners]

    no_frame, on_source = rng.random(n) < missing_frames, rng.random(n) < 0.5
    source_lrf[no_frame & on_source] = np.nan
    target_lrf[no_frame & ~on_source] = np.nan
    of_inliers = rng.beta(6.0, 1.4, n) if inlier_ratio < _FEW_INLIERS else rng.beta(4.0, 1.8, n)
    ratio = np.where(is_inlier, of_inliers, rng.beta(9.0, 1.2, n))
    ratio[rng.random(n) < missing_second] = 1.0
    similarity = np.where(is_inlier, rng.beta(5.0, 2.0, n), rng.beta(4.0, 3.0, n))
    similarity[rng.random(n) < zero_descriptors] = -np.inf

    far_source = offset * random_rotations(rng, 1)[0, 0]
    far_target = offset * random_rotations(rng, 1)[0, 0]
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = scale * (translation + far_target - rotation @ far_source)
    source, target = scale * (source + far_source), scale * (target + far_target)
    problem = MatchingProblem(
        source, target, ratio, similarity, source_lrf, target_lrf, resolution=scale,
        source_centroid=scale * far_source, inlier_mask=is_inlier, T_target_source=transform,
    )  # fmt: skip
    return judged(problem)


def random_rotations(rng: np.random.Generator, n: int) -> FloatArray:
    """Draw n uniform rotations (n,3,3) from random unit quaternions."""
    quaternion = rng.normal(size=(n, 4))
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    return turn(x, y, z, w)


def _directions(rng: np.random.Generator, n: int) -> FloatArray:
    vectors = rng.normal(size=(n, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _surface(directions: FloatArray, radius: float) -> FloatArray:
    """(n,3) points of the bumpy ellipsoid in the given directions (before its axes are stretched)."""
    x, y, z = directions.T
    bumps = 1.0 + 0.10 * np.sin(5.0 * x + 1.0) * np.cos(4.0 * y) + 0.08 * np.sin(7.0 * z)
    return directions * _AXES * (radius / _AXES.mean() * bumps)[:, None]


def _turned(rng: np.random.Generator, frames: FloatArray, degrees: float) -> FloatArray:
    """(n,3,3) frames, each rotated by the given angle about a random axis."""
    x, y, z = _directions(rng, len(frames)).T
    zero = np.zeros(len(frames))
    cross = np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), 2, 0)
    angle = np.radians(degrees)
    rotation = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return frames @ np.swapaxes(rotation, 1, 2)


def judged(problem: MatchingProblem) -> MatchingProblem:
    """Return the problem with a recomputed mask of correct matches."""
    errors = np.linalg.norm(apply(problem.T_target_source, problem.source) - problem.target, axis=1)
    return replace(problem, inlier_mask=errors <= CORRECT_WITHIN * problem.resolution)


def are_near(source: FloatArray, others: FloatArray, distance: float) -> BoolArray:
    """Mask (n,1) of the points that are within a distance of their partners."""
    return np.linalg.norm(others - source, axis=1, keepdims=True) <= distance
