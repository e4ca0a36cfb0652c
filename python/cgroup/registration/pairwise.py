"""Register prepared scans pair by pair: what `register` and the rooms of many scans have in common.

`as_given` checks a scan, `agree` chooses voxel and radii of all, and `Preparation` prepares each.
`Search.run` finds the pose of two, `confirm_pose` refines and weighs a given one; both return a `Found`.
`judge` decides, and `registration_of` returns the result. `share_probability` and the functions beside it
compare poses of several pairs.
"""

from collections.abc import Iterable, Sequence

from numpy.typing import ArrayLike

from cgroup._checks.values import as_count, as_items, refusal
from cgroup.errors import InputError
from cgroup.registration.decoys import FalseAccepts, count_false_accepts
from cgroup.registration.judge import (
    ACCEPTED,
    AS_GOOD,
    Case,
    Found,
    are_alternatives,
    bound_by_motions,
    bound_by_size,
    choose_apart,
    is_accepted,
    judge,
    share_left,
    share_probability,
)
from cgroup.registration.prepare import (
    FINE,
    LEAST_VOXELS,
    DenseFront,
    Given,
    Preparation,
    PreparedScan,
    agree,
    as_given,
)
from cgroup.registration.result import Registration, merge_clouds, registration_of
from cgroup.registration.search import EFFORTS, Depth, Effort, Region, Search, confirm_pose

__all__ = [
    "ACCEPTED", "AS_GOOD", "EFFORTS", "FINE", "LEAST_VOXELS", "Case", "DenseFront", "Depth", "Effort",
    "FalseAccepts", "Found", "Given", "Preparation", "PreparedScan", "Region", "Registration", "Search",
    "agree", "are_alternatives", "as_given", "as_pairs", "as_viewpoints", "bound_by_motions",
    "bound_by_size", "choose_apart", "confirm_pose", "count_false_accepts", "is_accepted", "judge",
    "merge_clouds", "registration_of", "share_left", "share_probability",
]  # fmt: skip


def as_pairs(pairs: Iterable[tuple[int, int]], scans: int) -> list[tuple[int, int]]:
    """Check pairs of rows."""
    checked: list[tuple[int, int]] = []
    remedy = "give two rows of scans, source and target"
    for number, pair in enumerate(as_items("pairs", pairs, f"for each pair {remedy}")):
        name = f"pairs[{number}]"
        rows = as_items(name, pair, remedy)
        if len(rows) != 2:
            raise refusal(name, pair, remedy)
        source, target = (as_count(name, row, 0) for row in rows)
        if max(source, target) >= scans:
            raise InputError(name, f"{(source, target)}, but there are {scans} scans", "rows begin with 0")
        checked.append((source, target))
    return checked


def as_viewpoints(
    viewpoints: Sequence[ArrayLike | None] | None, shared: ArrayLike | None, scans: int
) -> Sequence[ArrayLike | None]:
    """Return one viewpoint per scan; check their number if each has its own."""
    if viewpoints is None:
        return [shared] * scans
    if shared is not None:
        raise InputError(
            "viewpoint, view_direction, viewpoints",
            remedy="give one of them: a place, a direction, or one place per scan",
        )
    places = as_items("viewpoints", viewpoints, "give one per scan, or None for it")
    if len(places) != scans:
        raise InputError(
            "viewpoints", f"{len(places)} for {scans} scans", "give one per scan, or None for it"
        )
    return places
