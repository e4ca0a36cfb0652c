"""Every option changes something: an option without any effect is not connected.

The same table runs on cgroup and on the reference. The second proves that the table is
right: the change is there to be seen.
"""

from __future__ import annotations

import inspect
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import cgroup
import reference
from strategies import Problem, make_problem

Options = dict[str, Any]

# How a run is controlled, as opposed to what it computes.
CONTROL = {"threads", "max_memory", "progress"}
POSITIONAL = {"ss": ("similarity",), "nnsr": ("ratio",)}
METHODS = ("ss", "nnsr", "si", "cv", "ransac", "st", "gc", "hough3d", "gtm")


def fixed_problem() -> Problem:
    """Return the problem of all cases: 150 correspondences with every nuisance."""
    return make_problem(
        np.random.default_rng(6),
        150,
        inlier_ratio=0.4,
        noise=1.5,
        repeated_targets=0.5,
        duplicated_sources=0.2,
        missing_frames=0.1,
        zero_descriptors=0.05,
    )


PROBLEM = fixed_problem()
FRAMES = {"source_lrf": PROBLEM.source_lrf, "target_lrf": PROBLEM.target_lrf}
VOTING = {"ratio": PROBLEM.ratio, "resolution": 1.0, "neighbors": 20, **FRAMES}
SUPPORT = {"ratio": PROBLEM.ratio, "resolution": 1.0, "voters": 30, **FRAMES}
SAMPLED = {"resolution": 1.0, "iterations": 8}
CLIQUE = {"resolution": 1.0, "variant": "clique", "iterations": 8}
HOUGH = {**FRAMES, "source_centroid": PROBLEM.source_centroid}
PCL = {**HOUGH, "variant": "pcl", "bin_size": 40.0, "iterations": 300}
WEIGHTED = {**PCL, "distance_weight": True, "similarity": PROBLEM.similarity}
CLOSE = {"payoff": "distance_difference", "resolution": 1.0}
INFECTION = {"dynamics": "infection_immunisation"}
REVERSED = PROBLEM.similarity[::-1].copy()
TWISTED = np.roll(PROBLEM.source_lrf, 1, axis=0)

# method, options of the first run, what is changed or added in the second
CASES: list[tuple[str, Options, Options]] = [
    ("ss", {}, {"threshold": 0.5}),
    ("ss", {}, {"bins": 3}),
    ("ss", {}, {"otsu": "covis"}),
    ("ss", {}, {"otsu": "legacy"}),
    ("nnsr", {}, {"max_ratio": 0.7}),
    ("si", VOTING, {"ratio": PROBLEM.ratio[::-1].copy()}),
    ("si", VOTING, {"source_lrf": TWISTED}),
    ("si", VOTING, {"target_lrf": TWISTED}),
    ("si", VOTING, {"resolution": 4.0}),
    ("si", VOTING, {"tolerance": 20.0}),
    ("si", VOTING, {"neighbors": 10}),
    ("si", VOTING, {"min_distance_ratio": 0.95}),
    ("si", VOTING, {"lowe_ratio": 0.6}),
    ("si", VOTING, {"global_rank": "local_score"}),
    ("si", VOTING, {"threshold": 0.1}),
    ("si", VOTING, {"otsu": "covis"}),
    ("si", VOTING, {"otsu": "legacy"}),
    ("cv", SUPPORT, {"ratio": PROBLEM.ratio[::-1].copy()}),
    ("cv", SUPPORT, {"source_lrf": TWISTED}),
    ("cv", SUPPORT, {"target_lrf": TWISTED}),
    ("cv", SUPPORT, {"resolution": 2.0}),
    ("cv", SUPPORT, {"distance_scale": 5.0}),
    ("cv", SUPPORT, {"angle_scale": 20.0}),
    ("cv", SUPPORT, {"voters": 20}),
    ("cv", SUPPORT, {"exclude_self": True}),
    ("cv", SUPPORT, {"threshold": 1.0}),
    ("cv", SUPPORT, {"otsu": "covis"}),
    ("cv", SUPPORT, {"otsu": "legacy"}),
    ("ransac", {**SAMPLED, "iterations": 500}, {"resolution": 0.5}),
    ("ransac", {**SAMPLED, "iterations": 500}, {"tolerance": 2.0}),
    ("ransac", SAMPLED, {"iterations": 500}),
    ("ransac", SAMPLED, {"seed": 1}),
    ("ransac", SAMPLED, {"refine": True}),
    ("ransac", SAMPLED, {"edge_ratio": 0.999}),
    ("ransac", {"resolution": 1.0, "iterations": 2000}, {"confidence": 0.01}),
    ("st", {}, {"min_distance_ratio": 0.9}),
    ("st", {}, {"affinity": "threshold"}),
    ("st", {}, {"affinity": "binary"}),
    ("st", {}, {"diagonal": "one"}),
    ("st", {}, {"diagonal": "score", "similarity": PROBLEM.similarity}),
    ("st", {"diagonal": "score", "similarity": PROBLEM.similarity}, {"similarity": REVERSED}),
    ("st", {}, {"recompute": True}),
    # Isolated correspondences keep a trace of the start in power iteration only.
    (
        "st",
        {"affinity": "threshold", "min_distance_ratio": 0.998, "conflict": "one_to_one"},
        {"eigensolver": "dense"},
    ),
    ("st", {}, {"conflict": "one_to_one"}),
    ("st", {"min_distance_ratio": 0.0}, {"conflict": "both"}),
    ("gc", {"resolution": 1.0}, {"resolution": 2.0}),
    ("gc", {"resolution": 1.0}, {"tolerance": 1.0}),
    ("gc", {"resolution": 1.0}, {"variant": "clique"}),
    ("gc", {"tolerance": 1e-4}, {"ties": "union"}),
    ("gc", CLIQUE, {"similarity": PROBLEM.similarity}),
    ("gc", CLIQUE, {"min_cluster_size": 30}),
    ("gc", CLIQUE, {"seed": 1}),
    ("gc", CLIQUE, {"iterations": 500}),
    ("hough3d", HOUGH, {"source_lrf": TWISTED}),
    ("hough3d", HOUGH, {"target_lrf": TWISTED}),
    ("hough3d", HOUGH, {"source_centroid": np.array([200.0, 0.0, 0.0])}),
    ("hough3d", FRAMES, {"source_centroid": np.array([200.0, 0.0, 0.0])}),
    ("hough3d", HOUGH, {"bins": 5}),
    ("hough3d", HOUGH, {"neighbors": 0}),
    ("hough3d", HOUGH, {"neighbors": 26}),
    ("hough3d", HOUGH, {"bin_size": 10.0}),
    ("hough3d", {**HOUGH, "bin_size": 25.0}, {"variant": "pcl"}),
    ("hough3d", PCL, {"bin_size": 20.0}),
    ("hough3d", PCL, {"interpolation": False}),
    ("hough3d", PCL, {"vote_threshold": 1e3}),
    ("hough3d", {**PCL, "similarity": PROBLEM.similarity}, {"distance_weight": True}),
    ("hough3d", WEIGHTED, {"similarity": REVERSED}),
    ("hough3d", {**PCL, "iterations": 1}, {"iterations": 300}),
    ("hough3d", {**PCL, "iterations": 1}, {"seed": 1}),
    ("gtm", {}, {"iterations": 10}),
    ("gtm", {}, {"threshold": 0.02}),
    ("gtm", {}, {"otsu": "covis"}),
    ("gtm", {}, {"otsu": "legacy"}),
    ("gtm", CLOSE, {"one_to_one": True}),
    ("gtm", {"resolution": 1.0}, {"payoff": "distance_difference"}),
    ("gtm", CLOSE, {"resolution": 2.0}),
    ("gtm", CLOSE, {"tolerance": 1.0}),
    ("gtm", {}, {"convergence_tolerance": 0.01}),
    ("gtm", {}, INFECTION),
    ("gtm", INFECTION, {"iterations": 20}),
    ("gtm", INFECTION, {"threshold": 0.02}),
    ("gtm", INFECTION, {"convergence_tolerance": 0.1}),
]


def name_of(value: object) -> str | None:
    """Return the name of a test parameter."""
    if isinstance(value, ModuleType):
        return value.__name__
    if isinstance(value, dict):
        plain = (int, float, str, bool)
        return (
            ",".join(f"{k}={v}" if isinstance(v, plain) else k for k, v in value.items() if k not in FRAMES)
            or "defaults"
        )
    return None


def run(package: ModuleType, method: str, options: Options, problem: Problem = PROBLEM) -> Any:
    """Call a method on a problem, by default the fixed one."""
    inputs = POSITIONAL.get(method, ("source", "target"))
    return getattr(package, method)(*(getattr(problem, x) for x in inputs), **options)


def outcome(group: Any) -> tuple[list[bool], list[float] | None, float | None]:
    """Return all that a caller can observe."""
    scores = None if group.scores is None else np.asarray(group.scores).tolist()
    return np.asarray(group.mask).tolist(), scores, group.threshold


@pytest.mark.parametrize("package", [reference, cgroup], ids=name_of)
@pytest.mark.parametrize(("method", "options", "change"), CASES, ids=name_of)
def test_option_has_an_effect(package: ModuleType, method: str, options: Options, change: Options) -> None:
    before = outcome(run(package, method, options))
    assert outcome(run(package, method, options)) == before
    assert outcome(run(package, method, options | change)) != before


@pytest.mark.parametrize("package", [reference, cgroup], ids=name_of)
@pytest.mark.parametrize("method", ["ss", "si", "cv", "gtm"])
def test_exact_otsu_differs_from_binned_otsu(package: ModuleType, method: str) -> None:
    # Only where scores are crowded around the best cut, so without inliers, and not always.
    fields = ("ratio", "source_lrf", "target_lrf", "resolution") if method in {"si", "cv"} else ()
    base: dict[str, Options] = {
        "si": {"neighbors": 40, "tolerance": 100.0, "min_distance_ratio": 0.7},
        "gtm": {"iterations": 2},
    }
    for seed in range(20):
        crowd = make_problem(np.random.default_rng(seed), 300, inlier_ratio=0.0)
        options = {name: getattr(crowd, name) for name in fields} | base.get(method, {})
        cuts = {
            run(package, method, {**options, "otsu": mode}, crowd).threshold for mode in ("minmax", "exact")
        }
        if len(cuts) == 2:
            return
    pytest.fail("the same cut on all problems")


@pytest.mark.parametrize("method", METHODS)
def test_every_option_is_in_the_table(method: str) -> None:
    changed = {name for m, _, change in CASES if m == method for name in change}
    assert keyword_options(reference, method) - changed == set()


@pytest.mark.parametrize("method", METHODS)
def test_no_option_without_reference(method: str) -> None:
    assert keyword_options(cgroup, method) - CONTROL == keyword_options(reference, method)


@pytest.mark.parametrize("method", METHODS)
def test_defaults_are_those_of_the_reference(method: str) -> None:
    expected = inspect.signature(getattr(reference, method)).parameters
    actual = inspect.signature(getattr(cgroup, method)).parameters
    for name, parameter in expected.items():
        assert actual[name].default == parameter.default, name
        assert actual[name].kind in {parameter.kind, inspect.Parameter.POSITIONAL_ONLY}, name


def keyword_options(package: ModuleType, method: str) -> set[str]:
    """Return the names of the keyword-only parameters."""
    parameters = inspect.signature(getattr(package, method)).parameters.values()
    return {p.name for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY}
