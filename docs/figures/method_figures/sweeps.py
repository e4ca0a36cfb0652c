"""Options, values and data of the measurements of options."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cgroup.datasets import make_problem, standin_pair
from cgroup.evaluation import correct_matches
from cgroup.registration import correspond
from cgroup.registry import find_method

if TYPE_CHECKING:
    from cgroup.types import BoolArray, Correspondences

VIEWS, DRAWN, SPARSE = "views", "drawn", "sparse"
DATA = {
    VIEWS: "Two views of a shape, SHOT at Harris keypoints: 6 to 13 % of 320 to 442 correct (six pairs)",
    DRAWN: "Generated matches: 5 % of 1,000 correct (six problems)",
    SPARSE: "Generated matches: 1 % of 1,000 correct (twelve problems)",
}
"""Data of the measurements, with captions."""

_PROBLEMS = {VIEWS: 6, DRAWN: 6, SPARSE: 12}
_SHARES = {DRAWN: 0.05, SPARSE: 0.01}
_CORRECT_WITHIN = 5.0  # pr


@dataclass(frozen=True)
class Sweep:
    """Levels of one option; those in pr are multiplied by the resolution of the matches.

    `base` are further options of each call. With `fields`, each value names an
    input, and maps to the fields of the matches that are omitted.
    """

    method: str
    option: str
    levels: tuple[Any, ...]
    default: Any
    unit: str = ""
    base: dict[str, Any] = field(default_factory=dict)
    fields: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def data(self) -> tuple[str, str]:
        """What it is tried on: sparse matches for modern methods, which make hardly a mistake on others."""
        return (VIEWS, DRAWN if find_method(self.method).in_paper else SPARSE)

    @property
    def ordered(self) -> bool:
        """Whether the values follow each other, so that a line may connect them."""
        return any(isinstance(value, int | float) and not isinstance(value, bool) for value in self.levels)

    def options(self, value: Any, resolution: float) -> dict[str, Any]:  # noqa: ANN401 - of any option
        """Return the options of a call."""
        if self.fields:
            return {}
        given = {**self.base, self.option: value}
        if self.unit == "pr":
            given[self.option] = value * resolution
        return given

    def given(self, value: str, matches: Correspondences) -> Correspondences:
        """Return the matches without the fields that the value leaves out."""
        return replace(matches, **dict.fromkeys(self.fields.get(value, ())))


class TrialProblem(NamedTuple):
    """Matches and a mask of the correct ones."""

    matches: Correspondences
    correct: BoolArray


@cache
def problems(data: str) -> list[TrialProblem]:
    """Make the problems of one kind."""
    make = _view if data == VIEWS else partial(_drawn, _SHARES[data])
    return [make(seed) for seed in range(_PROBLEMS[data])]


def _view(seed: int) -> TrialProblem:
    pair = standin_pair(seed=seed)
    matches = correspond(pair.source, pair.target)
    tolerance = _CORRECT_WITHIN * float(matches.resolution or 1.0)
    return TrialProblem(
        matches, correct_matches(matches.source, matches.target, pair.T_target_source, tolerance=tolerance)
    )


def _drawn(share: float, seed: int) -> TrialProblem:
    problem = make_problem(np.random.default_rng(seed), 1000, inlier_ratio=share)
    return TrialProblem(problem.correspondences(), problem.inlier_mask)


_TOLERANCES = (1, 2, 3, 5, 8, 12)
_FRAMES = ("source_lrf", "target_lrf")

SWEEPS = (
    Sweep("ss", "threshold", ("otsu", 0.3, 0.4, 0.5, 0.6, 0.7), "otsu"),
    Sweep("ss", "otsu", ("minmax", "exact", "covis", "legacy"), "minmax"),
    Sweep("ss", "bins", (5, 10, 30, 100, 300, 1000), 100),
    Sweep("nnsr", "max_ratio", (0.2, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 1.0), 0.8),
    Sweep("si", "tolerance", _TOLERANCES, 5, "pr"),
    Sweep("si", "neighbors", (10, 30, 100, 250, 500, 1000), 250),
    Sweep("si", "min_distance_ratio", (0.5, 0.7, 0.8, 0.9, 0.95, 0.98), 0.9),
    Sweep("cv", "distance_scale", (2, 5, 10, 20, 40), 10, "pr"),
    Sweep("cv", "angle_scale", (2, 5, 10, 20, 45), 10, "degrees"),
    Sweep("cv", "voters", (10, 50, 100, 200, 400, 1000), 200),
    Sweep("ransac", "tolerance", _TOLERANCES, 5, "pr"),
    Sweep("ransac", "iterations", (100, 1000, 10_000, 100_000, 1_000_000), 10_000),
    Sweep("ransac", "edge_ratio", (None, 0.5, 0.8, 0.9, 0.95), None),
    Sweep("st", "min_distance_ratio", (0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95), 0.6),
    Sweep("st", "affinity", ("raw", "threshold", "binary"), "raw"),
    Sweep("st", "conflict", ("rigidity", "one_to_one", "both"), "rigidity"),
    Sweep("gc", "tolerance", (0.5, 1, 2, 3, 5, 8), 3, "pr"),
    Sweep("gc", "variant", ("star", "clique"), "star"),
    Sweep("gc", "ties", ("lowest", "union"), "lowest"),
    Sweep("hough3d", "bins", (5, 8, 11, 15, 20, 30), 15),
    Sweep("hough3d", "neighbors", (0, 6, 26), 6),
    Sweep("hough3d", "bin_size", (2, 5, 10, 20, 40), None, "pr"),
    Sweep("gtm", "iterations", (10, 30, 100, 300, 1000), 100),
    Sweep("gtm", "tolerance", _TOLERANCES, None, "pr", base={"payoff": "distance_difference"}),
    Sweep("gtm", "threshold", ("otsu", 1e-4, 1e-3, 1e-2), "otsu"),
    Sweep("lc", "tolerance", (1, 2, 3, 5, 8), 3, "pr"),
    Sweep("lc", "modes", (1, 3, 10, 40, 100), 40),
    Sweep(
        "lc",
        "input",
        ("points", "+ ratio", "+ frames"),
        "+ frames",
        fields={"points": ("ratio", *_FRAMES), "+ ratio": _FRAMES, "+ frames": ()},
    ),
    Sweep("mac", "tolerance", _TOLERANCES, 5, "pr"),
    Sweep("mac", "max_distance_difference", (0.25, 0.5, 1, 2, 3), 1, "pr"),
    Sweep("mac", "max_hypotheses", (1, 10, 100, 1000), None),
    Sweep("sc2pcr", "max_distance_difference", _TOLERANCES, 5, "pr"),
    Sweep("sc2pcr", "seed_ratio", (0.01, 0.05, 0.1, 0.2, 0.5, 1.0), 0.2),
    Sweep("sc2pcr", "k1", (5, 10, 20, 30, 60), 30),
    Sweep("turboreg", "max_distance_difference", (0.15, 0.3, 0.6, 1.2, 2.5, 5), 0.6, "pr"),
    Sweep("turboreg", "pivots", (1, 10, 100, 2000, 10_000), 2000),
    Sweep("turboreg", "choice", ("inliers", "mae", "mse"), "inliers"),
    Sweep("teaser", "tolerance", (0.5, 1, 2.5, 5, 8), 2.5, "pr"),
    Sweep("teaser", "max_distance_difference", (1, 2, 3, 5, 8), 5, "pr"),
    Sweep("teaser", "prune", ("clique", "core"), "clique"),
    Sweep("clipper", "max_distance_difference", _TOLERANCES, 5, "pr"),
    Sweep("clipper", "deviation", (0.5, 1, 1.67, 3, 5), 1.67, "pr"),
    Sweep("clipper", "variant", ("densest", "maximum"), "densest"),
)
"""What is tried, by the function's name."""

_BESIDE = {
    "ss": ("nnsr", "gtm", "lc"),
    "nnsr": ("ss", "gtm", "lc"),
    "si": ("cv", "hough3d", "lc"),
    "cv": ("si", "hough3d", "lc"),
    "ransac": ("gtm", "turboreg", "lc"),
    "st": ("gtm", "gc", "lc"),
    "gc": ("st", "clipper", "lc"),
    "hough3d": ("cv", "ransac", "lc"),
    "gtm": ("st", "ransac", "lc"),
    "lc": ("mac", "sc2pcr", "ransac"),
    "mac": ("sc2pcr", "lc", "ransac"),
    "sc2pcr": ("mac", "lc", "gtm"),
    "turboreg": ("sc2pcr", "lc", "ransac"),
    "teaser": ("clipper", "mac", "lc"),
    "clipper": ("teaser", "gc", "lc"),
}
_BESIDE_OTHERS = ("lc", "ransac", "gtm")


def beside(function: str) -> tuple[str, ...]:
    """Return the functions that a method is shown beside."""
    return _BESIDE.get(function, _BESIDE_OTHERS)
