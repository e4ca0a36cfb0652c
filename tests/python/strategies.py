"""Matching problems for the tests: a bumpy ellipsoid seen twice.

Lengths are multiples of the resolution
(1 unit before `scale`). `make_problem` is an ordinary function of a generator and plain
parameters; `problems` lets Hypothesis draw these, so that a failure shrinks towards few
correspondences, no noise and no nuisances.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

MEAN_RADIUS = 100.0
AXES = np.array([1.0, 0.7, 0.5])
CORRECT = 5.0


@dataclass(frozen=True, repr=False)
class Problem:
    """One matching problem; the arrays are what the grouping methods take."""

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
        """Return how the problem was made instead of all its numbers."""
        return f"Problem({self.recipe or len(self)})"

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:  # noqa: ARG002
        """Print the same in Hypothesis' reports."""
        printer.text(repr(self))

    def __len__(self) -> int:
        """Return the number of correspondences."""
        return len(self.source)

    def subset(self, rows: NDArray[np.intp]) -> Problem:
        """Return the problem with the given rows, in the given order."""
        arrays = {name: getattr(self, name)[rows] for name in PER_ROW}
        return replace(self, **arrays)

    def moved(self, source_motion: FloatArray, target_motion: FloatArray) -> Problem:
        """Return the problem after a rigid motion (4,4) per side, frames included."""
        inverse = np.linalg.inv(source_motion)
        return replace(
            self,
            source=move(source_motion, self.source),
            target=move(target_motion, self.target),
            source_lrf=self.source_lrf @ source_motion[:3, :3].T,
            target_lrf=self.target_lrf @ target_motion[:3, :3].T,
            source_centroid=move(source_motion, self.source_centroid[None])[0],
            T_target_source=target_motion @ self.T_target_source @ inverse,
        )

    def scaled(self, factor: float) -> Problem:
        """Return the problem in another unit of length."""
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


PER_ROW = (
    "source",
    "target",
    "ratio",
    "similarity",
    "source_lrf",
    "target_lrf",
    "inlier_mask",
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
    scale: float = 1.0,
    offset: float = 0.0,
) -> Problem:
    """Draw a matching problem.

    Parameters
    ----------
    rng
        Source of all randomness.
    n
        Number of correspondences.
    inlier_ratio
        Share of correspondences that are made by the true motion.
    noise
        Standard deviation per axis of the inliers' target points, in pr.
    repeated_targets
        Share of outliers that take the target point of another correspondence.
    duplicated_sources
        Share of rows whose source point is copied from another row.
    clutter
        Share of outliers that go anywhere in twice the target's bounding box.
    missing_frames, random_frames
        Share of correspondences without frame, and with an unrelated one.
    frame_error
        Angle in degrees by which the inliers' target frames are off.
    zero_descriptors, missing_second
        Share of rows with similarity -inf, and with ratio 1 by convention.
    scale
        Length of one pr.
    offset
        Distance of both clouds from the origin, in pr.
    """
    source = surface_points(rng, n)
    rotation, translation = random_rotations(rng, 1)[0], rng.normal(size=3) * 50.0
    is_inlier = rng.permutation(n) < round(inlier_ratio * n)

    copies = np.flatnonzero(rng.random(n) < duplicated_sources)
    originals = rng.integers(0, max(n, 1), size=len(copies))
    source[copies] = source[originals]
    source_lrf = random_rotations(rng, n)
    source_lrf[copies] = source_lrf[originals]

    exact = source @ rotation.T + translation
    target = exact + rng.normal(size=(n, 3)) * noise
    target_lrf = turned(rng, source_lrf @ rotation.T, frame_error)
    elsewhere = surface_points(rng, n) @ rotation.T + translation
    target[~is_inlier] = elsewhere[~is_inlier]
    unrelated = ~is_inlier | (rng.random(n) < random_frames)
    target_lrf[unrelated] = random_rotations(rng, n)[unrelated]

    kind = rng.random(n)
    cluttered = ~is_inlier & (kind < clutter)
    box = 2.0 * np.ptp(target, axis=0) if n else np.zeros(3)
    anywhere = translation + (rng.random((n, 3)) - 0.5) * box
    target[cluttered] = anywhere[cluttered]
    repeated = np.flatnonzero(~is_inlier & (kind >= 1.0 - repeated_targets))
    partners = rng.integers(0, max(n, 1), size=len(repeated))
    target[repeated], target_lrf[repeated] = target[partners], target_lrf[partners]

    no_frame = rng.random(n) < missing_frames
    on_source = rng.random(n) < 0.5
    source_lrf[no_frame & on_source] = np.nan
    target_lrf[no_frame & ~on_source] = np.nan

    indistinct = rng.beta(6.0, 1.4, n) if inlier_ratio < 0.1 else rng.beta(4.0, 1.8, n)
    ratio = np.where(is_inlier, indistinct, rng.beta(9.0, 1.2, n))
    ratio[rng.random(n) < missing_second] = 1.0
    similar = np.where(is_inlier, rng.beta(5.0, 2.0, n), rng.beta(4.0, 3.0, n))
    similarity = np.where(rng.random(n) < zero_descriptors, -np.inf, similar)

    far_source = offset * random_rotations(rng, 1)[0, 0]
    far_target = offset * random_rotations(rng, 1)[0, 0]
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = scale * (translation + far_target - rotation @ far_source)
    source, target = scale * (source + far_source), scale * (target + far_target)
    error = np.linalg.norm(move(transform, source) - target, axis=1)
    return Problem(
        source=source,
        target=target,
        ratio=ratio,
        similarity=similarity,
        source_lrf=source_lrf,
        target_lrf=target_lrf,
        resolution=scale,
        source_centroid=scale * far_source,
        inlier_mask=error <= CORRECT * scale,
        T_target_source=transform,
    )


@st.composite
def problems(draw: st.DrawFn, *, min_size: int = 0, max_size: int = 150, nuisances: bool = True) -> Problem:
    """Draw matching problems of `min_size` to `max_size` correspondences.

    Without `nuisances` there are neither duplicates nor missing frames, zero
    descriptors, far origins or unusual units.
    """
    n = draw(st.integers(min_size, max_size), label="n")
    seed = draw(st.integers(0, 2**32 - 1), label="seed")
    options: dict[str, float] = {
        "inlier_ratio": draw(shares(0.0, 1.0), label="inlier ratio"),
        "noise": draw(st.sampled_from([0.0, 0.5, 1.5, 3.0]), label="noise"),
        "frame_error": draw(st.sampled_from([0.0, 3.0, 8.0, 20.0]), label="frame error"),
        "random_frames": draw(st.sampled_from([0.0, 0.3, 0.5]), label="random frames"),
        "clutter": draw(shares(0.0, 0.7), label="clutter"),
        "repeated_targets": 0.0,
    }
    if nuisances:
        options |= {
            "repeated_targets": draw(shares(0.0, 0.3), label="repeated targets"),
            "duplicated_sources": draw(shares(0.0, 0.2), label="duplicated sources"),
            "missing_frames": draw(shares(0.0, 0.5), label="missing frames"),
            "zero_descriptors": draw(shares(0.0, 0.2), label="zero descriptors"),
            "missing_second": draw(shares(0.0, 0.2), label="missing second"),
            "scale": 10.0 ** draw(st.integers(-3, 3), label="log10 scale"),
            "offset": draw(st.sampled_from([0.0, 1e2, 1e4, 1e6]), label="offset"),
        }
    problem = make_problem(np.random.default_rng(seed), n, **options)
    arguments = ", ".join(f"{name}={value:g}" for name, value in options.items())
    return replace(problem, recipe=f"n={n}, seed={seed}, {arguments}")


def shares(low: float, high: float) -> st.SearchStrategy[float]:
    """Return a strategy for a share in steps of 1/20 of the range; shrinks to `low`."""
    return st.integers(0, 20).map(lambda k: low + (high - low) * k / 20)


def surface_points(rng: np.random.Generator, n: int) -> FloatArray:
    """(n,3) points on the bumpy ellipsoid, mean radius about 100."""
    direction = rng.normal(size=(n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    x, y, z = direction.T
    bumps = 1.0 + 0.10 * np.sin(5.0 * x + 1.0) * np.cos(4.0 * y) + 0.08 * np.sin(7.0 * z)
    radius = MEAN_RADIUS / AXES.mean() * bumps
    return direction * AXES * radius[:, None]


def random_rotations(rng: np.random.Generator, n: int) -> FloatArray:
    """(n,3,3) uniformly distributed rotations, from unit quaternions."""
    quaternion = rng.normal(size=(n, 4))
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def turned(rng: np.random.Generator, frames: FloatArray, degrees: float) -> FloatArray:
    """(n,3,3) frames, each turned by the given angle about a random axis."""
    axis = rng.normal(size=(len(frames), 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    x, y, z = axis.T
    zero = np.zeros(len(frames))
    cross = np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), 2, 0)
    angle = np.radians(degrees)
    rotation = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return frames @ np.swapaxes(rotation, 1, 2)


def random_motion(rng: np.random.Generator, distance: float) -> FloatArray:
    """(4,4) random rigid motion with a translation of about `distance`."""
    motion = np.eye(4)
    motion[:3, :3] = random_rotations(rng, 1)[0]
    motion[:3, 3] = rng.normal(size=3) * distance
    return motion


def move(transform: FloatArray, points: FloatArray) -> FloatArray:
    """(n,3) points after the rigid motion (4,4)."""
    return points @ transform[:3, :3].T + transform[:3, 3]
