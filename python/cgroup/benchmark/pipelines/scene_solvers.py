"""Pipelines for many scans: cgroup's, Open3D's multiway registration, and KISS-Matcher's pairs with GNC.

Choi, Zhou, Koltun: Robust reconstruction of indoor scenes, CVPR 2015 (line process). Yang, Antonante,
Tzoumas, Carlone: Graduated non-convexity for robust spatial perception, RA-L 2020, as in GTSAM.
"""

import importlib
import itertools
import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from cgroup._runtime.progress import StageClock
from cgroup.benchmark.pipelines import libraries
from cgroup.benchmark.pipelines.answer import Clouds, Scans, SceneAnswer
from cgroup.registration import Effort
from cgroup.rigid import invert
from cgroup.scenes import register_all
from cgroup.types import FloatArray

# Standard deviations of KISS-Matcher's poses, in radians and in voxels
ROTATION_SIGMA, TRANSLATION_SIGMA = 0.02, 1.0
PRUNED_BELOW = 0.25  # Open3D's own threshold of the line process
INLIER_WEIGHT = 0.5  # limit of GNC's weights, which end near 0 or 1


class _Pair(NamedTuple):
    source: int
    target: int
    T_target_source: FloatArray
    weight: float


def own(scans: Scans, clock: StageClock, *, effort: Effort = "normal") -> SceneAnswer:
    """Run `register_all` with a given voxel."""
    clock.start("scene")
    found = register_all(scans.points, voxel=scans.voxel, effort=effort, threads=scans.threads)
    return SceneAnswer(found.poses, found.components, found.tried)


def open3d_multiway(scans: Scans, clock: StageClock) -> SceneAnswer:
    """Run FPFH and RANSAC on every pair, and Open3D's optimization with line process."""
    o3d = importlib.import_module("open3d")
    registration = o3d.pipelines.registration
    clock.start("features")
    described = [libraries.describe(o3d, points, None, scans.voxel) for points in scans.points]
    clock.start("pairs")
    o3d.utility.random.seed(scans.seed)
    inform, reach = registration.get_information_matrix_from_point_clouds, libraries.REACH * scans.voxel
    pairs: list[_Pair] = []
    information: dict[tuple[int, int], FloatArray] = {}
    for source, target in itertools.combinations(range(len(described)), 2):
        found = libraries.ransac(o3d, described[source], described[target], reach)
        if found.fitness == 0:
            continue
        pose = np.array(found.transformation, dtype=np.float64)
        clouds = described[source][0], described[target][0]
        information[source, target] = inform(*clouds, reach, pose)
        pairs.append(_Pair(source, target, pose, float(len(found.correspondence_set))))
    clock.start("graph")
    poses, _ = _span(len(described), pairs)
    graph = registration.PoseGraph()
    for pose in poses:
        graph.nodes.append(registration.PoseGraphNode(pose))
    for source, target, pose, _ in pairs:
        graph.edges.append(
            registration.PoseGraphEdge(source, target, pose, information[source, target], uncertain=True)
        )
    registration.global_optimization(
        graph,
        registration.GlobalOptimizationLevenbergMarquardt(),
        registration.GlobalOptimizationConvergenceCriteria(),
        registration.GlobalOptimizationOption(
            max_correspondence_distance=reach, edge_prune_threshold=PRUNED_BELOW, reference_node=0
        ),
    )
    kept = [_Pair(edge.source_node_id, edge.target_node_id, np.eye(4), 1.0) for edge in graph.edges]
    _, components = _span(len(described), kept)
    return SceneAnswer(
        np.array([node.pose for node in graph.nodes]), components, math.comb(len(described), 2)
    )


def kiss_matcher_gnc(scans: Scans, clock: StageClock) -> SceneAnswer:
    """Run KISS-Matcher on every pair, and GTSAM's GNC on the accepted poses."""
    gtsam = importlib.import_module("gtsam")
    pairs: list[_Pair] = []
    for source, target in itertools.combinations(range(len(scans.points)), 2):
        both = scans.points[source], scans.points[target]
        answer = libraries.kiss_matcher(Clouds(*both, None, None, scans.voxel, scans.threads), clock)
        if answer.ok and answer.T_target_source is not None:
            pairs.append(_Pair(source, target, answer.T_target_source, 1.0))
    clock.start("graph")
    poses, components = _span(len(scans.points), pairs)
    kept: list[_Pair] = []
    for component in components:
        mine = [pair for pair in pairs if pair.source in component]
        if mine:
            kept += _graduate(gtsam, component, mine, poses, scans.voxel)
    _, components = _span(len(scans.points), kept)
    return SceneAnswer(poses, components, math.comb(len(scans.points), 2))


def _graduate(
    gtsam: Any,  # noqa: ANN401 - it has no types
    component: list[int],
    pairs: list[_Pair],
    poses: FloatArray,
    voxel: float,
) -> list[_Pair]:
    """Optimize the poses of a component in place, in voxels; return the inlier pairs of GNC."""

    def scaled(pose: FloatArray, scale: float) -> FloatArray:
        moved = pose.copy()
        moved[:3, 3] *= scale
        return moved

    sigmas = np.array([ROTATION_SIGMA] * 3 + [TRANSLATION_SIGMA] * 3)
    noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for source, target, pose, _ in pairs:
        graph.add(gtsam.BetweenFactorPose3(target, source, gtsam.Pose3(scaled(pose, 1 / voxel)), noise))
    for row in component:
        values.insert(row, gtsam.Pose3(scaled(poses[row], 1 / voxel)))
    graph.add(gtsam.PriorFactorPose3(component[0], values.atPose3(component[0]), noise))
    parameters = gtsam.GncLMParams()
    parameters.setKnownInliers([len(pairs)])
    optimizer = gtsam.GncLMOptimizer(graph, values, parameters)
    found = optimizer.optimize()
    for row in component:
        poses[row] = scaled(found.atPose3(row).matrix(), voxel)
    weights = optimizer.getWeights()[: len(pairs)]
    return [pair for pair, weight in zip(pairs, weights, strict=True) if weight > INLIER_WEIGHT]


def _span(count: int, pairs: Iterable[_Pair]) -> tuple[FloatArray, list[list[int]]]:
    """Return poses along the maximum spanning tree, and components, the largest first."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    component = [[row] for row in range(count)]
    for source, target, pose, _ in sorted(pairs, key=lambda pair: -pair.weight):
        moved, fixed = component[source], component[target]
        if moved is fixed:
            continue
        shift = poses[target] @ pose @ invert(poses[source])
        for row in moved:
            poses[row] = shift @ poses[row]
            component[row] = fixed
        fixed += moved
    unique = {id(each): sorted(each) for each in component}
    return poses, sorted(unique.values(), key=lambda each: (-len(each), each))
