"""Hypothesis' way to draw matching problems: a failure shrinks towards few matches, no noise, no nuisances."""

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from cgroup.datasets.matching_problems import MatchingProblem as Problem
from cgroup.datasets.matching_problems import make_problem, random_rotations

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


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


def hard_problem(n: int) -> Problem:
    """Return a problem with every nuisance, always the same."""
    return make_problem(
        np.random.default_rng(6),
        n,
        inlier_ratio=0.4,
        noise=1.5,
        repeated_targets=0.5,
        duplicated_sources=0.2,
        missing_frames=0.1,
        zero_descriptors=0.05,
    )


def shares(low: float, high: float) -> st.SearchStrategy[float]:
    """Return a strategy for a share in steps of 1/20 of the range; shrinks to `low`."""
    return st.integers(0, 20).map(lambda k: low + (high - low) * k / 20)


def random_motion(rng: np.random.Generator, distance: float) -> FloatArray:
    """(4,4) random rigid motion with a translation of about `distance`."""
    motion = np.eye(4)
    motion[:3, :3] = random_rotations(rng, 1)[0]
    motion[:3, 3] = rng.normal(size=3) * distance
    return motion


def rigid(axis: ArrayLike, degrees: float, shift: ArrayLike = (0, 0, 0)) -> FloatArray:
    """(4,4) turn about an axis, by Rodrigues' formula, and a shift."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross, angle = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]), np.radians(degrees)
    motion = np.eye(4)
    motion[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    motion[:3, 3] = shift
    return motion
