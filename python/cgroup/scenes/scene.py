"""The result of registering many scans."""

from __future__ import annotations

import colorsys
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup._checks.arrays import in_double
from cgroup._checks.calls import call_hook
from cgroup._checks.values import as_index
from cgroup._show.drawing import naming_missing_library
from cgroup._show.words import counted, number, result_table
from cgroup.errors import InputError
from cgroup.features import Cloud
from cgroup.io import write_cloud, write_file
from cgroup.io.files import check_outputs, number_lines, written_path
from cgroup.io.scan_names import list_names, names_file
from cgroup.pose_graph import PoseGraph
from cgroup.pose_graph.files import ROUNDED, definite, motion_lines
from cgroup.registration import PreparedScan
from cgroup.registration.pairwise import FalseAccepts, merge_clouds
from cgroup.rigid.se3 import covariance_in, information_of
from cgroup.types import AnyCloud, FloatArray, PointCloud
from cgroup.types.point_cloud import as_cloud

# Colours that are distinct for every common kind of colour vision
_FIRST_COLORS = bytes.fromhex("E69F00 0072B2 009E73 CC79A7 56B4E9 D55E00 B8AC1B 7A5195")
_GOLDEN = 0.618  # turn between the hues of consecutive scans, which keeps them apart
_MOST_DISTINCT = 24  # scans that can be told apart by colours; of more, those in sequence have similar hues

_CLOUDS, _GRAPHS = (".ply", ".pcd"), (".g2o", ".json")
POSE_FORMATS = (".tum", ".kitti", ".log")
WITHOUT_NAMES = (".kitti", ".log")  # formats without comments: many readers expect numbers in each line


def scan_colors(count: int) -> NDArray[np.uint8]:
    """Return red, green and blue of scans: distinct ones, or hues in the order of many scans."""
    if count > _MOST_DISTINCT:
        hues = [colorsys.hls_to_rgb(number / count, (0.45, 0.6)[number % 2], 0.75) for number in range(count)]
        return np.rint(255 * np.array(hues)).astype(np.uint8)
    first = np.frombuffer(_FIRST_COLORS, np.uint8).reshape(-1, 3)
    further = [
        colorsys.hls_to_rgb(_GOLDEN * number % 1, (0.42, 0.58, 0.7)[number % 3], 0.62)
        for number in range(len(first), count)
    ]
    bytes_of = np.rint(255 * np.reshape(further, (-1, 3)))
    return np.concatenate([first, bytes_of]).astype(np.uint8)[:count]


def format_poses(suffix: str, poses: FloatArray, rows: Sequence[int], names: Sequence[str]) -> str:
    """Format poses of scans, their rows, and the names of all scans."""
    if suffix == ".kitti":
        lines = number_lines(poses[:, :3].reshape(-1, 12))
    elif suffix == ".tum":
        lines = [f"# {line}" for line in (*list_names(names, rows), "row of the scan, tx ty tz qx qy qz qw")]
        lines += [f"{row} {line}" for row, line in zip(rows, motion_lines(poses), strict=True)]
    else:
        blocks = zip(rows, map(number_lines, poses), strict=True)
        lines = [line for row, pose in blocks for line in (f"{row} {row} {row + 1}", *pose)]
    return "".join(f"{line}\n" for line in lines)


@dataclass(frozen=True, eq=False)
class Edge:
    """A pose between two scans of a scene.

    Attributes
    ----------
    source, target : int
        Rows of the scans.
    T_target_source : (4,4) array of float64
        Maps source points into the target's frame.
    probability : float
        That the pose is right: for a kept edge by the evidence of all scans, for a dropped one by that of its
        two scans.
    covariance : (6,6) array of float64
        Of (rotation vector, translation) in the target's frame, as for `Registration.covariance`.
    fitness, target_fitness : float
        Fractions of the surfaces that overlap each other.
    kept : bool
        Whether the scene uses it.
    residual : float
        Its difference from the poses of the scene, in standard deviations: the square root of
        ``e^T C^-1 e``, C its covariance plus that of other errors (1 degree, half a voxel at the source's
        middle); NaN between two components.
    reason : str
        Reason why it was dropped; "" if it is kept.
    """

    source: int
    target: int
    T_target_source: FloatArray
    probability: float
    covariance: FloatArray
    fitness: float
    target_fitness: float
    kept: bool
    residual: float
    reason: str


@dataclass(frozen=True, eq=False)
class Scene:
    """Poses of many scans.

    Attributes
    ----------
    poses : (N,4,4) array of float64
        Maps points of each scan into the frame of its component, that of the component's first scan, or
        of the scans whose poses were known.
    components : list of list of int
        Rows of the connected scans, the largest component first; an unconnected scan is alone. Scans that
        were left out are in none.
    edges : list of Edge
        Every pair whose pose was accepted, or confirmed by the others.
    probability : (N,) array of float64
        That each pose is right: the least probable edge on the best path from the first scan of its
        component, which has 1. NaN for scans that were left out.
    covariance : (N,6,6) array of float64
        Of each pose, of (rotation vector, translation) in the frame of its component.
    names : list of str
        Names of the scans.
    scans : tuple
        The input clouds, paths or prepared scans.
    voxel : float
        Edge length of the voxels, in the unit of the points.
    tried : int
        Pairs that were registered.
    false_accepts : FalseAccepts
        Estimated share of wrong poses among those accepted from their two scans alone, before the other scans
        confirm or contradict them.
    notes : tuple of str
        Remarks, one sentence each.
    seconds : dict of str to float
        Wall time of each stage, in order.
    made : object, optional
        State for `add`: prepared scans, and the poses of their pairs.
    """

    poses: FloatArray
    components: list[list[int]]
    edges: list[Edge]
    probability: FloatArray
    covariance: FloatArray
    names: list[str]
    scans: tuple[AnyCloud, ...]
    voxel: float
    tried: int
    false_accepts: FalseAccepts
    notes: tuple[str, ...]
    seconds: dict[str, float]
    made: Any = None

    def add(self, scan: PreparedScan | Cloud | AnyCloud, *, viewpoint: ArrayLike | None = None) -> Scene:
        """Return the scene with a further scan, registered to the most similar ones.

        Parameters
        ----------
        scan : PreparedScan, PointCloud, Cloud, path or (N,3) array_like of float
            In the same unit. Its row is the last.
        viewpoint : (3,) array_like of float, optional
            Position of its scanner.

        Returns
        -------
        Scene
            A new one; all scans are refined again.
        """
        return call_hook("scene", self, scan, viewpoint)

    @cached_property
    def graph(self) -> PoseGraph:
        """Pose graph of the connected scans, and the edges between them.

        Nodes are the scans of all components in the order of their rows, which are the graph's ``ids``; edge
        (i, j) measures ``T_i^-1 T_j`` for target i and source j, with the inverse of its covariance.
        `PoseGraph.kept` marks the edges that the scene uses.
        """
        return self._graph_of(sorted(row for rows in self.components for row in rows))

    def _graph_of(self, rows: list[int]) -> PoseGraph:
        among = self._edges_among(rows)
        edges = [edge for _, _, edge in among]
        spreads = [covariance_in("gtsam", edge.covariance, edge.T_target_source) for edge in edges]
        information, _ = definite(information_of(np.reshape(spreads, (-1, 6, 6))), ROUNDED)
        return PoseGraph(
            self.poses[rows],
            np.array([(target, source) for source, target, _ in among]),
            np.array([edge.T_target_source for edge in edges]),
            information,
            np.array([edge.probability for edge in edges]),
            np.array([edge.kept for edge in edges]),
            np.array(rows),
        )

    def merged(self, *, voxel: float | None = None, component: int = 0) -> PointCloud:
        """Merge the scans of a component into one cloud.

        Parameters
        ----------
        voxel : float, optional
            Edge length of the voxels for downsampling, in the unit of the points; by default the finest point
            spacing of the scans, so that overlaps are not denser.
        component : int
            Row of `components`.

        Returns
        -------
        PointCloud
            In the frame of the component. Colours are those of the scans if all have some, else one per scan;
            normals if all have some. Scans given as paths are read again; a file whose points have changed
            raises `InputError`.
        """
        rows = self._component(component)
        return merge_clouds(self._posed(rows), scan_colors(len(self.scans))[rows], voxel)

    def _component(self, component: int) -> list[int]:
        return self.components[as_index("component", component, len(self.components), "components")]

    def _posed(self, rows: list[int]) -> list[PointCloud]:
        return [cloud_of(self, row).transformed(self.poses[row]) for row in rows]

    def _edges_among(self, rows: list[int]) -> list[tuple[int, int, Edge]]:
        """Return the edges between scans, each after the positions of source and target in `rows`."""
        place = {row: node for node, row in enumerate(rows)}
        inside = [edge for edge in self.edges if {edge.source, edge.target} <= place.keys()]
        return [(place[edge.source], place[edge.target], edge) for edge in inside]

    def write(self, path: str | os.PathLike[str], *, component: int = 0) -> None:
        """Write poses, the pose graph, or the merged cloud of a component.

        Scans of other components are left out: they have no pose in its frame. `component` is as for
        `merged`.

        Parameters
        ----------
        path : path-like
            The suffix selects the format. Poses: ``.tum`` (rows of `scans` instead of times), ``.kitti`` (in
            the order of `components`), ``.log`` (Redwood). The graph of kept edges: ``.g2o``, ``.json``
            (Open3D). The cloud of `merged`: ``.ply``, ``.pcd``. All but the clouds have the names of the
            scans by row; KITTI's and Redwood's are in a second file such as ``poses.kitti.names``.
        """
        path = written_path(path, "scenes", *POSE_FORMATS, *_GRAPHS, *_CLOUDS)
        rows, suffix = self._component(component), path.suffix.lower()
        beside = [names_file(path)] if suffix in WITHOUT_NAMES else []
        check_outputs([path, *beside], (scan for scan in self.scans if isinstance(scan, str | os.PathLike)))
        for file in beside:
            write_file(file, "".join(f"{line}\n" for line in list_names(self.names, rows)).encode())
        if suffix in _CLOUDS:
            write_cloud(path, self.merged(component=component))
        elif suffix in _GRAPHS:
            write_file(path, self._graph_of(sorted(rows)).encode(suffix, self.names))
        else:
            write_file(path, format_poses(suffix, self.poses[rows], rows, self.names).encode())

    def plot(self, *, component: int = 0) -> Any:  # noqa: ANN401 - matplotlib's Figure
        """Draw the merged scans of a component, and the graph of their edges.

        Scans are coloured one by one and seen along their thinnest direction, maps from above. Edges of the
        graph are coloured by residual; dropped ones are dashed. `component` is as for `merged`.

        Returns
        -------
        matplotlib.figure.Figure
            Not shown; notebooks show the value of a cell.
        """
        with naming_missing_library():
            from cgroup.plots.scans import scans_figure  # noqa: PLC0415 - needs matplotlib
        rows = self._component(component)
        among = self._edges_among(rows)
        edges = [(source, target, edge.residual, edge.kept) for source, target, edge in among]
        clouds = [cloud.points for cloud in self._posed(rows)]
        colors = scan_colors(len(self.scans))[rows] / 255
        return scans_figure(clouds, [self.names[row] for row in rows], colors, edges)

    def __repr__(self) -> str:
        sizes = [len(rows) for rows in self.components]
        kept = sum(edge.kept for edge in self.edges)
        return f"Scene(scans={len(self.scans)}, components={sizes}, edges={kept} of {len(self.edges)} kept)"

    def _repr_html_(self) -> str:
        several = [rows for rows in self.components if len(rows) > 1]
        alone = [self.names[rows[0]] for rows in self.components if len(rows) == 1]
        kept = [edge.residual for edge in self.edges if edge.kept]
        placed = sum(map(len, several))
        counts = f"{self.tried} tried; of the edges {len(kept)} kept, {len(self.edges) - len(kept)} dropped"
        rows = [
            *((f"component {k}", ", ".join(self.names[i] for i in one)) for k, one in enumerate(several)),
            ("alone", ", ".join(alone)),
            ("pairs", counts),
            ("residual", f"{number(max(kept))} standard deviations at most" if kept else ""),
            ("voxel", number(self.voxel)),
            *(("note", note) for note in self.notes),
            ("time", f"{sum(self.seconds.values()):.2f} s"),
        ]
        title = f"Scene: {placed} of {len(self.scans)} scans in {counted(len(several), 'component')}"
        return result_table(title, placed / len(self.scans), rows)


def cloud_of(scene: Scene, row: int) -> PointCloud:
    """Return the cloud of a scan; paths are read again, prepared scans contain it."""
    name, scan = scene.names[row], scene.scans[row]
    if isinstance(scan, PreparedScan):
        return PointCloud(in_double(scan.scan.cloud.points), scan.scan.normals)
    cloud = as_cloud(name, scan)
    if scene.made is not None:
        building, rows, _ = scene.made
        registered = building.scans[rows.index(row)].scan.given
        if cloud.faces is not None:  # points on large faces may follow the vertices
            registered = registered[: len(cloud)]
        if not np.array_equal(registered, cloud.points):
            place = scan if isinstance(scan, str | os.PathLike) else name
            changed = "was changed since it was registered, and its pose may be wrong; register again"
            raise InputError(f"{place}: {changed}")
    return cloud
