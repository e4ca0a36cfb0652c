"""Fields of correspondences: the data that a method takes besides its options."""

from __future__ import annotations

from typing import NamedTuple

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


def check_fields(
    source: object,
    target: object,
    *,
    similarity: ArrayLike | None = None,
    ratio: ArrayLike | None = None,
    source_lrf: ArrayLike | None = None,
    target_lrf: ArrayLike | None = None,
    resolution: float | None = None,
    source_centroid: ArrayLike | None = None,
    candidates: ArrayLike | None = None,
) -> Fields:
    """Check shapes and types; nothing is copied without need."""
    points = real_points("source", source)
    n = len(points)
    _check_frames_on_both_sides(source_lrf, target_lrf)
    return Fields(
        points,
        _partners(target, n),
        None if similarity is None else real_vector("similarity", similarity, n),
        None if ratio is None else real_vector("ratio", ratio, n),
        None if source_lrf is None else real_frames("source_lrf", source_lrf, n),
        None if target_lrf is None else real_frames("target_lrf", target_lrf, n),
        None if resolution is None else as_number("resolution", resolution),
        None if source_centroid is None else _centroid(source_centroid),
        None if candidates is None else real_candidates("candidates", candidates, n),
    )


def check_scores(*, similarity: ArrayLike | None = None, ratio: ArrayLike | None = None) -> Fields:
    """Check the field of a method that takes no points."""
    return Fields(
        similarity=None if similarity is None else real_vector("similarity", similarity, None),
        ratio=None if ratio is None else real_vector("ratio", ratio, None),
    )


def _check_frames_on_both_sides(source_lrf: ArrayLike | None, target_lrf: ArrayLike | None) -> None:
    if (source_lrf is None) != (target_lrf is None):
        missing = "source_lrf" if source_lrf is None else "target_lrf"
        raise InputError(missing, remedy="missing; frames are needed on both sides or on neither")


def _partners(target: object, rows: int) -> RealArray:
    points = real_points("target", target)
    if len(points) != rows:
        raise InputError(
            "target",
            f"{len(points)} rows, but source has {rows}",
            "row i of one matches row i of the other",
        )
    return points


def _centroid(value: ArrayLike) -> RealArray:
    array = as_reals("source_centroid", value)
    if array.shape != (3,):
        raise InputError("source_centroid", f"shape {array.shape}", "give the three coordinates of one point")
    return array
