"""Scenes as one cloud, and as files of poses."""

from __future__ import annotations

import colorsys
import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cgroup import features
from cgroup._checks.arrays import in_double
from cgroup.errors import InputError
from cgroup.registration import PreparedScan
from cgroup.scenes.graph_files import motion_lines
from cgroup.types import PointCloud, as_cloud

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import NDArray

    from cgroup.types import AnyCloud, FloatArray, IndexArray

_FIRST_COLORS = "#E69F00 #0072B2 #009E73 #CC79A7 #56B4E9 #D55E00 #B8AC1B #7A5195"
"""As orange and blue of two scans, further colours that are told apart by every common kind of vision."""

_GOLDEN = 0.618
"""Of a turn between the hues of one scan and the next: they never come near soon."""


def scan_colors(count: int) -> NDArray[np.uint8]:
    """Return red, green and blue of so many scans."""
    colors = [tuple(bytes.fromhex(color[1:])) for color in _FIRST_COLORS.split()]
    for number in range(len(colors), count):
        light = (0.42, 0.58, 0.7)[number % 3]
        parts = colorsys.hls_to_rgb(_GOLDEN * number % 1, light, 0.62)
        colors.append((round(255 * parts[0]), round(255 * parts[1]), round(255 * parts[2])))
    return np.array(colors[:count], np.uint8).reshape(-1, 3)


def cloud_of(name: str, scan: AnyCloud | PreparedScan) -> PointCloud:
    """Return the cloud of a scan: that of a path is read, a prepared scan has its own."""
    if isinstance(scan, PreparedScan):
        return PointCloud(in_double(scan.scan.cloud.points), scan.scan.normals)
    return as_cloud(name, scan)


def merge(clouds: Sequence[PointCloud], colors: NDArray[np.uint8], voxel: float | None) -> PointCloud:
    """Make one cloud of posed ones, each with a colour of its own where not all have theirs."""
    if voxel is None:
        voxel = min(features.resolution(cloud.points, ignore_zero=True) for cloud in clouds)
    normals = [cloud.normals for cloud in clouds if cloud.normals is not None]
    own = [cloud.colors for cloud in clouds if cloud.colors is not None]
    if len(own) < len(clouds):
        own = [np.broadcast_to(color, (len(cloud), 3)) for cloud, color in zip(clouds, colors, strict=True)]
    every = PointCloud(
        np.concatenate([cloud.points for cloud in clouds]),
        np.concatenate(normals) if len(normals) == len(clouds) else None,
        colors=np.concatenate(own),
    )
    voxels = features.voxel_downsample(every, voxel)
    return PointCloud(voxels.points, voxels.normals, colors=voxels.colors)


def _format_tum(poses: FloatArray, rows: IndexArray) -> str:
    lines = zip(rows.tolist(), motion_lines(poses), strict=True)
    return "# row of the scan, tx ty tz qx qy qz qw\n" + "".join(f"{row} {line}\n" for row, line in lines)


def _format_kitti(poses: FloatArray, rows: IndexArray) -> str:  # noqa: ARG001 - it has no numbers
    return "".join(f"{_numbers(pose[:3].ravel())}\n" for pose in poses)


def _format_log(poses: FloatArray, rows: IndexArray) -> str:
    blocks = [
        [f"{row} {row} {row + 1}", *map(_numbers, pose)]
        for row, pose in zip(rows.tolist(), poses, strict=True)
    ]
    return "".join(f"{line}\n" for block in blocks for line in block)


def _numbers(values: FloatArray) -> str:
    return " ".join(map(repr, values.tolist()))


POSE_FORMATS: dict[str, Callable[[FloatArray, IndexArray], str]] = {
    ".tum": _format_tum,
    ".kitti": _format_kitti,
    ".log": _format_log,
}
"""What writes poses and the rows of their scans, by suffix."""


def refuse_inputs(path: Path, scans: Iterable[object]) -> None:
    """Raise `InputError` where an output would replace a scan, by whatever name."""
    for scan in scans:
        if isinstance(scan, str | os.PathLike) and path.exists():
            given = Path(scan)
            if given.exists() and given.samefile(path):
                message = f"{path}: is one of the scans, and would be replaced; write elsewhere"
                raise InputError(message)
