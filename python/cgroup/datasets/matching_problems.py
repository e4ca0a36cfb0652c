"""Random matching problems with a known answer: matches between a bumpy ellipsoid and its moved copy.

No clouds, detectors or descriptors are involved: points, frames, similarities and ratios are drawn directly,
so that problems of any size and share of inliers take no time. The tests and the comparison with other
libraries run on these; in Rust ``tests/common/mod.rs`` draws from the same distribution. `SCENES` change what
the wrong matches of a problem do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cgroup.errors import InputError
from cgroup.rigid import apply
from cgroup.rigid.transforms import turn
from cgroup.types import BoolArray, Correspondences, FloatArray

CORRECT_WITHIN = 5.0
"""pr. A match is correct where the true pose leaves no greater distance."""

RIVALS = 0.8
"""Matches that follow a rival of the true motion, per match that follows the true one."""

ROOM = 150.0
"""pr. Edge length of the walls in `planes`."""

FRAMES = {
    "good": {"frame_error": 8.0, "random_frames": 0.1},
    "bad": {"frame_error": 30.0, "random_frames": 0.7},
    "none": {},
}
"""Arguments of `make_problem` by the quality of the frames; ``none`` leaves the frames out."""

_AXES = np.array([1.0, 0.7, 0.5])  # of the ellipsoid, in units of the longest
_DISTANCE = 50.0  # pr, standard deviation of the translation per axis
_FEW_INLIERS = 0.1  # share below which the ratios of inliers are nearly those of outliers
_CANDIDATES = 3  # of each source point, in one-to-three problems


@dataclass(frozen=True, repr=False)
class MatchingProblem:
    """Matches between two sides, and which of them are right.

    Attributes
    ----------
    source, target : (n,3) ndarray of float64
        Matched points.
    ratio, similarity : (n,) ndarray of float64
        Of the descriptors: nearest over second nearest distance, 0 to 1; and -inf where there is none.
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
    >>> make_problem(np.random.default_rng(0), 1000, inlier_ratio=0.1)
    MatchingProblem(n=1000, inliers=98)
    """
    shares = {
        "inlier_ratio": inlier_ratio,
        "repeated_targets": repeated_targets,
        "duplicated_sources": duplicated_sources,
        "clutter": clutter,
        "missing_frames": missing_frames,
        "random_frames": random_frames,
        "zero_descriptors": zero_descriptors,
        "missing_second": missing_second,
    }
    if n < 0:
        raise InputError("n", n, "give a number of matches, 0 or more")
    for name, share in shares.items():
        if not 0.0 <= share <= 1.0:
            raise InputError(name, share, "give a share from 0 to 1")
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
    near = _are_near(source, _surface(directions, radius), CORRECT_WITHIN)  # these would be right by accident
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
        source=source,
        target=target,
        ratio=ratio,
        similarity=similarity,
        source_lrf=source_lrf,
        target_lrf=target_lrf,
        resolution=scale,
        source_centroid=scale * far_source,
        inlier_mask=is_inlier,
        T_target_source=transform,
    )
    return _judged(problem)


def make_scene(
    rng: np.random.Generator, n: int, *, inliers: float, noise: float, scene: str, frames: str
) -> MatchingProblem:
    """Draw a matching problem that is hard in one way.

    Parameters
    ----------
    rng : numpy.random.Generator
        The only source of randomness.
    n : int
        Number of matches; up to two more in ``one-to-three``.
    inliers, noise : float
        Share of right ones, and their standard deviation per axis in pr.
    scene : {"uniform", "second-pose", "planes", "mirror", "one-to-three"}
        What wrong matches do: lie anywhere; follow a second motion, 0.8 for each right one; lie, as all
        points, on a few walls; follow a mirrored motion; or share their source point, three by three.
    frames : {"good", "bad", "none"}
        Whether local reference frames are off by 8 degrees and 10 % unrelated, or by 30 degrees and 70 %;
        with "none" they are all missing (NaN).

    Returns
    -------
    MatchingProblem
        Its arrays are the caller's own.

    Raises
    ------
    InputError
        If a name is unknown, or a share can't be had: at most a third of one-to-three matches is right.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.datasets import make_scene
    >>> kind = {"scene": "one-to-three", "frames": "good"}
    >>> problem = make_scene(
    ...     np.random.default_rng(0), 300, inliers=0.1, noise=1.0, **kind
    ... )
    >>> len(problem), len(np.unique(problem.source, axis=0))
    (300, 100)
    """
    for name, given, known in (("scene", scene, SCENES), ("frames", frames, FRAMES)):
        if given not in known:
            raise InputError(name, f"{given!r}", f"choose one of {', '.join(known)}")
    share = _CANDIDATES * inliers if scene == "one-to-three" else inliers
    if share > 1:
        raise InputError("inliers", inliers, "of one-to-three matches at most a third is right")
    problem = make_problem(rng, n, inlier_ratio=share, noise=noise, **FRAMES[frames])
    made = SCENES[scene](rng, problem)
    if frames == "none":
        missing = np.full_like(made.source_lrf, np.nan)
        made = replace(made, source_lrf=missing, target_lrf=missing.copy())
    return replace(made, recipe=f"{scene}, n={n}, inliers={inliers}, noise={noise}, frames={frames}")


def planes(rng: np.random.Generator, problem: MatchingProblem) -> MatchingProblem:
    """Put all points on a floor and two walls, where many wrong matches agree with each other by chance.

    Right matches keep their noise.
    """
    scale, right = problem.resolution, problem.inlier_mask
    source = _on_walls(rng, len(problem)) * scale
    noise = problem.target - apply(problem.T_target_source, problem.source)
    others = _on_walls(rng, len(problem)) * scale
    near = _are_near(source, others, CORRECT_WITHIN * scale)  # these would be right by accident
    partners = np.where(near, np.roll(others, 1, axis=0), others)
    target = apply(problem.T_target_source, np.where(right[:, None], source, partners))
    target[right] += noise[right]
    centroid = source.mean(axis=0) if len(source) else problem.source_centroid
    return _judged(replace(problem, source=source, target=target, source_centroid=centroid))


def one_to_three(rng: np.random.Generator, problem: MatchingProblem) -> MatchingProblem:
    """Give every source point three partners in a row, at most one of them right.

    Two thirds of the matches are new ones, so that their share of right ones falls to a third; a problem of
    as many matches as before is returned, or one or two more.
    """
    kept = rng.permutation(len(problem))[: -(-len(problem) // _CANDIDATES)]
    groups = np.repeat(kept, _CANDIDATES)
    # The first of each three stays; the partners of the others are those of other matches.
    partners = rng.integers(0, max(len(problem), 1), size=len(groups))
    partners[::_CANDIDATES] = kept
    first = np.arange(len(groups)) % _CANDIDATES == 0
    rows = problem.subset(groups)
    unlike = rng.beta(9.0, 1.2, len(groups))
    tripled = replace(
        rows,
        target=problem.target[partners],
        target_lrf=problem.target_lrf[partners],
        ratio=np.where(first, rows.ratio, np.maximum(rows.ratio, unlike)),
        similarity=np.where(first, rows.similarity, rng.beta(4.0, 3.0, len(groups))),
    )
    order = np.argsort(rng.random((len(kept), _CANDIDATES)), axis=1)  # within each three
    return _judged(tripled.subset((order + _CANDIDATES * np.arange(len(order))[:, None]).ravel()))


SCENES: dict[str, Callable[[np.random.Generator, MatchingProblem], MatchingProblem]] = {
    "uniform": lambda _, problem: problem,
    "second-pose": lambda rng, problem: _rival(rng, problem, (1.0, 1.0, 1.0)),
    "planes": planes,
    "mirror": lambda rng, problem: _rival(rng, problem, (-1.0, 1.0, 1.0)),
    "one-to-three": one_to_three,
}
"""What wrong matches are like, by name."""


def random_rotations(rng: np.random.Generator, n: int) -> FloatArray:
    """Draw n rotations (n,3,3), all alike: from random unit quaternions."""
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


def _rival(
    rng: np.random.Generator, problem: MatchingProblem, flip: tuple[float, float, float]
) -> MatchingProblem:
    """Let wrong matches follow another motion, `RIVALS` for each right one, beside the true image.

    Mirrored ones keep all distances, but no rigid motion explains them.
    """
    rotation = random_rotations(rng, 1)[0]
    moved = (problem.source * np.array(flip)) @ rotation.T
    wrong = np.flatnonzero(~problem.inlier_mask)
    wanted = round(RIVALS * np.count_nonzero(problem.inlier_mask))
    chosen = rng.permutation(wrong)[:wanted]
    right = problem.inlier_mask
    noise = problem.target[right] - apply(problem.T_target_source, problem.source[right])
    spread = float(noise.std()) if len(noise) else 0.0
    target, frames = problem.target.copy(), problem.target_lrf.copy()
    center = apply(problem.T_target_source, problem.source).mean(axis=0) if len(target) else np.zeros(3)
    shift = center - moved.mean(axis=0) if len(moved) else center
    target[chosen] = moved[chosen] + shift + rng.normal(scale=spread, size=(len(chosen), 3))
    frames[chosen] = problem.source_lrf[chosen] @ rotation.T
    return _judged(replace(problem, target=target, target_lrf=frames))


def _judged(problem: MatchingProblem) -> MatchingProblem:
    """Recompute the mask of right matches."""
    errors = np.linalg.norm(apply(problem.T_target_source, problem.source) - problem.target, axis=1)
    return replace(problem, inlier_mask=errors <= CORRECT_WITHIN * problem.resolution)


def _on_walls(rng: np.random.Generator, n: int) -> FloatArray:
    """Draw (n,3) points on three faces of a cube that meet in a corner, in pr."""
    points = rng.random((n, 3)) * ROOM
    points[np.arange(n), rng.integers(0, 3, size=n)] = 0.0
    return points


def _are_near(source: FloatArray, others: FloatArray, distance: float) -> BoolArray:
    return np.linalg.norm(others - source, axis=1, keepdims=True) <= distance
