"""One function for all grouping methods, on one problem or on many."""

from __future__ import annotations

import inspect
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

from cgroup._arguments import as_count
from cgroup._memory import default_max_memory
from cgroup.errors import InputError
from cgroup.registry import ALIASES, METHODS, PRESETS
from cgroup.types import OPTIONAL_FIELDS, Correspondences, FloatArray, Grouping

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping


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
        One of `METHODS`.
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
    method = ALIASES.get(method, method)
    function = METHODS.get(method)
    if function is None:
        message = f"method: got {method!r}; choose one of {', '.join(METHODS)}"
        raise InputError(message)
    if preset not in PRESETS:
        message = f"preset: got {preset!r}; choose one of {', '.join(PRESETS)}"
        raise InputError(message)
    parameters = _parameters(function)
    _refuse_unknown(method, options, parameters)
    fields = _fields_for(method, correspondences, parameters)
    result = function(**{**fields, **PRESETS[preset].get(method, {}), **options})
    return replace(result, _positions=(correspondences.source, correspondences.target))


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
    workers = os.cpu_count() or 1 if threads is None else as_count("threads", threads, 1)
    stopped = threading.Event()

    def stop_with_the_others(_share: float) -> None:
        if stopped.is_set():
            raise InterruptedError

    options = {"threads": 1, **options}
    parameters = _parameters(METHODS[method]) if method in METHODS else {}
    if "max_memory" in parameters:
        options = {"max_memory": default_max_memory() // workers, **options}
    if "progress" in parameters:
        options = {"progress": stop_with_the_others, **options}
    pool = ThreadPoolExecutor(max_workers=workers)
    try:
        return list(pool.map(lambda problem: group(problem, method, preset=preset, **options), problems))
    finally:
        stopped.set()
        pool.shutdown(cancel_futures=True)


@cache
def _parameters(function: Callable[..., Grouping]) -> Mapping[str, inspect.Parameter]:
    return inspect.signature(function).parameters


def _refuse_unknown(method: str, options: Mapping[str, Any], parameters: Mapping[str, Any]) -> None:
    known = [name for name in parameters if name not in ("source", "target", *OPTIONAL_FIELDS)]
    unknown = [name for name in options if name not in known]
    if unknown:
        message = f"option: {method} has no {unknown[0]!r}; it takes {', '.join(known)}"
        raise InputError(message)


def _fields_for(
    method: str, correspondences: Correspondences, parameters: Mapping[str, inspect.Parameter]
) -> dict[str, FloatArray | float]:
    fields: dict[str, FloatArray | float] = {}
    for name in ("source", "target", *OPTIONAL_FIELDS):
        if name not in parameters:
            continue
        value = getattr(correspondences, name)
        if value is not None:
            fields[name] = value
        elif parameters[name].default is inspect.Parameter.empty:
            message = (
                f"method: {method} needs `{name}`, which these correspondences lack; "
                "give it to Correspondences, or use a method that does without: ransac, st, gc, gtm"
            )
            raise InputError(message)
    return fields
