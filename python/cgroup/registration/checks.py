"""What can't be registered, and what to do about it: refused before any work is spent on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup._checks.arrays import as_place
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from cgroup.features import Viewpoint
    from cgroup.registration.scan import Scan
    from cgroup.types import FloatArray

LEAST_VOXELS = 100
"""Voxels below which unrelated clouds lie on each other too well by chance."""

MOST_VOXELS = 100_000
"""Voxels beyond which matching each with all others takes more than some 20 seconds."""

LEAST_PLANES, LEAST_PLANAR_VOXELS = 0.1, 30
"""Share and number of the voxels that have a normal, below which they are too far apart."""

MAX_RANGE = 1000.0
"""Distance of the viewpoint in diagonals of the cloud, beyond which it can't be meant."""

MAX_SIZE_RATIO = 100.0
"""Clouds that differ more than this are taken to be in different units; no voxel suits both."""


def check_sizes(scans: Sequence[Scan]) -> None:
    """Refuse clouds in different units."""
    sizes = [scan.cloud.diagonal for scan in scans]
    if max(sizes) > MAX_SIZE_RATIO * min(sizes):
        one, other = (scans[row] for row in sorted([sizes.index(min(sizes)), sizes.index(max(sizes))]))
        message = (
            f"{one.name}, {other.name}: {one.cloud.diagonal:.3g} and {other.cloud.diagonal:.3g} across; "
            "scale them to the same unit, or drop points far from all others"
        )
        raise InputError(message)


def check_voxels(scan: Scan, voxel: float, count: int) -> None:
    """Refuse voxels that leave too little or too much of a cloud."""
    got = f"{scan.name}: {len(scan.cloud)} points, {scan.cloud.diagonal:.4g} across, leave {count} voxels"
    if count < LEAST_VOXELS:
        message = (
            f"{got} of {voxel:.4g}, and {LEAST_VOXELS} are the least; give more points, a smaller `voxel`, "
            "or both clouds in the same unit"
        )
        raise InputError(message)
    if count > MOST_VOXELS:
        message = f"{got} of {voxel:.4g}, and {MOST_VOXELS} are the most; give a larger `voxel`"
        raise InputError(message)


def check_normals(scan: Scan, voxel: float, normals: FloatArray) -> None:
    """Refuse a cloud that is no surface at the size of its voxels."""
    planes = int(np.isfinite(normals).all(axis=1).sum())
    if planes < max(LEAST_PLANES * len(normals), LEAST_PLANAR_VOXELS):
        message = (
            f"{scan.name}: {planes} of its {len(normals)} voxels of {voxel:.4g} have neighbours that fix a "
            "plane; the points lie too far apart for such voxels, or on a line: give a larger `voxel`, or a "
            "cloud of a surface"
        )
        raise InputError(message)


def as_viewpoint(scan: Scan, viewpoint: ArrayLike) -> Viewpoint:
    """Return where the scanner stood, if that can be."""
    name = f"{scan.name}_viewpoint" if scan.name in {"source", "target"} else "viewpoint"
    x, y, z = as_place(name, viewpoint)
    with np.errstate(over="ignore"):  # to infinity, which is too far
        away = float(np.linalg.norm(np.array([x, y, z]) - scan.cloud.points[0]))
    if away > MAX_RANGE * scan.cloud.diagonal:
        message = (
            f"{name}: got ({x:.4g}, {y:.4g}, {z:.4g}), {away:.3g} from a cloud that is "
            f"{scan.cloud.diagonal:.3g} across; give the scanner's place in the cloud's frame and unit"
        )
        raise InputError(message)
    return x, y, z
