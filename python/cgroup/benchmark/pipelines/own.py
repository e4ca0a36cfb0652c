"""cgroup's pipelines."""

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cgroup import features
from cgroup._runtime.progress import StageClock
from cgroup.benchmark.pipelines.answer import Answer, Clouds
from cgroup.errors import NoConsensusError
from cgroup.features import Viewpoint
from cgroup.group import group
from cgroup.registration import DenseFront, Effort, PaperFront, correspond, register
from cgroup.registration.prepare import NORMAL_NEIGHBORS, UNIT
from cgroup.types import Correspondences, FloatArray, RealArray


def dense(clouds: Clouds, clock: StageClock, *, viewpoints: bool = True, effort: Effort = "normal") -> Answer:
    """Run `register` with its dense front end, with the known viewpoints unless `viewpoints` is false."""
    return _register(clouds, clock, viewpoints=viewpoints, effort=effort)


def paper(clouds: Clouds, clock: StageClock, *, method: str = "gtm", keypoints: int | None = None) -> Answer:
    """Run `register` with the keypoints of the paper's evaluation."""
    return _register(clouds, clock, front=PaperFront(keypoints=keypoints), method=method)


def _register(
    clouds: Clouds,
    clock: StageClock,
    *,
    viewpoints: bool = True,
    **options: Any,  # noqa: ANN401 - of `register`
) -> Answer:
    if viewpoints:
        options["source_viewpoint"] = clouds.source_viewpoint
        options["target_viewpoint"] = clouds.target_viewpoint
    options |= {"voxel": clouds.voxel, "threads": clouds.threads, "progress": clock.start}
    try:
        found = register(clouds.source, clouds.target, **options)
    except NoConsensusError as error:
        if error.registration is None:
            return Answer(None, ok=False)
        found = error.registration
    decoy = np.nan if found.decoy_probability is None else found.decoy_probability
    return Answer(found.T_target_source, found.ok, found.probability, found.covariance, decoy)


def matches(
    clouds: Clouds,
    clock: StageClock,
    *,
    front: Literal["dense", "paper"] = "dense",
    method: str = "lc",
    **options: Any,  # noqa: ANN401 - of the method
) -> Answer:
    """Return the pose of a group of matches, without verification on surfaces.

    Matches are the mutual ones of a dense front end, or those of the paper's evaluation.
    """
    if front == "dense":
        correspondences = _match_voxels(clouds, clock)
    else:
        correspondences = correspond(
            clouds.source,
            clouds.target,
            source_viewpoint=clouds.source_viewpoint or features.ORIGIN,
            target_viewpoint=clouds.target_viewpoint or features.ORIGIN,
            threads=clouds.threads,
            progress=clock.start,
        )
    clock.start("grouping")
    try:
        grouping = group(correspondences, method, threads=clouds.threads, **options)
        return Answer(grouping.transform(), ok=True)
    except NoConsensusError:
        return Answer(None, ok=False)


def _match_voxels(clouds: Clouds, clock: StageClock) -> Correspondences:
    clock.start("features")
    voxel, threads = clouds.voxel, clouds.threads
    _, source, ours = describe_voxels(clouds.source, clouds.source_viewpoint, voxel, threads=threads)
    _, target, theirs = describe_voxels(clouds.target, clouds.target_viewpoint, voxel, threads=threads)
    clock.start("matching")
    found = features.match(ours, theirs, mutual=True, threads=threads)
    return Correspondences(
        source[found.source_indices], target[found.target_indices], ratio=found.ratio, resolution=UNIT * voxel
    )


def describe_voxels(
    points: RealArray,
    viewpoint: Viewpoint | None,
    voxel: float,
    *,
    normals: FloatArray | None = None,
    threads: int | None = None,
) -> tuple[features.Cloud, FloatArray, NDArray[np.float32]]:
    """Return the voxels of a cloud, indexed and as points, and their FPFH; given normals set the side."""
    voxels = features.voxel_downsample(points, voxel, normals=normals, threads=threads)
    cloud = features.Cloud(voxels.points)
    planes = features.normals(
        cloud,
        radius=DenseFront.normal_radius * voxel,
        neighbors=NORMAL_NEIGHBORS,
        viewpoint=viewpoint or features.ORIGIN,
        threads=threads,
    )
    if voxels.normals is not None:
        planes *= np.where(np.einsum("ij,ij->i", planes, voxels.normals) < 0, -1.0, 1.0)[:, None]
    values = features.fpfh(cloud, planes, radius=DenseFront.support * voxel, threads=threads)
    return cloud, voxels.points, values
