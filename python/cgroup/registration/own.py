"""What the user proposes: matches and descriptors of the input points, or a rough pose."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cgroup import features
from cgroup._checks.arrays import as_rows, in_double
from cgroup._checks.values import as_items, as_length, refusal
from cgroup.errors import InputError
from cgroup.features import DescribedCloud
from cgroup.features.matching import as_descriptors
from cgroup.features.voxels import thin
from cgroup.fronts.matching import frame_poses
from cgroup.registration.prepare import UNIT, PreparedScan
from cgroup.rigid import check_rigid
from cgroup.rigid.transforms import are_rigid
from cgroup.types import Correspondences, FloatArray, IndexArray, RealArray
from cgroup.types.fields import FIELDS, Fields, own_correspondences

ANGLE, RADIUS = 15.0, 0.2  # default error of a rough pose: degrees, and share of the source's diagonal
MOST_TURNED = 60.0  # angle in degrees beyond which a global search is faster
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
    inside = (scan.scan.given >= kept.min(axis=0)) & (scan.scan.given <= kept.max(axis=0))  # no outliers
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


def as_nearby(initial: ArrayLike | None, radius: float | None, angle: float | None) -> Nearby | None:
    """Check a rough pose, if any, and its largest error."""
    errors = {"radius": radius, "angle": angle}
    given = {name: as_length(name, value) for name, value in errors.items() if value is not None}
    if initial is None:
        for name, value in given.items():
            raise InputError(name, f"{value:g}, but no `initial`", "it is the largest error of that pose")
        return None
    degrees = given.get("angle", ANGLE)
    if degrees > MOST_TURNED:
        raise refusal("angle", angle, f"give {MOST_TURNED:g} degrees at most, or no `initial`")
    return Nearby(check_rigid(initial, "initial"), degrees, given.get("radius", 0.0))


class Nearby(NamedTuple):
    """A rough pose, and its largest error."""

    pose: FloatArray  # (4,4), pose of the source in the target's frame
    angle: float  # error of its rotation, in degrees
    radius: float  # error at the middle of the source; 0 for the default until `around`

    def around(self, source: PreparedScan) -> Nearby:
        """Return the rough pose with the default radius of a source, unless a radius was given."""
        return self._replace(radius=self.radius or RADIUS * source.scan.diagonal)
