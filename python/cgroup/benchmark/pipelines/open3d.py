"""Open3D's global registration with the parameters of its tutorial."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup.benchmark.pipelines.problem import Answer

if TYPE_CHECKING:
    from cgroup._runtime.progress import StageClock
    from cgroup.benchmark.pipelines.problem import Problem
    from cgroup.features import Viewpoint
    from cgroup.types import FloatArray

ITERATIONS, CONFIDENCE = 100_000, 0.999
REACH = 1.5
"""Most distance of matched points in RANSAC, in voxels."""
FAST_REACH = 0.5
"""The same in FGR."""
EDGE_SIMILARITY = 0.9


def ransac(problem: Problem, clock: StageClock) -> Answer:
    """RANSAC on mutual nearest FPFH features (Choi, Zhou, Koltun, CVPR 2015)."""
    o3d, (source, target) = _describe(problem, clock)
    clock.start("pose")
    o3d.utility.random.seed(problem.seed)
    registration, reach = o3d.pipelines.registration, REACH * problem.voxel
    found = registration.registration_ransac_based_on_feature_matching(
        source[0],
        target[0],
        source[1],
        target[1],
        True,  # noqa: FBT003 - mutual; Open3D's bindings have renamed it more than once
        reach,
        registration.TransformationEstimationPointToPoint(False),  # noqa: FBT003 - without scale
        3,
        [
            registration.CorrespondenceCheckerBasedOnEdgeLength(EDGE_SIMILARITY),
            registration.CorrespondenceCheckerBasedOnDistance(reach),
        ],
        registration.RANSACConvergenceCriteria(ITERATIONS, CONFIDENCE),
    )
    return _answer(found)


def fast(problem: Problem, clock: StageClock) -> Answer:
    """Fast global registration (Zhou, Park, Koltun, ECCV 2016)."""
    o3d, (source, target) = _describe(problem, clock)
    clock.start("pose")
    registration = o3d.pipelines.registration
    option = registration.FastGlobalRegistrationOption(
        maximum_correspondence_distance=FAST_REACH * problem.voxel
    )
    return _answer(
        registration.registration_fgr_based_on_feature_matching(
            source[0], target[0], source[1], target[1], option
        )
    )


def _describe(problem: Problem, clock: StageClock) -> tuple[Any, list[tuple[Any, Any]]]:
    o3d = importlib.import_module("open3d")
    o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)
    clouds = (
        (problem.source, problem.source_viewpoint),
        (problem.target, problem.target_viewpoint),
    )
    clock.start("features")
    return o3d, [_describe_cloud(o3d, points, viewpoint, problem.voxel) for points, viewpoint in clouds]


def _describe_cloud(
    o3d: Any,  # noqa: ANN401 - Open3D has no types
    points: FloatArray,
    viewpoint: Viewpoint | None,
    voxel: float,
) -> tuple[Any, Any]:
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)).voxel_down_sample(voxel)
    hybrid = o3d.geometry.KDTreeSearchParamHybrid
    cloud.estimate_normals(hybrid(radius=2 * voxel, max_nn=30))
    if viewpoint is not None:
        cloud.orient_normals_towards_camera_location(viewpoint)
    features = o3d.pipelines.registration.compute_fpfh_feature(cloud, hybrid(radius=5 * voxel, max_nn=100))
    return cloud, features


def _answer(found: Any) -> Answer:  # noqa: ANN401 - Open3D has no types
    if found.fitness == 0:
        return Answer(None, ok=False)
    return Answer(np.array(found.transformation, dtype=np.float64), ok=True)
