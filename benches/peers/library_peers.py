"""Libraries from pip that fit a pose to given matches: Open3D, pygcransac (Graph-Cut RANSAC), KISS-Matcher.

Conversions that a user could do once (point clouds, lists of points) are done before the timer starts.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

import numpy as np

from peers.answers import rigid
from peers.cases import INLIER_RESIDUAL

if TYPE_CHECKING:
    from peers.answers import Answer, Call, Make
    from peers.cases import Case

NOISE_BOUND = 1.5  # twice of it is GC's tolerance of 3 pr


def open3d_ransac(
    case: Case, _threads: int, *, iterations: int, confidence: float, checkers: bool = False
) -> Call:
    """RANSAC on correspondences, three at a time."""
    import open3d as o3d  # noqa: PLC0415 - each library only where its own peers run

    registration = o3d.pipelines.registration
    source, target, matches = _clouds(o3d, case)
    checks = (
        [
            registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
            registration.CorrespondenceCheckerBasedOnDistance(INLIER_RESIDUAL),
        ]
        if checkers
        else []
    )

    def call() -> Answer:
        o3d.utility.random.seed(1)
        result = registration.registration_ransac_based_on_correspondence(
            source,
            target,
            matches,
            INLIER_RESIDUAL,
            registration.TransformationEstimationPointToPoint(False),  # noqa: FBT003 - theirs
            3,
            checks,
            registration.RANSACConvergenceCriteria(iterations, confidence),
        )
        return None, np.asarray(result.transformation)

    return call


def open3d_fgr(case: Case, _threads: int) -> Call:
    """Fast global registration on correspondences."""
    import open3d as o3d  # noqa: PLC0415

    registration = o3d.pipelines.registration
    source, target, matches = _clouds(o3d, case)
    option = registration.FastGlobalRegistrationOption(
        maximum_correspondence_distance=INLIER_RESIDUAL,
        use_absolute_scale=True,
        decrease_mu=True,
        iteration_number=64,
        tuple_test=True,
    )

    def call() -> Answer:
        o3d.utility.random.seed(1)
        result = registration.registration_fgr_based_on_correspondence(source, target, matches, option)
        return None, np.asarray(result.transformation)

    return call


def gcransac(case: Case, _threads: int, *, sampler: int) -> Call:
    """Graph-Cut RANSAC; sampler 0 is uniform, 1 is PROSAC.

    pygcransac 0.1.1 returns no pose with its default neighbourhood; its mask isn't reliable, so that the pose
    decides, which acts on row vectors.
    """
    import pygcransac  # noqa: PLC0415

    best_first = np.argsort(case["ratio"], kind="stable")  # as PROSAC wants it
    matches = np.ascontiguousarray(np.hstack([case["src"], case["tgt"]])[best_first], dtype=float)

    def call() -> Answer:
        pose = pygcransac.findRigidTransform(
            matches,
            np.array([]),
            threshold=INLIER_RESIDUAL,
            conf=0.999,
            max_iters=10_000,
            min_iters=50,
            neighborhood=0,
            sampler=sampler,
        )[0]
        return None, None if pose is None else np.asarray(pose).T

    return call


def kiss(case: Case, _threads: int) -> Call:
    """Prune by a k-core of the consistency graph, then solve by graduated non-convexity."""
    import kiss_matcher  # noqa: PLC0415

    config = kiss_matcher.KISSMatcherConfig(
        voxel_size=NOISE_BOUND,
        enable_noise_bound_clamping=False,  # else bounds above 1.0 become 1.0
    )
    source = [point.reshape(3, 1) for point in case["src"]]
    target = [point.reshape(3, 1) for point in case["tgt"]]

    def call() -> Answer:
        solution = kiss_matcher.KISSMatcher(config).prune_and_solve(source, target)
        return None, rigid(solution.rotation, solution.translation)

    return call


def _clouds(o3d: Any, case: Case) -> tuple[Any, Any, Any]:  # noqa: ANN401 - Open3D has no types
    clouds = []
    for key in ("src", "tgt"):
        cloud = o3d.geometry.PointCloud()
        cloud.points = o3d.utility.Vector3dVector(case[key].astype(float))
        clouds.append(cloud)
    rows = np.arange(len(case["src"]), dtype=np.int32)
    return *clouds, o3d.utility.Vector2iVector(np.stack([rows, rows], axis=1))


PEERS: dict[str, Make] = {
    "o3d_ransac_10k": functools.partial(open3d_ransac, iterations=10_000, confidence=0.999),
    "o3d_ransac_10k_fixed": functools.partial(open3d_ransac, iterations=10_000, confidence=1.0),
    "o3d_ransac_100k_chk": functools.partial(
        open3d_ransac, iterations=100_000, confidence=0.999, checkers=True
    ),
    "o3d_fgr": open3d_fgr,
    "gcransac_uniform": functools.partial(gcransac, sampler=0),
    "gcransac_prosac": functools.partial(gcransac, sampler=1),
    "kiss": kiss,
}
