"""Trials of every grouping method: an option must change the result, and agree with the reference."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import cgroup
from reference.clipper import clipper
from reference.consistency_voting import cv
from reference.game_theory import gtm
from reference.geometric_consistency import gc
from reference.hough_voting import hough3d
from reference.likelihood_consensus import lc
from reference.mac import mac
from reference.nearest_neighbor_ratio import nnsr
from reference.ransac import ransac
from reference.result import ReferenceGrouping
from reference.sc2pcr import sc2pcr
from reference.search_of_inliers import si
from reference.similarity_score import ss
from reference.spectral import st
from reference.teaser import teaser
from reference.turboreg import turboreg
from strategies import FloatArray, Problem

Options = dict[str, Any]


@dataclass(frozen=True)
class Pr:
    """A length as a multiple of the problem's resolution."""

    multiple: float

    def __repr__(self) -> str:
        return f"{self.multiple:g}pr"

    def of(self, problem: Problem) -> float:
        return self.multiple * problem.resolution


@dataclass(frozen=True)
class Field:
    """A field of the problem, or what a function makes of it."""

    name: str
    change: Callable[[FloatArray], FloatArray] | None = None

    def __repr__(self) -> str:
        return self.name if self.change is None else f"{self.change.__name__}({self.name})"

    def of(self, problem: Problem) -> Any:
        value = getattr(problem, self.name)
        return value if self.change is None else self.change(value)


def backwards(values: FloatArray) -> FloatArray:
    return values[::-1].copy()


def rolled(values: FloatArray) -> FloatArray:
    return np.roll(values, 1, axis=0)


def far_away(point: FloatArray) -> FloatArray:
    """Return another point, whatever is given."""
    return np.array([200.0, 0.0, 0.0]) + 0.0 * point


@dataclass(frozen=True)
class Trial:
    """A `change` of the `base` options.

    Where it `shows`, it must change the result in test_options_are_wired.py. It is `compared` with the reference
    unless the exact answer depends on rounding for too many rows.
    """

    change: Options
    base: Options = field(default_factory=dict)
    shows: bool = True
    compared: bool = True

    @property
    def options(self) -> Options:
        return self.base | self.change


@dataclass(frozen=True)
class MethodCase:
    """How a method is called, its trials, and the kind of its `Grouping.rule` with its bound.

    `fields` are passed by name unless an option of the same name says otherwise. `field_trials` exchange a field.
    `score_tolerance` is the largest difference of a score from the reference's, relative to the greatest score;
    the second is that of problems so large that GTM and ST round their matrices.
    """

    reference: Callable[..., ReferenceGrouping]
    rule: tuple[str, float | Pr | None]
    trials: list[Trial]
    inputs: tuple[str, ...] = ("source", "target")
    fields: tuple[str, ...] = ()
    field_trials: list[Trial] = field(default_factory=list)
    score_tolerance: float = 0.0
    large_score_tolerance: float = 1e-9

    def option_sets(self) -> Iterator[Options]:
        yield {}
        yield from (trial.options for trial in self.trials if trial.compared)


SIMILARITY = Field("similarity")
OTHER_SIMILARITY = Field("similarity", backwards)
OTHER_RATIO = Field("ratio", backwards)
OTHER_FRAMES = [{name: Field(name, rolled)} for name in ("source_lrf", "target_lrf")]
FRAMES = ("source_lrf", "target_lrf")
FEW = {"tolerance": Pr(0.5)}
FRAMED = {name: Field(name) for name in FRAMES}


def rivals(points: FloatArray) -> FloatArray:
    """Return three points for each, itself the second."""
    return np.stack([np.roll(points, shift, axis=0) for shift in (3, 0, 1)], axis=1)


CANDIDATES = Field("target", rivals)
LARGE = {"tolerance": Pr(20.0)}
NARROW = {"tolerance": Pr(3.0)}
SCORED = {"diagonal": "score", "similarity": SIMILARITY}
SAMPLED = {"iterations": 8}
CLIQUE = {"variant": "clique", "iterations": 100}
SHORT_CLIQUE = {"variant": "clique", "iterations": 8}
PCL = {"variant": "pcl", "bin_size": Pr(20.0), "iterations": 100}
WEIGHTED = {**PCL, "distance_weight": True, "similarity": SIMILARITY}
CLOSE = {"payoff": "distance_difference", "resolution": Field("resolution")}
WIDE = {"max_distance_difference": Pr(20.0)}
STRICT = {"max_distance_difference": Pr(4.0)}
INFECTION = {"dynamics": "infection_immunisation"}

OTSU = [Trial({"otsu": "exact"}, shows=False), Trial({"otsu": "covis"}), Trial({"otsu": "legacy"})]
WITHOUT_RESOLUTION = Trial({"resolution": None}, LARGE, shows=False)

CASES: dict[str, MethodCase] = {
    "ss": MethodCase(
        ss,
        rule=("score", None),
        inputs=("similarity",),
        trials=[
            Trial({"bins": 7}),
            Trial({"threshold": 0.5}),
            Trial({"threshold": -1.0}),
            *OTSU,
            Trial({"bins": 12}, {"otsu": "legacy"}),
        ],
    ),
    "nnsr": MethodCase(
        nnsr,
        rule=("ratio", 0.8),
        inputs=("ratio",),
        trials=[Trial({"max_ratio": 0.5}), Trial({"max_ratio": 0.0}), Trial({"max_ratio": 1.0})],
    ),
    "si": MethodCase(
        si,
        rule=("score", None),
        fields=("ratio", *FRAMES, "resolution"),
        trials=[
            Trial({"neighbors": 10}),
            Trial({"global_rank": "local_score"}, {"neighbors": 10}),
            Trial({"otsu": "covis"}, {"neighbors": 50, "global_rank": "local_score"}),
            Trial(LARGE),
            WITHOUT_RESOLUTION,
            Trial({"min_distance_ratio": 0.97}),
            Trial({"lowe_ratio": 0.6}),
            Trial({"threshold": 0.25}),
            *OTSU,
        ],
        field_trials=[
            Trial(change, {"neighbors": 20})
            for change in ({"ratio": OTHER_RATIO}, *OTHER_FRAMES, {"resolution": Pr(4.0)})
        ],
    ),
    "cv": MethodCase(
        cv,
        rule=("score", None),
        score_tolerance=1e-9,
        fields=("ratio", *FRAMES, "resolution"),
        trials=[
            Trial({"voters": 1}),
            Trial({"exclude_self": True}, {"voters": 20}),
            Trial({"distance_scale": Pr(3.0)}),
            Trial({"resolution": None}, {"distance_scale": Pr(30.0)}, shows=False),
            Trial({"angle_scale": 3.0}),
            Trial({"threshold": 1.5}),
            *OTSU,
        ],
        field_trials=[
            Trial(change, {"voters": 30})
            for change in ({"ratio": OTHER_RATIO}, *OTHER_FRAMES, {"resolution": Pr(2.0)})
        ],
    ),
    "ransac": MethodCase(
        ransac,
        rule=("residual", Pr(5.0)),
        fields=("resolution",),
        trials=[
            Trial({"iterations": 300}, SAMPLED),
            Trial({"seed": 2**64 - 1}, {"iterations": 300}),
            Trial({"tolerance": Pr(2.0)}, {"iterations": 300}),
            Trial({"resolution": None}, {"iterations": 300, **LARGE}, shows=False),
            Trial({"refine": True}, SAMPLED),
            Trial({"refine": True}, {"iterations": 300}, shows=False),
            Trial({"edge_ratio": 0.999}, SAMPLED),
            Trial({"confidence": 0.01}, {"iterations": 2000}),
            Trial({"confidence": 0.99}, {"iterations": 1000, "refine": True, "edge_ratio": 0.8}, shows=False),
        ],
        field_trials=[Trial({"resolution": Pr(0.5)}, {"iterations": 500})],
    ),
    "st": MethodCase(
        st,
        rule=("conflict", 0.6),
        score_tolerance=1e-6,
        large_score_tolerance=1e-6,
        trials=[
            Trial({"min_distance_ratio": 0.9}),
            Trial({"affinity": "threshold"}),
            Trial({"affinity": "binary"}),
            Trial({"affinity": "binary"}, {"min_distance_ratio": 0.95}),
            Trial({"diagonal": "one"}),
            Trial(SCORED),
            Trial({"affinity": "binary"}, SCORED),
            Trial({"recompute": True}, {"diagonal": "one", "min_distance_ratio": 0.9}),
            Trial({"eigensolver": "dense"}),
            Trial({"eigensolver": "dense"}, {"recompute": True}),
            Trial({"eigensolver": "dense"}, SCORED),
            # Isolated correspondences keep a trace of the start in power iteration only.
            Trial(
                {"eigensolver": "dense"},
                {"affinity": "threshold", "min_distance_ratio": 0.998, "conflict": "one_to_one"},
                compared=False,
            ),
            Trial({"conflict": "one_to_one"}),
            Trial({"conflict": "both"}, {"min_distance_ratio": 0.0}),
            Trial({"recompute": True}, {"conflict": "one_to_one", "affinity": "threshold"}),
        ],
        field_trials=[Trial({"similarity": OTHER_SIMILARITY}, SCORED)],
    ),
    "gc": MethodCase(
        gc,
        rule=("star", Pr(3.0)),
        fields=("resolution",),
        trials=[
            Trial({"ties": "union"}, {"tolerance": Pr(1e-4)}),
            Trial({"tolerance": Pr(0.5)}),
            WITHOUT_RESOLUTION,
            Trial({"ties": "union"}, {"tolerance": Pr(0.5)}, shows=False),
            Trial(CLIQUE),
            Trial({"similarity": SIMILARITY}, CLIQUE),
            Trial({"min_cluster_size": 30}, CLIQUE),
            Trial({"min_cluster_size": 10, "seed": 3}, {"variant": "clique", "iterations": 30}, shows=False),
            Trial({"tolerance": Pr(10.0)}, CLIQUE),
            Trial({"iterations": 500}, SHORT_CLIQUE),
            Trial({"seed": 1}, SHORT_CLIQUE),
        ],
        field_trials=[Trial({"resolution": Pr(2.0)})],
    ),
    "hough3d": MethodCase(
        hough3d,
        rule=("fullest bin", 6.0),
        fields=(*FRAMES, "source_centroid"),
        trials=[
            Trial({"source_centroid": None}),
            Trial({"bins": 4}),
            Trial({"bins": 40, "neighbors": 26}),
            Trial({"neighbors": 0}),
            Trial({"neighbors": 26}),
            Trial({"bin_size": Pr(10.0)}),
            Trial({"neighbors": 0}, {"bin_size": Pr(50.0)}),
            Trial({"variant": "pcl", "iterations": 100}, {"bin_size": Pr(10.0)}),
            Trial({"bin_size": Pr(20.0)}, {**PCL, "bin_size": Pr(40.0)}),
            Trial({"seed": 1}, {**PCL, "bin_size": Pr(40.0), "iterations": 1}),
            Trial({"iterations": 100}, {**PCL, "bin_size": Pr(40.0), "iterations": 1}),
            Trial({"interpolation": False}, PCL),
            Trial({"vote_threshold": 2.0}, {**PCL, "interpolation": False, "iterations": 50}, shows=False),
            Trial({"vote_threshold": 1e3}, PCL),
            Trial({"distance_weight": True}, {**PCL, "similarity": SIMILARITY}),
            Trial({"interpolation": False}, WEIGHTED),
        ],
        field_trials=[
            *(Trial(change) for change in OTHER_FRAMES),
            Trial({"source_centroid": Field("source_centroid", far_away)}),
            Trial({"source_centroid": Field("source_centroid", far_away)}, {"source_centroid": None}),
            Trial({"similarity": OTHER_SIMILARITY}, WEIGHTED),
        ],
    ),
    "gtm": MethodCase(
        gtm,
        rule=("score", None),
        score_tolerance=1e-6,
        large_score_tolerance=1e-3,
        trials=[
            Trial({"iterations": 1}),
            Trial({"iterations": 500}),
            Trial({"threshold": 0.02}),
            Trial({"one_to_one": True}, shows=False),
            Trial({"convergence_tolerance": 1e-2}),
            Trial(CLOSE),
            Trial({"one_to_one": True}, CLOSE),
            Trial({"tolerance": Pr(10.0)}, {"payoff": "distance_difference", "resolution": Pr(1.0)}),
            Trial(INFECTION),
            Trial({"iterations": 20}, INFECTION),
            Trial({"convergence_tolerance": 1e-3}, {**INFECTION, "iterations": 1000}),
            Trial({"one_to_one": True}, {**INFECTION, "payoff": "distance_difference", "tolerance": Pr(5.0)}),
            *OTSU,
        ],
        field_trials=[Trial({"resolution": Pr(2.0)}, CLOSE)],
    ),
    "lc": MethodCase(
        lc,
        rule=("residual", Pr(5.0)),
        score_tolerance=1e-6,
        large_score_tolerance=1e-6,
        fields=("resolution",),
        trials=[
            Trial({"ratio": Field("ratio")}),
            Trial({"tolerance": Pr(6.0)}),
            Trial({"resolution": None}),
            Trial({"resolution": Pr(0.2), "ratio": Field("ratio")}),
            Trial({"modes": 1}, {"tolerance": Pr(0.5)}),
            Trial({"modes": 3}, {"tolerance": Pr(0.5), "ratio": Field("ratio")}),
            Trial(FRAMED, shows=False),  # frames that are no better than the positions don't count
            Trial(FRAMED, FEW),
            Trial({"ratio": Field("ratio"), "instances": 2}, FRAMED),
            Trial({"instances": 3}),
            Trial({"scale": True}, {"tolerance": Pr(4.0)}),
            Trial({"scale": (0.34, 50.0)}, {"tolerance": Pr(6.0), "ratio": Field("ratio")}),
        ],
        field_trials=[
            Trial({"ratio": OTHER_RATIO}, {"ratio": Field("ratio")}),
            Trial({"resolution": Pr(2.0)}),
            *(Trial(change, FEW | FRAMED) for change in OTHER_FRAMES),
        ],
    ),
    "mac": MethodCase(
        mac,
        rule=("residual", Pr(5.0)),
        fields=("resolution",),
        trials=[
            Trial({"tolerance": Pr(2.0)}),
            WITHOUT_RESOLUTION,
            Trial({"max_distance_difference": Pr(0.3)}, {"refine": False}),
            Trial({"min_weight": 0.5}),
            Trial({"min_weight": 0.0}, {"max_distance_difference": Pr(2.0)}),
            Trial({"min_clique_size": 4}),
            Trial({"min_clique_size": 6}, {"max_distance_difference": Pr(2.0)}, shows=False),
            Trial({"max_cliques": 300}),
            Trial({"max_cliques": 1}, {"max_cliques": 300}),
            Trial({"max_hypotheses": 1}, {"refine": False, "tolerance": Pr(2.0)}),
            Trial({"refine": False}, {"tolerance": Pr(2.0)}),
        ],
        field_trials=[Trial({"resolution": Pr(2.0)})],
    ),
    "sc2pcr": MethodCase(
        sc2pcr,
        rule=("residual", Pr(5.0)),
        score_tolerance=1e-9,
        large_score_tolerance=1e-4,
        fields=("resolution",),
        trials=[
            Trial({"tolerance": Pr(1.5)}),
            Trial({"max_distance_difference": Pr(1.0)}),
            Trial({"seed_ratio": 0.0}, NARROW),
            Trial({"seed_ratio": 1.0}, {"tolerance": Pr(0.3)}),
            Trial({"nms_radius": Pr(80.0)}, NARROW),
            Trial({"k1": 5}, NARROW),
            Trial({"k2": 4}, NARROW),
            Trial({"candidates": CANDIDATES}, NARROW),
            WITHOUT_RESOLUTION,
        ],
        field_trials=[Trial({"resolution": Pr(0.3)})],
    ),
    "turboreg": MethodCase(
        turboreg,
        rule=("residual", Pr(5.0)),
        fields=("resolution",),
        trials=[
            Trial({"tolerance": Pr(1.5)}),
            Trial({"max_distance_difference": Pr(4.0)}, NARROW),
            Trial({"nms_radius": Pr(150.0)}, NARROW),
            Trial({"pivots": 3}, NARROW),
            Trial({"cliques_per_pivot": 1}, NARROW),
            Trial({"choice": "mae"}, NARROW),
            Trial({"choice": "mse"}, NARROW),
            WITHOUT_RESOLUTION,
        ],
        field_trials=[Trial({"resolution": Pr(0.3)})],
    ),
    "teaser": MethodCase(
        teaser,
        rule=("axes in clique", Pr(2.5)),
        fields=("resolution",),
        trials=[
            Trial({"tolerance": Pr(6.0)}),
            WITHOUT_RESOLUTION,
            Trial({"max_distance_difference": Pr(2.0)}),
            Trial({"prune": "core", "tolerance": Pr(6.0)}),
            Trial(WIDE),
            Trial({"max_steps": 0}, STRICT),
            Trial({"max_steps": 300}, STRICT),
            Trial({"dof": 4}),
            Trial({"scale": "estimate"}),
            Trial({"scale": "estimate"}, {"dof": 4}, shows=False),
        ],
        field_trials=[Trial({"resolution": Pr(2.0)})],
    ),
    "clipper": MethodCase(
        clipper,
        rule=("greatest", None),
        fields=("resolution",),
        score_tolerance=2e-3,
        large_score_tolerance=2e-3,
        trials=[
            Trial({"max_distance_difference": Pr(2.0)}),
            Trial({"resolution": None}, {"max_distance_difference": Pr(9.0)}, shows=False),
            Trial({"deviation": Pr(0.5)}),
            # Where right ones exclude each other, cliques of one size abound: rounding decides between them.
            Trial({"min_distance": Pr(15.0)}, compared=False),
            Trial({"variant": "maximum"}),
            Trial({"variant": "maximum"}, {"max_distance_difference": Pr(12.0)}),
            Trial({"min_distance": Pr(40.0)}, {"variant": "maximum"}, compared=False),
            Trial({"seed": 3}),
        ],
        field_trials=[Trial({"resolution": Pr(2.0)})],
    ),
}
"""By the name of the function, in cgroup and in the reference."""

OPTION_SETS = [(method, options) for method, case in CASES.items() for options in case.option_sets()]


def call_reference(method: str, problem: Problem, options: Options) -> ReferenceGrouping:
    return _call(CASES[method].reference, method, problem, options)


def call_cgroup(method: str, problem: Problem, options: Options) -> cgroup.Grouping:
    return _call(getattr(cgroup, method), method, problem, options)


def _call(function: Callable[..., Any], method: str, problem: Problem, options: Options) -> Any:
    case = CASES[method]
    arguments = {name: Field(name) for name in case.fields} | options
    resolved = {
        name: value.of(problem) if isinstance(value, (Pr, Field)) else value
        for name, value in arguments.items()
    }
    return function(*(getattr(problem, name) for name in case.inputs), **resolved)


def name_of(value: object) -> str | None:
    if callable(value):
        return value.__name__
    if isinstance(value, Trial):
        return f"{name_of(value.change)}|{name_of(value.base)}"
    if isinstance(value, dict):
        return ",".join(f"{key}={entry}" for key, entry in value.items()) or "defaults"
    return None
