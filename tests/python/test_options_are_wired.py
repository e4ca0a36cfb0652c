"""Every option of a method changes its result: an option without any effect is not connected."""

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from method_cases import CASES, Options, Trial, call_cgroup, name_of

import cgroup
from cgroup.registry import METHOD_INFO
from strategies import hard_problem, make_problem

CONTROL = {"threads", "max_memory", "progress", "max_seconds"}
"""Parameters that control how a run goes, not what it computes."""

PROBLEM = hard_problem(150)
TRIALS = [
    (method, trial)
    for method, case in CASES.items()
    for trial in (*case.trials, *case.field_trials)
    if trial.shows
]


def outcome(group: Any) -> tuple[list[Any] | float | None, ...]:
    arrays = (group.mask, group.scores, group.alternatives, group.alternative_scores, group.instances)
    return (*(None if array is None else np.asarray(array).tolist() for array in arrays), group.threshold)


@pytest.mark.parametrize(("method", "trial"), TRIALS, ids=name_of)
def test_option_has_an_effect(method: str, trial: Trial) -> None:
    before = outcome(call_cgroup(method, PROBLEM, trial.base))
    assert outcome(call_cgroup(method, PROBLEM, trial.base)) == before
    assert outcome(call_cgroup(method, PROBLEM, trial.options)) != before


@pytest.mark.parametrize("method", ["ss", "si", "cv", "gtm"])
def test_exact_otsu_differs_from_binned_otsu(method: str) -> None:
    # Only where scores are crowded around the best cut, so without inliers, and not always.
    base: dict[str, Options] = {
        "si": {"neighbors": 40, "tolerance": 100.0, "min_distance_ratio": 0.7},
        "gtm": {"iterations": 2},
    }
    for seed in range(20):
        crowd = make_problem(np.random.default_rng(seed), 300, inlier_ratio=0.0)
        options = base.get(method, {})
        cuts = {
            call_cgroup(method, crowd, {**options, "otsu": mode}).threshold for mode in ("minmax", "exact")
        }
        if len(cuts) == 2:
            return
    pytest.fail("the same cut on all problems")


@pytest.mark.parametrize("method", [info.function.__name__ for info in METHOD_INFO.values()])
def test_options_and_defaults_are_those_of_the_reference_and_are_tried(method: str) -> None:
    options = keyword_options(CASES[method].reference)
    assert keyword_options(getattr(cgroup, method)) - CONTROL == options
    assert options <= {name for m, trial in TRIALS if m == method for name in trial.change}
    actual = inspect.signature(getattr(cgroup, method)).parameters
    for name, parameter in inspect.signature(CASES[method].reference).parameters.items():
        assert actual[name].default == parameter.default, name
        assert actual[name].kind in {parameter.kind, inspect.Parameter.POSITIONAL_ONLY}, name


def keyword_options(function: Callable[..., object]) -> set[str]:
    parameters = inspect.signature(function).parameters.values()
    return {p.name for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY}
