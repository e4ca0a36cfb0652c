"""Validated inputs for drawing a result."""

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from cgroup._checks.arrays import BoolArray, FloatArray, finite_points
from cgroup._checks.calls import call_hook
from cgroup._checks.values import as_flag, refusal
from cgroup.errors import InputError
from cgroup.rigid import check_rigid


@dataclass(frozen=True, eq=False)
class Drawing:
    """Two clouds and matches between them."""

    source: FloatArray
    target: FloatArray
    matches: Any
    mask: BoolArray  # which are selected
    pose: FloatArray  # of the source in the target's frame; the identity if unknown
    correct: BoolArray | None  # which are correct, where that is known
    grouping: Any  # the group, or None
    title: str
    is_placed: bool = False  # whether the pose is the result


def plot(
    given: Mapping[str, Any],
    matches: Any,  # noqa: ANN401 - types lie in higher layers
    mask: BoolArray,
    *,
    interactive: bool,
    title: str,
    grouping: Any = None,  # noqa: ANN401 - likewise
    is_placed: bool = False,
) -> Any:  # noqa: ANN401 - a figure of matplotlib or plotly
    """Check the `source`, `target`, `pose` and `correct` given to `plot` of a result, and draw it."""
    pose, correct = given["pose"], given["correct"]
    drawing = Drawing(
        source=as_points("source", matches.source if given["source"] is None else given["source"]),
        target=as_points("target", matches.target if given["target"] is None else given["target"]),
        matches=matches,
        mask=mask,
        pose=np.eye(4) if pose is None else check_rigid(pose, "T_target_source"),
        correct=None if correct is None else as_flags("correct", correct, len(mask)),
        grouping=grouping,
        title=title,
        is_placed=is_placed,
    )
    hook = "chart" if as_flag("interactive", interactive) else "figure"
    with naming_missing_library():
        return call_hook(hook, drawing)


@contextmanager
def naming_missing_library() -> Generator[None, None, None]:
    """Raise `InputError` with the command that installs a missing library."""
    try:
        yield
    except ModuleNotFoundError as missing:
        raise InputError(f"drawing needs {missing.name}; pip install 'cgroup[scans]'") from missing


def as_points(name: str, cloud: Any) -> FloatArray:  # noqa: ANN401 - a cloud of any kind
    """Return the points of a cloud, at least one."""
    array = finite_points(name, getattr(cloud, "points", cloud))
    if len(array) == 0:
        raise refusal(name, array, "give a cloud with points, or matches")
    return array


def as_flags(name: str, flags: Any, count: int) -> BoolArray:  # noqa: ANN401 - whatever is given
    """Return one truth value for each match."""
    array = np.asarray(flags)
    if array.dtype != bool or array.shape != (count,):
        raise refusal(name, flags, f"give an array of {count} bool")
    return array
