"""Run any grouping method by its name, on one problem or on many at once."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from functools import cache, partial
from time import perf_counter
from typing import Any

import numpy as np

from cgroup import _core
from cgroup._checks.arrays import as_floats, as_mask, contiguous
from cgroup._checks.calls import explain_wrong_calls, unknown_option
from cgroup._checks.values import as_choice, as_count, as_instance, as_items, as_length, refusal, run_options
from cgroup._runtime.memory import default_max_memory, max_memory_for, report_refused_memory
from cgroup._runtime.workers import count_workers, work_side_by_side
from cgroup.errors import InputError
from cgroup.methods._call import compute, grouping_of
from cgroup.registry import METHOD_INFO, PRESETS, MethodInfo, MethodName, find_method
from cgroup.types import Correspondences, FloatArray, Grouping
from cgroup.types.fields import FIELDS, Fields
from cgroup.types.grouping import find_probabilities

__all__ = ["certify", "group", "group_many", "group_motions", "match_probabilities"]

_AUTO = "auto"  # of a tolerance: estimated
_MEANT = 'give group(Correspondences(source, target), "gtm"), or call gtm(source, target)'


@report_refused_memory()
@partial(explain_wrong_calls, too_many=_MEANT)
def group(
    correspondences: Correspondences,
    method: MethodName | str = "lc",
    *,
    preset: str = "paper",
    **options: Any,  # noqa: ANN401 - those of the method
) -> Grouping:
    """Group correspondences by any of `METHODS`.

    Parameters
    ----------
    correspondences : Correspondences
        The method takes the fields that it is defined on.
    method : str
        Name of the method, one of `cgroup.METHODS`, in any case; labels and names of functions mean the same:
        "3dhv", "Hough3D". With the default, `Grouping.ok` is False if chance could explain the group.
    preset : str
        Source of the method's options, one of `cgroup.PRESETS`: "paper", its defaults; "literal", the
        formulas of Yang et al., TPAMI 2019, to the letter; "original", its own author's options; "pcl";
        "legacy_header"; "3dmatch" and "kitti", published constants in metres.
    **options
        Options of the method by their names, such as ``tolerance=0.1``; they override the preset's.
        ``tolerance="auto"`` estimates the resolution by `lc`, from the matches alone; for `lc` itself it
        means no tolerance.

    Returns
    -------
    Grouping
        In the order of the correspondences.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import group
    >>> from cgroup.datasets import make_problem
    >>> problem = make_problem(np.random.default_rng(0), 500, inlier_ratio=0.2)
    >>> found = group(problem.correspondences())
    >>> found.ok, bool((found.mask == problem.inlier_mask).mean() > 0.95)
    (True, True)
    >>> group(problem.correspondences(), "gc", tolerance=0.1).size < found.size
    True
    """
    if not isinstance(correspondences, Correspondences):
        raise refusal("correspondences", correspondences, _MEANT)
    info = find_method(method)
    as_choice("preset", preset, PRESETS)
    defaults = _defaults(info.function)
    _refuse_unknown(info.name, options, defaults)
    if isinstance(options.get("tolerance"), str) and options["tolerance"] == _AUTO:
        options["tolerance"] = None
        if info.name != "lc":
            bare = replace(correspondences, resolution=None)
            found = group(bare, "lc", threads=options.get("threads"))
            correspondences = replace(bare, resolution=found.diagnostics["resolution"])
    fields = _fields_for(info, correspondences)
    chosen = {**defaults, **PRESETS[preset].get(info.name, {}), **options}
    positions = (correspondences.source, correspondences.target)
    return compute(info.name, fields, chosen, positions, correspondences.resolution)


@report_refused_memory()
@explain_wrong_calls
def group_many(
    problems: Iterable[Correspondences],
    method: MethodName | str = "lc",
    *,
    preset: str = "paper",
    threads: int | None = None,
    **options: Any,  # noqa: ANN401 - those of the method
) -> list[Grouping]:
    """Group many problems at once, a thread each; the rest is as for `group`.

    Parameters
    ----------
    problems : iterable of Correspondences
        The problems; each has the fields that the method is defined on.
    threads : int, optional
        Number of problems grouped at a time; None for one per core. Results do not depend on it.

    Returns
    -------
    list of Grouping
        In the order of the problems.
    """
    given = as_items("problems", problems, "give several Correspondences")
    for row, problem in enumerate(given):
        as_instance(f"problems[{row}]", problem, Correspondences)
    workers = count_workers(threads)
    known = _defaults(find_method(method).function)
    options = {"threads": 1, **options}
    if "max_memory" in known:
        options = {"max_memory": default_max_memory() // workers, **options}

    def group_one(problem: Correspondences, stop_with_the_others: Callable[[], None]) -> Grouping:
        stoppable = {"progress": lambda _share: stop_with_the_others()} if "progress" in known else {}
        return group(problem, method, preset=preset, **{**stoppable, **options})

    return work_side_by_side(given, group_one, workers)


@report_refused_memory()
@explain_wrong_calls
def match_probabilities(
    matches: Correspondences, grouping: Grouping, *, threads: int | None = None
) -> FloatArray:
    """Return the probability that each match is correct, for the group of any method.

    Residuals under the group's pose are those of correct matches, with estimated noise, or of wrong ones,
    which end where targets are dense. False alarms and `Grouping.alternatives` limit the probability.

    Parameters
    ----------
    matches : Correspondences
        Their resolution, or else that of the group, or of their spacing, is the scale of the noise.
    grouping : Grouping
        Group of these matches. Without `Grouping.model` the pose is fitted to the mask.
    threads : int, optional
        As for `lc`.

    Returns
    -------
    (n,) array of float64
        In [0,1]; 0 if the group determines no pose. `Grouping.probabilities` is the same.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import Correspondences, gc, match_probabilities
    >>> source = np.random.default_rng(0).uniform(0, 100, (50, 3))
    >>> target = np.vstack([source[:40] + 5, source[:10]])
    >>> found = gc(source, target, resolution=1)
    >>> match_probabilities(Correspondences(source, target), found)[38:42].round(2)
    array([1., 1., 0., 0.])
    """
    return find_probabilities(_points_of(matches), _checked(matches, grouping), threads)


@report_refused_memory()
@explain_wrong_calls
def group_motions(
    matches: Correspondences, *, tolerance: float | None = None, most: int = 20, threads: int | None = None
) -> list[Grouping]:
    """Group the matches of several motions: of bodies, or of instances of one model.

    `lc` groups the matches, then those that are left, until a group is not `Grouping.ok`. All motions are
    then refined together, and each match goes to its most probable one. Further parameters as for `lc`.

    Parameters
    ----------
    matches : Correspondences
        Their points, ratio and resolution are used.
    most : int
        Greatest number of groups.

    Returns
    -------
    list of Grouping
        Disjoint, in the order in which they were found. Their scores are probabilities;
        `Grouping.false_alarms` counts among the matches left by earlier groups.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import Correspondences, group_motions
    >>> source = np.random.default_rng(0).uniform(0, 100, (300, 3))
    >>> target = source + np.repeat([[0, 0, 50], [0, 9, 0], [30, 0, 0]], 100, axis=0)
    >>> found = group_motions(Correspondences(source, target, resolution=1))
    >>> [one.size for one in found]
    [100, 100, 100]
    """
    fields, limit = _points_of(matches), as_count("most", most, 1)
    length = None if tolerance is None else as_length("tolerance", tolerance)
    parts = _core.group_motions(fields, length, limit, run_options(threads, max_memory_for(len(matches))))
    points = matches.source, matches.target
    return [grouping_of(one, "lc", points, matches.resolution) for one in parts]


@report_refused_memory()
@explain_wrong_calls
def certify(
    matches: Correspondences,
    grouping: Grouping,
    *,
    tolerance: float | None = None,
    threads: int | None = None,
) -> Grouping:
    """Bound the number of inliers of any rival of the group's pose.

    A rival has at most half of the matches within the tolerance of the group's pose, its inliers, among its
    own. Any pose that moves at least half of their source points by more than twice the tolerance is a rival.
    Parameters are as for `match_probabilities`.

    Parameters
    ----------
    tolerance : float, optional
        In the data's unit; by default the method's bound on residuals, or on distances.

    Returns
    -------
    Grouping
        The same, with ``bound``, ``inliers`` (matches within the tolerance of the pose), ``optimal`` (1 if
        the bound is less than that, else 0) and ``bound_seconds`` in its `diagnostics`.

    Raises
    ------
    NoConsensusError
        If the group determines no pose.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import Correspondences, certify, lc
    >>> source = np.random.default_rng(0).uniform(0, 100, (50, 3))
    >>> matches = Correspondences(source, np.vstack([source[:40] + 5, source[:10]]))
    >>> found = lc(source, matches.target, resolution=1)
    >>> certify(matches, found).diagnostics["optimal"]
    1.0
    """
    fields, start = _points_of(matches), perf_counter()
    grouping = _checked(matches, grouping)
    rule, pairs = grouping.rule, None if grouping.rule is None else grouping.rule.agreement
    if tolerance is None and rule is not None:
        if rule.kind == "residual":
            tolerance = rule.bound
        elif pairs is not None and not pairs.is_ratio:
            tolerance = pairs.bound
        else:
            raise InputError("tolerance", "None", f"{rule.method} compares no lengths; give a tolerance")
    model = grouping.transform() if grouping.model is None else grouping.model
    run = run_options(threads, max_memory_for(len(matches)))
    inliers, bound = _core.bound_rivals(fields, model, as_length("tolerance", tolerance), run)
    seconds = perf_counter() - start
    facts = {"bound": bound, "inliers": inliers, "optimal": float(bound < inliers), "bound_seconds": seconds}
    return replace(grouping, diagnostics={**grouping.diagnostics, **facts})


def _points_of(matches: Correspondences) -> Fields:
    as_instance("matches", matches, Correspondences)
    return Fields(matches.source, matches.target, ratio=matches.ratio, resolution=matches.resolution)


def _checked(matches: Correspondences, grouping: Grouping) -> Grouping:
    """Return a user's group as the core reads it."""
    mask = as_mask("grouping.mask", as_instance("grouping", grouping, Grouping).mask)
    if len(mask) != len(matches):
        raise InputError("grouping", f"one of {len(mask)} matches", f"give a group of these {len(matches)}")
    model = grouping.model
    if model is not None:
        model = as_floats("grouping.model", model)
        if model.shape != (4, 4):
            raise InputError("grouping.model", f"shape {model.shape}", "give (4,4), or None")
    return replace(grouping, mask=contiguous(mask, np.bool_), model=model)


def check_method(
    method: str, options: Mapping[str, Any] | None = None, called: Callable[..., Any] | None = None
) -> str:
    """Return the public name of a method; raise `InputError` for an unknown method or option."""
    # `called` is the function that passes the options on; its own options are suggested too.
    info = find_method(method)
    own = [] if called is None else list(inspect.signature(called).parameters)
    _refuse_unknown(info.name, options or {}, _defaults(info.function), own)
    return info.name


@cache
def _defaults(function: Callable[..., Grouping]) -> Mapping[str, Any]:
    """Return the options of a method with their default values."""
    parameters = inspect.signature(function).parameters
    return {name: parameter.default for name, parameter in parameters.items() if name not in FIELDS}


def _refuse_unknown(
    method: str, options: Mapping[str, Any], known: Mapping[str, Any], own: Collection[str] = ()
) -> None:
    unknown = next((name for name in options if name not in known), None)
    if unknown is None:
        return
    if not own and unknown in FIELDS:
        remedy = f"{unknown!r} belongs to the matches: Correspondences(source, target, {unknown}=...)"
        raise InputError("option", remedy=remedy)
    raise unknown_option(method, unknown, known, own)


def _fields_for(info: MethodInfo, correspondences: Correspondences) -> Fields:
    for name in info.fields:
        if getattr(correspondences, name) is None:
            modest = [other.name for other in METHOD_INFO.values() if other.fields == ("source", "target")]
            lack = f"{info.name} needs `{name}`, which these correspondences lack"
            others = f"or use a method without this need: {', '.join(modest)}"
            raise InputError("method", remedy=f"{lack}; give `Correspondences` with it, {others}")
    return Fields(**{name: getattr(correspondences, name) for name in (*info.fields, *info.optional_fields)})
