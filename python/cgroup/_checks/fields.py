"""Fields of correspondences: the data that a method takes besides its options."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from numpy.typing import ArrayLike

from cgroup._checks.array_types import RealArray
from cgroup._checks.arrays import as_reals, real_candidates, real_frames, real_points, real_vector
from cgroup._checks.values import as_number
from cgroup.errors import InputError


class Fields(NamedTuple):
    """Fields of the right shapes, in the precision that the caller has; None for those not given."""

    source: RealArray | None = None
    target: RealArray | None = None
    similarity: RealArray | None = None
    ratio: RealArray | None = None
    source_lrf: RealArray | None = None
    target_lrf: RealArray | None = None
    resolution: float | None = None
    source_centroid: RealArray | None = None
    candidates: RealArray | None = None


FIELDS = Fields._fields

OPTIONAL_FIELDS = FIELDS[2:]
"""All but the points."""


def check_fields(**given: Any) -> Fields:  # noqa: ANN401 - by name, None for those not given
    """Check shapes and types; nothing is copied without need. A method of scores alone takes no points."""
    source = real_points("source", given.pop("source")) if "source" in given else None
    rows = None if source is None else len(source)
    _check_frames_on_both_sides(given.get("source_lrf"), given.get("target_lrf"))
    checked = {
        name: _CHECKS[name](name, value, rows)
        for name, value in given.items()
        if value is not None or name == "target"
    }
    return Fields(source=source, **checked)


def _check_frames_on_both_sides(source_lrf: ArrayLike | None, target_lrf: ArrayLike | None) -> None:
    if (source_lrf is None) != (target_lrf is None):
        missing = "source_lrf" if source_lrf is None else "target_lrf"
        raise InputError(missing, remedy="missing; frames are needed on both sides or on neither")


def _partners(name: str, target: object, rows: int) -> RealArray:
    points = real_points(name, target)
    if len(points) != rows:
        raise InputError(
            name,
            f"{len(points)} rows, but source has {rows}",
            "row i of one matches row i of the other",
        )
    return points


def _centroid(name: str, value: ArrayLike, _rows: int) -> RealArray:
    array = as_reals(name, value)
    if array.shape != (3,):
        raise InputError(name, f"shape {array.shape}", "give the three coordinates of one point")
    return array


_CHECKS: dict[str, Callable[..., Any]] = {
    "target": _partners,
    "similarity": real_vector,
    "ratio": real_vector,
    "source_lrf": real_frames,
    "target_lrf": real_frames,
    "resolution": lambda name, value, _rows: as_number(name, value),
    "source_centroid": _centroid,
    "candidates": real_candidates,
}
"""What checks a field: a function of its name, its value and the number of matches."""
