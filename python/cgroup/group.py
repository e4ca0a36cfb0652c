"""One function for all grouping methods, on one problem or on many."""

from __future__ import annotations

import inspect
from functools import cache
from typing import TYPE_CHECKING, Any

from cgroup._calls import compute
from cgroup._fields import FIELDS, Fields
from cgroup._memory import default_max_memory
from cgroup._values import as_choice, as_instance, as_items
from cgroup._workers import count_workers, work_side_by_side
from cgroup.errors import InputError
from cgroup.registry import METHOD_INFO, PRESETS, MethodInfo, find_method
from cgroup.types import Correspondences

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from cgroup.types import Grouping


def group(
    correspondences: Correspondences,
    method: str,
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
        One of `METHODS`, in any case; labels and names of functions mean the same: "3dhv", "Hough3D".
    preset : str
        One of `PRESETS`.
    **options
        Options of the method; they win over the preset's.

    Returns
    -------
    Grouping
        In the order of the correspondences.

    Raises
    ------
    InputError
        For an unknown method, preset or option, or where the method needs a field that is missing.
    """
    info = find_method(method)
    as_choice("preset", preset, PRESETS)
    as_instance("correspondences", correspondences, Correspondences)
    defaults = _defaults(info.function)
    _refuse_unknown(info.name, options, defaults)
    fields = _fields_for(info, correspondences)
    chosen = {**defaults, **PRESETS[preset].get(info.name, {}), **options}
    return compute(info.name, fields, chosen, (correspondences.source, correspondences.target))


def group_many(
    problems: Iterable[Correspondences],
    method: str,
    *,
    preset: str = "paper",
    threads: int | None = None,
    **options: Any,  # noqa: ANN401 - those of the method
) -> list[Grouping]:
    """Group many problems at once, one thread each, on all cores.

    Parameters
    ----------
    problems : iterable of Correspondences
        The problems.
    method, preset, **options
        As in `group`, the same for all.
    threads : int, optional
        Number of problems worked on at a time; None for one per core.

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


def check_method(method: str) -> str:
    """Return the public name of a method; raise `InputError` where there is none."""
    return find_method(method).name


@cache
def _defaults(function: Callable[..., Grouping]) -> Mapping[str, Any]:
    """Options of a method, and what they are where they are not given."""
    parameters = inspect.signature(function).parameters
    return {name: parameter.default for name, parameter in parameters.items() if name not in FIELDS}


def _refuse_unknown(method: str, options: Mapping[str, Any], known: Mapping[str, Any]) -> None:
    unknown = [name for name in options if name not in known]
    if unknown:
        message = f"option: {method} has no {unknown[0]!r}; it takes {', '.join(known)}"
        raise InputError(message)


def _fields_for(info: MethodInfo, correspondences: Correspondences) -> Fields:
    for name in info.fields:
        if getattr(correspondences, name) is None:
            modest = [other.name for other in METHOD_INFO.values() if other.fields == ("source", "target")]
            message = (
                f"method: {info.name} needs `{name}`, which these correspondences lack; "
                f"give `Correspondences` with it, or use a method that does without: {', '.join(modest)}"
            )
            raise InputError(message)
    return Fields(**{name: getattr(correspondences, name) for name in (*info.fields, *info.optional_fields)})
