"""Descriptors by Open3D, from the extra ``cgroup[open3d]``."""

import importlib
from typing import Any

import numpy as np

from cgroup._checks.arrays import in_double
from cgroup.errors import CgroupError, InputError
from cgroup.types import IndexArray, RealArray

HELP = (
    "install it with `pip install cgroup[open3d]`; on Debian and Ubuntu it also needs the packages "
    "libegl1 libgl1 libx11-6 libusb-1.0-0 libidn2-0 libudev1 libgomp1"
)


def iss(
    points: RealArray, salient: float, nms: float, gamma_21: float, gamma_32: float, min_neighbors: int
) -> IndexArray:
    """Find Open3D's ISS keypoints, as rows of the cloud."""
    open3d = _load()
    cloud = in_double(points)
    copy = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(cloud))
    found = open3d.geometry.keypoint.compute_iss_keypoints(
        copy, salient, nms, gamma_21, gamma_32, min_neighbors
    )
    # Open3D gives coordinates; the lowest row that has them is the keypoint.
    rows = {tuple(point): row for row, point in reversed(list(enumerate(cloud.tolist())))}
    return np.array(sorted(rows[tuple(point)] for point in np.asarray(found.points).tolist()), dtype=np.int64)


def refuse_options(*, density_weight: bool, count: int | None) -> None:
    """Raise for options of ISS that Open3D does not have."""
    for name, given in (("density_weight", density_weight), ("count", count is not None)):
        if given:
            raise InputError(name, remedy="Open3D's detector has no such option; use backend='cgroup'")


def _load() -> Any:  # noqa: ANN401 - Open3D has no types
    try:
        return importlib.import_module("open3d")
    except (ImportError, OSError) as error:
        raise CgroupError(f"Open3D can't be imported ({error}); {HELP}") from error
