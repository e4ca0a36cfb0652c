"""One scan or model, made ready for registration with any number of others."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cgroup import features
from cgroup._checks.values import as_choice, as_instance, as_length
from cgroup._runtime.progress import as_stage_function
from cgroup.errors import InputError
from cgroup.registration.mesh import as_model
from cgroup.registration.prepared import VOXELS, DenseFront, PreparedScan, prepare_scan
from cgroup.registration.scan import NORMALS, as_scan

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from cgroup.features import Cloud
    from cgroup.registration.scan import Normals
    from cgroup.types import PointCloud


def prepare(
    cloud: PointCloud | Cloud | ArrayLike,
    *,
    voxel: float | None = None,
    viewpoint: ArrayLike | None = None,
    normals: Normals = "pca",
    front: DenseFront | None = None,
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> PreparedScan:
    """Make a scan ready for registration with any number of others.

    Parameters
    ----------
    cloud : PointCloud, Cloud or (N,3) array_like of float
        Whole cloud.
    voxel : float, optional
        Edge length of the voxels, in the unit of the points; by default about 5,000 of them (see
        `cgroup.features.choose_voxel`). Clouds to be registered need the same.
    viewpoint : (3,) array_like of float, optional
        Where the scanner stood, in the cloud's frame, if the cloud is one single scan: what lies before
        the scanned surface then speaks against a pose.
    normals : {"pca", "mesh", "given"}
        What tells the outside of a whole model: nothing, its faces (which are then sampled too), or
        `PointCloud.normals`. A model that is looked for in a scan with a viewpoint needs it. The planes
        themselves are always fitted to the voxels.
    front : DenseFront, optional
        Radii of normals, frames and descriptors, in voxels.
    threads : int, optional
        Threads to compute on, None for all cores.
    progress : callable, optional
        Called with the name of each stage as it begins.

    Returns
    -------
    PreparedScan
        Voxels, normals, frames, descriptors and surface, for `register`, `register_many` and `recognize`.

    Raises
    ------
    InputError
        If the cloud is not finite, or the voxel leaves too little or too much of it; for an option that is
        unknown or out of range, faces or normals that the cloud lacks, or a viewpoint beside normals of a
        whole model.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.registration import prepare, register
    >>> pair = standin_pair(pixels=60)
    >>> target = prepare(pair.target, voxel=6.0)
    >>> len(target) > 100, register(pair.source, target).ok
    (True, True)
    """
    as_choice("normals", normals, NORMALS)
    if normals != "pca" and viewpoint is not None:
        message = f"viewpoint, normals: got both, but {normals!r} normals are those of whole models; give one"
        raise InputError(message)
    scan = as_scan("cloud", cloud) if normals == "pca" else as_model("cloud", cloud, normals, voxel)
    size = features.choose_voxel(scan.cloud, voxels=VOXELS, threads=threads) if voxel is None else voxel
    begin = as_stage_function(progress)
    return prepare_scan(
        scan,
        as_length("voxel", size),
        viewpoint,
        DenseFront() if front is None else as_instance("front", front, DenseFront),
        threads,
        begin,
        by_frames=viewpoint is None and normals == "pca",
    )
