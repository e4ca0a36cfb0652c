"""Pipelines of other libraries: Open3D, KISS-Matcher, and refinement by small_gicp.

Open3D has the parameters of its tutorial on global registration, the others their defaults. Lim et al.:
KISS-Matcher: Fast and robust point cloud registration revisited, ICRA 2025. Koide: small_gicp, Journal of
Open Source Software 2024.
"""

import importlib
from typing import Any

import numpy as np

from cgroup._runtime.progress import StageClock
from cgroup.benchmark.pipelines.answer import Answer, Clouds
from cgroup.features import Viewpoint
from cgroup.types import FloatArray

ITERATIONS, CONFIDENCE = 100_000, 0.999
REACH = 1.5  # largest distance of matched points in Open3D's RANSAC, in voxels
FAST_REACH = 0.5  # the same in Open3D's FGR
EDGE_SIMILARITY = 0.9

# KISS-Matcher refuses small voxels, and small_gicp's defaults are in m: clouds are scaled to this voxel
VOXEL = 0.3
LEAST_INLIERS = 5  # KISS-Matcher's examples reject registrations with fewer final inliers


def open3d_ransac(clouds: Clouds, clock: StageClock) -> Answer:
    """RANSAC on mutual nearest FPFH features (Choi, Zhou, Koltun, CVPR 2015)."""
    o3d, (source, target) = _describe(clouds, clock)
    clock.start("pose")
    o3d.utility.random.seed(clouds.seed)
    return _answer(ransac(o3d, source, target, REACH * clouds.voxel))


def ransac(o3d: Any, source: tuple[Any, Any], target: tuple[Any, Any], reach: float) -> Any:  # noqa: ANN401
    """Register two clouds with their features by Open3D's RANSAC."""
    registration = o3d.pipelines.registration
    return registration.registration_ransac_based_on_feature_matching(
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


def open3d_fgr(clouds: Clouds, clock: StageClock) -> Answer:
    """Fast global registration (Zhou, Park, Koltun, ECCV 2016)."""
    o3d, (source, target) = _describe(clouds, clock)
    clock.start("pose")
    registration = o3d.pipelines.registration
    option = registration.FastGlobalRegistrationOption(
        maximum_correspondence_distance=FAST_REACH * clouds.voxel
    )
    return _answer(
        registration.registration_fgr_based_on_feature_matching(
            source[0], target[0], source[1], target[1], option
        )
    )


def _describe(clouds: Clouds, clock: StageClock) -> tuple[Any, list[tuple[Any, Any]]]:
    o3d = importlib.import_module("open3d")
    clock.start("features")
    both = (clouds.source, clouds.source_viewpoint), (clouds.target, clouds.target_viewpoint)
    return o3d, [describe(o3d, points, viewpoint, clouds.voxel) for points, viewpoint in both]


def describe(o3d: Any, points: FloatArray, viewpoint: Viewpoint | None, voxel: float) -> tuple[Any, Any]:  # noqa: ANN401
    """Return the voxels of a cloud and their FPFH features, by Open3D."""
    o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)
    hybrid = o3d.geometry.KDTreeSearchParamHybrid
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)).voxel_down_sample(voxel)
    cloud.estimate_normals(hybrid(radius=2 * voxel, max_nn=30))
    if viewpoint is not None:
        cloud.orient_normals_towards_camera_location(viewpoint)
    search = hybrid(radius=5 * voxel, max_nn=100)
    return cloud, o3d.pipelines.registration.compute_fpfh_feature(cloud, search)


def _answer(found: Any) -> Answer:  # noqa: ANN401 - Open3D has no types
    if found.fitness == 0:
        return Answer(None, ok=False)
    return Answer(np.array(found.transformation, dtype=np.float64), ok=True)


def kiss_matcher(clouds: Clouds, clock: StageClock) -> Answer:
    """Run KISS-Matcher with its defaults at the given voxel."""
    library = importlib.import_module("kiss_matcher")
    scale = VOXEL / clouds.voxel
    source, target = clouds.source * scale, clouds.target * scale
    clock.start("pose")
    matcher = library.KISSMatcher(library.KISSMatcherConfig(VOXEL))
    found = matcher.estimate(source, target)
    if not found.valid:
        return Answer(None, ok=False)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = found.rotation, np.ravel(found.translation) / scale
    return Answer(pose, ok=matcher.get_num_final_inliers() >= LEAST_INLIERS)


def refine(clouds: Clouds, pose: FloatArray) -> FloatArray:
    """Refine a pose by generalized ICP with small_gicp's defaults."""
    library = importlib.import_module("small_gicp")
    scale = VOXEL / clouds.voxel
    start = pose.copy()
    start[:3, 3] *= scale
    found = library.align(
        clouds.target * scale, clouds.source * scale, init_T_target_source=start, num_threads=clouds.threads
    )
    refined = np.array(found.T_target_source, dtype=np.float64)
    refined[:3, 3] /= scale
    return refined
