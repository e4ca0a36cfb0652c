"""Random matching problems with a known answer: matches between a bumpy ellipsoid and its moved copy.

No clouds, detectors or descriptors are involved: points, frames, similarities and ratios are drawn directly,
so that problems of any size and share of inliers take no time. The tests and the comparison with other
libraries run on these; in Rust ``tests/common/mod.rs`` draws from the same distribution.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from cgroup.errors import InputError
from cgroup.rigid import turn
from cgroup.types import Correspondences

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cgroup.types import BoolArray, FloatArray

CORRECT_WITHIN = 5.0
"""pr. A match is correct where the true pose leaves no greater distance."""

_AXES = np.array([1.0, 0.7, 0.5])  # of the ellipsoid, in units of the longest
_DISTANCE = 50.0  # pr, standard deviation of the translation per axis
_FEW_INLIERS = 0.1  # share below which the ratios of inliers are nearly those of outliers


@dataclass(frozen=True, repr=False)
class MatchingProblem:
    """Matches between two sides, and which of them are right.

    Attributes
    ----------
    source, target : (n,3) ndarray of float64
        Matched points.
    ratio : (n,) ndarray of float64
        Distance to the nearest descriptor over that to the second nearest, 0 to 1.
    similarity : (n,) ndarray of float64
        Of the descriptors; -inf where there is none.
    source_lrf, target_lrf : (n,3,3) ndarray of float64
        Local reference frames, rows are axes; NaN where there is none.
    resolution : float
        Length of one pr, in the unit of the points.
    source_centroid : (3,) ndarray of float64
        Centre of the source's surface.
    inlier_mask : (n,) ndarray of bool
        Whether the true pose maps the source point to within `CORRECT_WITHIN` of its partner.
    T_target_source : (4,4) ndarray of float64
        The true pose.
    recipe : str
        What it was drawn from, for messages.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.datasets import make_problem
    >>> problem = make_problem(np.random.default_rng(0), 100, inlier_ratio=0.3)
    >>> problem
    MatchingProblem(n=100, inliers=30)
    >>> problem.source.shape, problem.source_lrf.shape
    ((100, 3), (100, 3, 3))
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
        """Tell how the problem was made, instead of all its numbers."""
        return f"MatchingProblem({self.recipe or f'n={len(self)}, inliers={int(self.inlier_mask.sum())}'})"

    def __len__(self) -> int:
        """Return the number of matches."""
        return len(self.source)

    def correspondences(self) -> Correspondences:
        """Return what a grouping method is given.

        Returns
        -------
        Correspondences
            With every field but candidates.

        Examples
        --------
        >>> import numpy as np
        >>> from cgroup import group
        >>> from cgroup.datasets import make_problem
        >>> problem = make_problem(np.random.default_rng(0), 100)
        >>> len(group(problem.correspondences(), "gtm").mask)
        100
        """
        return Correspondences(
            self.source,
            self.target,
            similarity=self.similarity,
            ratio=self.ratio,
            source_lrf=self.source_lrf,
            target_lrf=self.target_lrf,
            resolution=self.resolution,
            source_centroid=self.source_centroid,
        )

    def subset(self, rows: NDArray[np.intp]) -> MatchingProblem:
        """Return the problem with some of its matches.

        Parameters
        ----------
        rows : (m,) array of int
            Which, in the order that they are to have.

        Returns
        -------
        MatchingProblem
            Of m matches, with the same pose.

        Raises
        ------
        IndexError
            For a row that isn't there.

        Examples
        --------
        >>> import numpy as np
        >>> from cgroup.datasets import make_problem
        >>> problem = make_problem(np.random.default_rng(0), 100)
        >>> problem.subset(np.flatnonzero(problem.inlier_mask)).inlier_mask.all().item()
        True
        """
        return replace(
            self,
            source=self.source[rows],
            target=self.target[rows],
            ratio=self.ratio[rows],
            similarity=self.similarity[rows],
            source_lrf=self.source_lrf[rows],
            target_lrf=self.target_lrf[rows],
            inlier_mask=self.inlier_mask[rows],
        )

    def moved(self, source_motion: FloatArray, target_motion: FloatArray) -> MatchingProblem:
        """Return the problem after a rigid motion of each side, frames included.

        Parameters
        ----------
        source_motion, target_motion : (4,4) array of float64
            Rigid transforms.

        Returns
        -------
        MatchingProblem
            With the pose between the moved sides.

        Examples
        --------
        >>> import numpy as np
        >>> from cgroup.datasets import make_problem
        >>> problem = make_problem(np.random.default_rng(0), 100)
        >>> upwards = np.eye(4)
        >>> upwards[2, 3] = 7.0
        >>> moved = problem.moved(np.eye(4), upwards)
        >>> (moved.T_target_source - problem.T_target_source)[:3, 3].round(6)
        array([0., 0., 7.])
        """
        inverse = np.linalg.inv(source_motion)
        return replace(
            self,
            source=_move(source_motion, self.source),
            target=_move(target_motion, self.target),
            source_lrf=self.source_lrf @ source_motion[:3, :3].T,
            target_lrf=self.target_lrf @ target_motion[:3, :3].T,
            source_centroid=_move(source_motion, self.source_centroid[None])[0],
            T_target_source=target_motion @ self.T_target_source @ inverse,
        )

    def scaled(self, factor: float) -> MatchingProblem:
        """Return the problem in another unit of length.

        Parameters
        ----------
        factor : float
            New lengths over those of now.

        Returns
        -------
        MatchingProblem
            The same motion in the new unit.

        Examples
        --------
        >>> import numpy as np
        >>> from cgroup.datasets import make_problem
        >>> problem = make_problem(np.random.default_rng(0), 100)
        >>> problem.resolution, problem.scaled(0.001).resolution
        (1.0, 0.001)
        """
        transform = self.T_target_source.copy()
        transform[:3, 3] *= factor
        return replace(
            self,
            source=self.source * factor,
            target=self.target * factor,
            resolution=self.resolution * factor,
            source_centroid=self.source_centroid * factor,
            T_target_source=transform,
        )


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

    Source points are strewn over a bumpy ellipsoid. An inlier's partner is its image under a random rigid
    motion, plus noise; that of an outlier lies anywhere on the moved surface but where it would be right.
    Ratios and similarities are beta-distributed: better for inliers, with much overlap.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of all randomness: the same state and arguments give the same problem.
    n : int
        Number of matches.
    inlier_ratio : float
        Share of matches that the true motion makes. Below 0.1 their ratios are hardly better than others.
    noise : float
        Standard deviation per axis of the inliers' partners, in pr.
    repeated_targets : float
        Share of outliers that take the partner of another match.
    duplicated_sources : float
        Share of matches whose source point and frame are copied from another match.
    clutter : float
        Share of outliers that go anywhere in twice the target's bounding box.
    missing_frames, random_frames : float
        Share of matches with no frame on one side, and with an unrelated one on the target's.
    frame_error : float
        Angle in degrees by which the frames of inliers are off.
    zero_descriptors, missing_second : float
        Share of matches with similarity -inf, and with ratio 1 by convention.
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

    Raises
    ------
    InputError
        If `n` is negative, or a share is not between 0 and 1.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.datasets import make_problem
    >>> problem = make_problem(np.random.default_rng(0), 1000, inlier_ratio=0.1)
    >>> problem
    MatchingProblem(n=1000, inliers=98)
    """
    _check(
        n,
        inlier_ratio=inlier_ratio,
        repeated_targets=repeated_targets,
        duplicated_sources=duplicated_sources,
        clutter=clutter,
        missing_frames=missing_frames,
        random_frames=random_frames,
        zero_descriptors=zero_descriptors,
        missing_second=missing_second,
    )
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
    elsewhere = _away_from(source, _directions(rng, n), radius) @ rotation.T + translation
    target[~is_inlier] = elsewhere[~is_inlier]
    unrelated = ~is_inlier | (rng.random(n) < random_frames)
    target_lrf[unrelated] = random_rotations(rng, n)[unrelated]

    kind = rng.random(n)
    _scatter(rng, target, translation, ~is_inlier & (kind < clutter))
    _repeat(rng, target, target_lrf, ~is_inlier & (kind >= 1.0 - repeated_targets))
    _drop_frames(rng, source_lrf, target_lrf, missing_frames)
    ratio = _ratios(rng, is_inlier, indistinct=inlier_ratio < _FEW_INLIERS)
    ratio[rng.random(n) < missing_second] = 1.0
    similarity = np.where(is_inlier, rng.beta(5.0, 2.0, n), rng.beta(4.0, 3.0, n))
    similarity[rng.random(n) < zero_descriptors] = -np.inf

    far_source = offset * random_rotations(rng, 1)[0, 0]
    far_target = offset * random_rotations(rng, 1)[0, 0]
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = scale * (translation + far_target - rotation @ far_source)
    source, target = scale * (source + far_source), scale * (target + far_target)
    error = np.linalg.norm(_move(transform, source) - target, axis=1)
    return MatchingProblem(
        source=source,
        target=target,
        ratio=ratio,
        similarity=similarity,
        source_lrf=source_lrf,
        target_lrf=target_lrf,
        resolution=scale,
        source_centroid=scale * far_source,
        inlier_mask=error <= CORRECT_WITHIN * scale,
        T_target_source=transform,
    )


def random_rotations(rng: np.random.Generator, n: int) -> FloatArray:
    """Draw n rotations (n,3,3), all alike: from random unit quaternions."""
    quaternion = rng.normal(size=(n, 4))
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    return turn(x, y, z, w)


def _check(n: int, **shares: float) -> None:
    if n < 0:
        raise InputError("n", n, "give a number of matches, 0 or more")
    for name, share in shares.items():
        if not 0.0 <= share <= 1.0:
            raise InputError(name, share, "give a share from 0 to 1")


def _directions(rng: np.random.Generator, n: int) -> FloatArray:
    vectors = rng.normal(size=(n, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _surface(directions: FloatArray, radius: float) -> FloatArray:
    """(n,3) points of the bumpy ellipsoid in the given directions (before its axes are stretched)."""
    x, y, z = directions.T
    bumps = 1.0 + 0.10 * np.sin(5.0 * x + 1.0) * np.cos(4.0 * y) + 0.08 * np.sin(7.0 * z)
    return directions * _AXES * (radius / _AXES.mean() * bumps)[:, None]


def _away_from(source: FloatArray, directions: FloatArray, radius: float) -> FloatArray:
    """(n,3) points of the surface; those that would be right by accident go to the opposite side."""
    near = np.linalg.norm(_surface(directions, radius) - source, axis=1) <= CORRECT_WITHIN
    return _surface(np.where(near[:, None], -directions, directions), radius)


def _turned(rng: np.random.Generator, frames: FloatArray, degrees: float) -> FloatArray:
    """(n,3,3) frames, each turned by the given angle about a random axis."""
    x, y, z = _directions(rng, len(frames)).T
    zero = np.zeros(len(frames))
    cross = np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), 2, 0)
    angle = np.radians(degrees)
    rotation = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return frames @ np.swapaxes(rotation, 1, 2)


def _scatter(rng: np.random.Generator, target: FloatArray, center: FloatArray, rows: BoolArray) -> None:
    """Move points anywhere in twice the target's bounding box."""
    box = 2.0 * np.ptp(target, axis=0) if len(target) else np.zeros(3)
    anywhere = center + (rng.random(target.shape) - 0.5) * box
    target[rows] = anywhere[rows]


def _repeat(rng: np.random.Generator, target: FloatArray, target_lrf: FloatArray, rows: BoolArray) -> None:
    """Give matches the partner of another match."""
    partners = rng.integers(0, max(len(target), 1), size=int(rows.sum()))
    target[rows], target_lrf[rows] = target[partners], target_lrf[partners]


def _drop_frames(
    rng: np.random.Generator, source_lrf: FloatArray, target_lrf: FloatArray, share: float
) -> None:
    """Take the frame of either side from a share of the matches."""
    no_frame = rng.random(len(source_lrf)) < share
    on_source = rng.random(len(source_lrf)) < 0.5
    source_lrf[no_frame & on_source] = np.nan
    target_lrf[no_frame & ~on_source] = np.nan


def _ratios(rng: np.random.Generator, is_inlier: BoolArray, *, indistinct: bool) -> FloatArray:
    n = len(is_inlier)
    of_inliers = rng.beta(6.0, 1.4, n) if indistinct else rng.beta(4.0, 1.8, n)
    return np.where(is_inlier, of_inliers, rng.beta(9.0, 1.2, n))


def _move(transform: FloatArray, points: FloatArray) -> FloatArray:
    """(n,3) points after the rigid motion (4,4)."""
    return points @ transform[:3, :3].T + transform[:3, 3]
