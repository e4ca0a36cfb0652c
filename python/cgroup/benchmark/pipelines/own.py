"""cgroup's ways to register."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from cgroup import features
from cgroup.benchmark.pipelines.answer import Answer
from cgroup.errors import NoConsensusError
from cgroup.group import group
from cgroup.registration import DenseFront, PaperFront, correspond, register
from cgroup.registration.prepare import NORMAL_NEIGHBORS, UNIT
from cgroup.types import Correspondences

if TYPE_CHECKING:
    from cgroup._runtime.progress import StageClock
    from cgroup.benchmark.pipelines.answer import Clouds
    from cgroup.features import Viewpoint
    from cgroup.registration.search import Effort
    from cgroup.types import FloatArray, RealArray


def dense(clouds: Clouds, clock: StageClock, *, viewpoints: bool = True, effort: Effort = "normal") -> Answer:
    """Run `register` with its dense front end; `viewpoints` says whether it is told those that are known."""
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
    return Answer(found.T_target_source, found.ok, found.probability)


def matches(
    clouds: Clouds,
    clock: StageClock,
    *,
    front: Literal["dense", "paper"] = "dense",
    method: str = "lc",
    **options: Any,  # noqa: ANN401 - of the method
) -> Answer:
    """Group matches, and take the group's pose, without a look at the surfaces.

    They are mutual matches of a dense front end, or those of the paper's evaluation.
    """
    correspondences = _match_voxels(clouds, clock) if front == "dense" else _match_keypoints(clouds, clock)
    clock.start("grouping")
    try:
        grouping = group(correspondences, method, threads=clouds.threads, **options)
        return Answer(grouping.transform(), ok=True)
    except NoConsensusError:
        return Answer(None, ok=False)


def _match_keypoints(clouds: Clouds, clock: StageClock) -> Correspondences:
    return correspond(
        clouds.source,
        clouds.target,
        source_viewpoint=clouds.source_viewpoint or features.ORIGIN,
        target_viewpoint=clouds.target_viewpoint or features.ORIGIN,
        threads=clouds.threads,
        progress=clock.start,
    )


def _match_voxels(clouds: Clouds, clock: StageClock) -> Correspondences:
    clock.start("features")
    source = _describe(clouds.source, clouds.source_viewpoint, clouds)
    target = _describe(clouds.target, clouds.target_viewpoint, clouds)
    clock.start("matching")
    found = features.match(source[1], target[1], mutual=True, threads=clouds.threads)
    return Correspondences(
        source[0][found.source_indices],
        target[0][found.target_indices],
        ratio=found.ratio,
        resolution=UNIT * clouds.voxel,
    )


def _describe(points: FloatArray, viewpoint: Viewpoint | None, clouds: Clouds) -> tuple[RealArray, RealArray]:
    """Find the voxels of a cloud and their descriptors."""
    threads, voxel = clouds.threads, clouds.voxel
    cloud = features.Cloud(features.voxel_downsample(points, voxel, threads=threads).points)
    normals = features.normals(
        cloud,
        radius=DenseFront.normal_radius * voxel,
        neighbors=NORMAL_NEIGHBORS,
        viewpoint=viewpoint or features.ORIGIN,
        threads=threads,
    )
    values = features.fpfh(cloud, normals, radius=DenseFront.support * voxel, threads=threads)
    return cloud.points, values
