"""Run any grouping method by its name, on one problem or on many at once."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

from cgroup._checks.calls import explain_wrong_calls, refuse_too_many, unknown_option
from cgroup._checks.values import as_choice, as_instance, as_items, refusal
from cgroup._runtime.memory import default_max_memory, report_refused_memory
from cgroup._runtime.workers import count_workers, work_side_by_side
from cgroup.errors import InputError
from cgroup.methods._call import compute
from cgroup.registry import METHOD_INFO, PRESETS, MethodInfo, MethodName, find_method
from cgroup.types import Correspondences, Grouping
from cgroup.types.fields import FIELDS, Fields

__all__ = [
    "group",
    "group_many",
]


_AUTO = "auto"  # of a tolerance: estimated
_MEANT = 'give group(Correspondences(source, target), "gtm"), or call gtm(source, target)'


@report_refused_memory()
@refuse_too_many(_MEANT)
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
        options.pop("tolerance")
        if info.name != "lc":
            correspondences = _with_estimated_resolution(correspondences, options.get("threads"))
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
    """Group many problems at once, one thread each, on all cores.

    Parameters
    ----------
    problems : iterable of Correspondences
        The problems; each has the fields that the method is defined on.
    method : str
        Name of the method for all of them, one of `cgroup.METHODS`.
    preset : str
        As for `group`.
    threads : int, optional
        Number of problems grouped at a time; None for one per core. Results do not depend on it.
    **options
        As for `group`, the same for all problems.

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


def _with_estimated_resolution(correspondences: Correspondences, threads: int | None) -> Correspondences:
    """Return the correspondences with a resolution estimated by likelihood consensus."""
    unknown = replace(correspondences, resolution=None)
    return replace(unknown, resolution=group(unknown, "lc", threads=threads).diagnostics["resolution"])


def check_method(
    method: str, options: Mapping[str, Any] | None = None, called: Callable[..., Any] | None = None
) -> str:
    """Return the public name of a method; raise `InputError` for an unknown method or option.

    `called` is the function that passes the options on; its own options are suggested too.
    """
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
        raise InputError(
            "option",
            remedy=f"{unknown!r} belongs to the matches: Correspondences(source, target, {unknown}=...)",
        )
    raise unknown_option(method, unknown, known, own)


def _fields_for(info: MethodInfo, correspondences: Correspondences) -> Fields:
    for name in info.fields:
        if getattr(correspondences, name) is None:
            modest = [other.name for other in METHOD_INFO.values() if other.fields == ("source", "target")]
            raise InputError(
                "method",
                remedy=(
                    f"{info.name} needs `{name}`, which these correspondences lack; give `Correspondences` "
                    f"with it, or use a method without this need: {', '.join(modest)}"
                ),
            )
    return Fields(**{name: getattr(correspondences, name) for name in (*info.fields, *info.optional_fields)})
