"""What Open3D computes; it comes with the extra ``cgroup[open3d]``."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup._arguments import in_double
from cgroup.errors import CgroupError, InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

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
    found = open3d.geometry.keypoint.compute_iss_keypoints(
        _cloud(open3d, cloud), salient, nms, gamma_21, gamma_32, min_neighbors
    )
    # Open3D gives coordinates; the lowest row that has them is the keypoint.
    rows = {tuple(point): row for row, point in reversed(list(enumerate(cloud.tolist())))}
    return np.array(sorted(rows[tuple(point)] for point in np.asarray(found.points).tolist()), dtype=np.int64)


def refuse_options(*, density_weight: bool, count: int | None) -> None:
    """Refuse options of ISS that Open3D does not have."""
    for name, given in (("density_weight", density_weight), ("count", count is not None)):
        if given:
            message = f"{name}: Open3D's detector has no such option; use backend='cgroup'"
            raise InputError(message)


def fpfh(
    points: RealArray, normals: RealArray, radius: float, max_neighbors: int | None
) -> NDArray[np.float32]:
    """Compute FPFH descriptors of all points."""
    open3d = _load()
    if len(points) == 0:
        return np.empty((0, 33), dtype=np.float32)
    parameters = open3d.geometry.KDTreeSearchParamRadius(radius)
    if max_neighbors is not None:
        parameters = open3d.geometry.KDTreeSearchParamHybrid(radius, max_neighbors)
    feature = open3d.pipelines.registration.compute_fpfh_feature(_cloud(open3d, points, normals), parameters)
    return np.ascontiguousarray(feature.data.T, dtype=np.float32)


def _load() -> Any:  # noqa: ANN401 - Open3D has no types
    try:
        return importlib.import_module("open3d")
    except (ImportError, OSError) as error:
        message = f"Open3D can't be imported ({error}); {HELP}"
        raise CgroupError(message) from error


def _cloud(open3d: Any, points: RealArray, normals: RealArray | None = None) -> Any:  # noqa: ANN401
    vectors = open3d.utility.Vector3dVector
    result = open3d.geometry.PointCloud(vectors(in_double(points)))
    if normals is not None:
        result.normals = vectors(in_double(normals))
    return result
