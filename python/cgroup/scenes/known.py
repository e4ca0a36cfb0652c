"""Scans of known pose: their links, the frame of their component, and graphs in which they stay."""

from collections.abc import Mapping

import numpy as np

from cgroup.pose_graph import PoseGraph
from cgroup.rigid import invert, rotation_error
from cgroup.rigid.se3 import adjoint
from cgroup.rigid.transforms import apply
from cgroup.scenes import settings
from cgroup.scenes.agreement import move_frames, squared_errors
from cgroup.scenes.links import Link, Pair
from cgroup.types import FloatArray, IndexArray


class KnownPoses:
    """Known poses by row; while a scene is built, they are in the frame of the first of these scans."""

    def __init__(self, poses: Mapping[int, FloatArray]) -> None:
        self.rows = sorted(poses)
        self._given = [poses[row] for row in self.rows]
        self._base = self._given[0] if self.rows else np.eye(4)
        self._poses = [invert(self._base) @ pose for pose in self._given]
        self._place = dict(zip(self.rows, self._poses, strict=True))
        self.pairs = {(row, self.rows[0]) for row in self.rows[1:]}
        self.contradictions: list[tuple[int, int, float, float]] = []

    def link(self, links: dict[Pair, Link], middles: FloatArray, voxel: float) -> None:
        """Replace links by those of the known poses, to the first of these scans.

        A found link that contradicts the known poses is removed, and noted.
        """
        for pair in [pair for pair in links if {*pair} <= self._place.keys() and links[pair].is_accepted]:
            (source, target), found = pair, links[pair]
            known, middle = invert(self._place[target]) @ self._place[source], middles[source][None]
            error = squared_errors(found.pose[None], known[None], found.covariance[None], middle, voxel)[0]
            if error > settings.DISAGREES:
                way = float(np.linalg.norm(apply(found.pose, middle) - apply(known, middle)))
                self.contradictions.append((*pair, rotation_error(found.pose, known), way))
                del links[pair]
        tight = np.diag([1e-12] * 3 + [1e-12 * voxel**2] * 3)
        for source, target in self.pairs:
            links.pop((target, source), None)
            chance = np.array([settings.LARGEST_CHANCE])
            links[source, target] = Link(self._place[source][None], chance, tight, 0.0, 0.0)

    def settle(self, poses: FloatArray, labels: IndexArray) -> FloatArray:
        """Move each component into the frame of its known scans, or else of its first scan."""
        anchors, settled = labels.copy(), poses.copy()
        for row in reversed(self.rows):
            anchors[labels == labels[row]] = row
        for anchor in np.unique(anchors):
            own = anchors == anchor
            settled[own] = self._place.get(int(anchor), np.eye(4)) @ invert(poses[anchor]) @ poses[own]
        settled[self.rows] = np.reshape(self._poses, (-1, 4, 4))
        return settled

    def restore(self, poses: FloatArray, labels: IndexArray) -> FloatArray:
        """Return settled poses in the frame of the known ones, which are exact."""
        restored, own = poses.copy(), np.isin(labels, labels[self.rows])
        restored[own] = self._base @ poses[own]
        restored[self.rows] = np.reshape(self._given, (-1, 4, 4))
        return restored

    def solve(self, graph: PoseGraph, middles: FloatArray) -> FloatArray:
        """Return the poses of minimum cost; the graph's frames are at the middles of the scans."""
        held, nodes, offsets, base = self.hold(graph, middles)
        return move_frames(base @ held.optimize(start="given").poses[nodes] @ offsets, -middles)

    def hold(
        self, graph: PoseGraph, middles: FloatArray
    ) -> tuple[PoseGraph, IndexArray, FloatArray, FloatArray]:
        """Return a graph whose first node is all known scans, node and pose there of each, and the node's."""
        offsets, is_known = np.tile(np.eye(4), (len(graph.poses), 1, 1)), np.zeros(len(graph.poses), bool)
        if not self.rows:
            return graph, np.arange(len(graph.poses)), offsets, np.eye(4)
        placed = move_frames(np.reshape(self._poses, (-1, 4, 4)), middles[self.rows])
        offsets[self.rows], is_known[self.rows] = invert(placed[0]) @ placed, True
        nodes = np.where(is_known, 0, np.cumsum(~is_known))
        one, other = graph.edges.T
        back = np.asarray(np.linalg.inv(offsets[other]), np.float64)
        change = adjoint(back)
        information = change.transpose(0, 2, 1) @ graph.information @ change
        free = nodes[one] != nodes[other]
        held = PoseGraph(
            np.concatenate([np.eye(4)[None], invert(placed[0]) @ graph.poses[~is_known]]),
            nodes[graph.edges][free],
            (offsets[one] @ graph.measurements @ back)[free],
            ((information + information.transpose(0, 2, 1)) / 2)[free],
            graph.probability[free],
        )
        return held, nodes, offsets, placed[0]
