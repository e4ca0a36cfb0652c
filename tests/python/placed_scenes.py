"""Scenes made by hand, of views whose poses are known."""

import numpy as np

from cgroup.datasets import standin_pair
from cgroup.registration.decoys import count_false_accepts
from cgroup.rigid import invert
from cgroup.scenes import Edge, Scene
from cgroup.types import FloatArray, PointCloud

PAIR = standin_pair(pixels=60)


def turned(angle: float, shift: tuple[float, float, float]) -> FloatArray:
    """A pose about z."""
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    pose[:3, 3] = shift
    return pose


def known_scene(**changes: object) -> Scene:
    """Target, source, target again elsewhere, and one that belongs to none; a wrong edge is dropped.

    The last kept edge is off by a small motion.
    """
    moved, away = turned(0.7, (300.0, 20.0, -50.0)), turned(2.0, (0.0, 0.0, 900.0))
    clouds = (PAIR.target, PAIR.source, PAIR.target.transformed(invert(moved)), PAIR.source.transformed(away))
    poses = np.array([np.eye(4), PAIR.T_target_source, moved, np.eye(4)])
    small = np.diag([1e-4, 2e-4, 3e-4, 0.1, 0.2, 0.3])
    edges = [
        edge(poses, 1, 0, small, 0.0),
        edge(poses, 2, 1, small, 0.0, moved=turned(0.02, (0.3, 0.0, 0.2))),
        edge(
            poses, 2, 0, small, 40.0, moved=turned(1.0, (9.0, 0.0, 0.0)), reason="other edges contradict it"
        ),
    ]
    given = {
        "poses": poses,
        "components": [[0, 1, 2], [3]],
        "edges": edges,
        "probability": np.array([1.0, 0.999, 0.98, 1.0]),
        "covariance": np.array([0.0 * small, small, 2 * small, 0.0 * small]),
        "names": ["front.ply", "side.ply", "again.ply", "stranger.ply"],
        "scans": clouds,
        "voxel": 5.0,
        "tried": 6,
        "false_accepts": count_false_accepts([True] * 3, [False] * 3),
        "notes": ("stranger.ply belongs to no other scan",),
        "seconds": {"prepare": 0.1, "pairs": 0.5},
    }
    return Scene(**{**given, **changes})  # type: ignore[arg-type]


def edge(
    poses: FloatArray,
    source: int,
    target: int,
    covariance: FloatArray,
    residual: float,
    *,
    moved: FloatArray | None = None,
    reason: str = "",
) -> Edge:
    """An edge as the poses have it, or displaced in the target's frame."""
    pose = invert(poses[target]) @ poses[source]
    if moved is not None:
        pose = moved @ pose
    return Edge(source, target, pose, 0.97, covariance, 0.6, 0.5, not reason, residual, reason)


def thin_scene(cloud: PointCloud) -> Scene:
    """Two copies of a cloud, one of which lies aside."""
    aside = turned(0.0, (5.0, 0.0, 0.0))
    poses = np.array([np.eye(4), aside])
    small = 1e-4 * np.eye(6)
    return known_scene(
        poses=poses,
        components=[[0, 1]],
        edges=[edge(poses, 1, 0, small, 0.0)],
        probability=np.ones(2),
        covariance=np.array([0 * small, small]),
        names=["one", "two"],
        scans=(cloud, cloud),
    )
