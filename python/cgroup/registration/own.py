"""Matches and descriptors of the user, by the input points of the clouds."""

from __future__ import annotations

from typing import Any

import numpy as np

from cgroup import features
from cgroup._checks.arrays import as_rows, in_double
from cgroup._checks.values import as_items, as_length, refusal
from cgroup.errors import InputError
from cgroup.features import DescribedCloud
from cgroup.features.matching import as_descriptors
from cgroup.features.voxels import thin
from cgroup.registration.matching import frame_poses
from cgroup.registration.prepare import UNIT, PreparedScan
from cgroup.rigid.transforms import are_rigid
from cgroup.types import Correspondences, IndexArray, RealArray
from cgroup.types.fields import FIELDS, Fields, own_correspondences

_ROWS = "give Correspondences, or (i, j): rows of matched points, such as rows.T of an (n,2) array"


def as_matches(matches: object, source: PreparedScan, target: PreparedScan) -> Correspondences:
    """Check matches, given as rows of the input clouds or as positions; add the fields for methods."""
    given = matches if isinstance(matches, Correspondences) else _matches_of_rows(matches, source, target)
    for name, points in (("matches.source", given.source), ("matches.target", given.target)):
        wrong = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if len(wrong):
            raise InputError(
                name, f"{points[wrong[0]].tolist()} in row {wrong[0]}", "drop matches without a place"
            )
    if not are_rigid(frame_poses(given)).all():
        raise InputError(
            "matches.source_lrf, matches.target_lrf",
            remedy="give frames whose rows are x, y and z axes, NaN for none",
        )
    fields = {name: getattr(given, name) for name in FIELDS}
    fields["resolution"] = UNIT * source.voxel
    if given.resolution is not None:
        fields["resolution"] = as_length("matches.resolution", given.resolution)
    fields["source_centroid"] = source.scan.centroid
    return own_correspondences(Fields(**fields))


def _matches_of_rows(matches: Any, source: PreparedScan, target: PreparedScan) -> Correspondences:  # noqa: ANN401 - of the user's
    sides = as_items("matches", matches, _ROWS)
    if len(sides) != 2:
        raise refusal("matches", matches, _ROWS)
    one, other = (
        _rows_of(f"matches[{side}]", sides[side], scan) for side, scan in enumerate((source, target))
    )
    if len(one) != len(other):
        counts = f"{len(one)} rows of the source and {len(other)} of the target"
        raise InputError("matches", counts, "row k of one matches row k of the other")
    return Correspondences(source.scan.given[one], target.scan.given[other])


def _rows_of(name: str, value: Any, scan: PreparedScan) -> IndexArray:  # noqa: ANN401 - of the user's
    rows, count = as_rows(name, value), len(scan.scan.given)
    if rows.max(initial=-1) >= count:
        raise InputError(name, f"row {rows.max()} of {count} points", "rows begin with 0")
    return rows


def match_nothing(source: PreparedScan) -> Correspondences:
    """Return empty matches, for a pose without matches."""
    nothing = np.empty((0, 3))
    unit = UNIT * source.voxel
    return own_correspondences(
        Fields(nothing, nothing, resolution=unit, source_centroid=source.scan.centroid)
    )


def as_own_descriptors(
    descriptors: object, source: PreparedScan, target: PreparedScan
) -> tuple[RealArray, RealArray]:
    """Check descriptors of the input points, NaN for points without one."""
    remedy = "give two arrays, one row per point of source and target, NaN for none"
    sides = as_items("descriptors", descriptors, remedy)
    if len(sides) != 2:
        raise refusal("descriptors", descriptors, remedy)
    one, other = (
        _descriptors_of(f"descriptors[{side}]", sides[side], scan)
        for side, scan in enumerate((source, target))
    )
    if one.shape[1] != other.shape[1]:
        lengths = f"{one.shape[1]} and {other.shape[1]} columns"
        raise InputError("descriptors", lengths, "describe both clouds alike")
    return one, other


def _descriptors_of(name: str, value: Any, scan: PreparedScan) -> RealArray:  # noqa: ANN401 - of the user's
    values, count = as_descriptors(name, value), len(scan.scan.given)
    if len(values) != count:
        raise InputError(name, f"{len(values)} rows for {count} points", "give one per point, NaN for none")
    if not np.isfinite(values).all(axis=1).any():
        raise InputError(name, "no finite row", "describe some of the points")
    return values


def describe_voxels(scan: PreparedScan, values: RealArray) -> DescribedCloud:
    """Return the first described point of each voxel, with the frame of the nearest voxel."""
    known, kept = scan.described, scan.scan.cloud.points
    inside = (scan.scan.given >= kept.min(axis=0)) & (scan.scan.given <= kept.max(axis=0))  # no strays
    rows = np.flatnonzero(np.isfinite(values).all(axis=1) & inside.all(axis=1))
    points = in_double(scan.scan.given[rows])
    voxels = thin(points, scan.voxel, threads=scan.threads).indices
    first = np.unique(voxels, return_index=True)[1]
    rows, points = rows[first], points[first]
    middle = scan.scan.centroid
    nearest = features.match(points - middle, known.points - middle, threads=scan.threads).target_indices
    return DescribedCloud(
        rows, points, known.lrf[nearest], values[rows].astype(np.float32), UNIT * scan.voxel, middle
    )
