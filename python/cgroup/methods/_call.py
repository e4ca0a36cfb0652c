"""Calls of grouping methods: from checked arguments to the group."""

from typing import Any

from cgroup import _core
from cgroup._checks.arrays import RealArray
from cgroup._checks.values import run_options
from cgroup._runtime.memory import max_memory_for, report_refused_memory
from cgroup.types import Agreement, Grouping, Rule
from cgroup.types.fields import FIELDS, Fields, check_fields


@report_refused_memory()
def call(method: str, arguments: dict[str, Any]) -> Grouping:
    """Group by a method with its named arguments; `arguments` is emptied."""
    given = {name: arguments.pop(name) for name in FIELDS if name in arguments}
    fields = check_fields(**given)
    # Copies of one's own: the caller's buffers may hold other points by the time of transform().
    return compute(method, fields, arguments, _copies(fields), fields.resolution)


def compute(
    method: str,
    fields: Fields,
    options: dict[str, Any],
    positions: tuple[RealArray, RealArray] | None,
    resolution: float | None,
) -> Grouping:
    """Group by checked fields.

    `options` are all options of the method, with `threads`, and `max_memory`, `progress` and `max_seconds`
    where it has them; they are used up. `positions` are points that nothing will change, for
    `Grouping.transform`; the resolution is for `Grouping.explain`.
    """
    threads, progress = options.pop("threads"), options.pop("progress", None)
    max_seconds = options.pop("max_seconds", None)
    max_memory = options.pop("max_memory", 0)
    if max_memory is None:
        max_memory = max_memory_for(0 if fields.source is None else len(fields.source))
    run = run_options(threads, max_memory, progress, max_seconds)
    return grouping_of(_core.group(method, fields, run, options), method, positions, resolution)


def grouping_of(
    parts: tuple[Any, Any, Any],
    method: str,
    positions: tuple[RealArray, RealArray] | None,
    resolution: float | None,
) -> Grouping:
    """Return the grouping of the core's parts."""
    found, rule, pairs = parts
    agreement = None if pairs is None else Agreement(**pairs)
    rule = Rule(method, agreement=agreement, resolution=resolution, **rule)
    return Grouping(**found, rule=rule, _positions=positions)


def _copies(fields: Fields) -> tuple[RealArray, RealArray] | None:
    if fields.source is None or fields.target is None:
        return None
    return fields.source.copy(), fields.target.copy()
