"""Pose graphs: estimate poses of nodes from relative measurements."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cgroup import _core
from cgroup._checks.arrays import BoolArray, FloatArray, IndexArray, as_array
from cgroup._checks.values import as_choice, as_flag, as_index, as_path, refusal, run_options
from cgroup.errors import InputError
from cgroup.io import write_file
from cgroup.io.files import load_text, naming, written_path
from cgroup.pose_graph import files
from cgroup.rigid.transforms import as_poses

_KINDS = {"numbers": np.float64, "whole numbers": np.int64, "truth values": np.bool_}


@dataclass(frozen=True, eq=False)
class PoseGraph:
    """Poses of nodes, and relative measurements between them.

    The error of an edge is the twist e = log(Z^-1 T_i^-1 T_j), its rotation vector first, and its cost is
    e' W e / 2 with the information W, as in GTSAM. A graph never changes; its arrays are read-only copies.

    Parameters
    ----------
    poses : (N,4,4) array_like of float
        Node to world, in the unit of the data.
    edges : (M,2) array_like of int
        Rows of the nodes i and j.
    measurements : (M,4,4) array_like of float
        T_i^-1 T_j: maps points of j's frame into i's.
    information : (M,6,6) array_like of float
        Inverse covariances of twists d that move the measurements on their right, T exp(d).
    probability : (M,) array_like of float, optional
        Prior probability of each edge; 1 for trusted edges. By default 1 for edges from a node to the next
        one, .5 for others.
    kept : (M,) array_like of bool, optional
        False for edges that a robust optimization dropped. By default all True.
    ids : (N,) array_like of int, optional
        Numbers of the nodes in files. By default 0 to N - 1.
    notes : tuple of str
        Changes that `read` made to the content of the file.

    Notes
    -----
    The start is that of Carlone and others (*Initialization Techniques for 3D SLAM*, ICRA 2015), the search
    the Levenberg-Marquardt method. An edge is kept while e' W e is below 16.8, the quantile .99 of
    chi-squared, plus twice the log-odds of its probability.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.scenes import PoseGraph
    >>> step, far, edges = np.eye(4), np.eye(4), [(0, 1), (1, 2), (0, 2)]
    >>> step[0, 3], far[0, 3] = 1, 2.3
    >>> graph = PoseGraph([step] * 3, edges, [step, step, far], [np.eye(6)] * 3)
    >>> graph.optimize().poses[:, 0, 3].round(3)
    array([1. , 2.1, 3.2])
    """

    poses: FloatArray
    edges: IndexArray
    measurements: FloatArray
    information: FloatArray
    probability: FloatArray = field(default=None)  # type: ignore[assignment]
    kept: BoolArray = field(default=None)  # type: ignore[assignment]
    ids: IndexArray = field(default=None)  # type: ignore[assignment]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check shapes and numbers; replace arrays by read-only copies."""
        if not isinstance(self.notes, tuple) or not all(isinstance(note, str) for note in self.notes):
            raise refusal("notes", self.notes, "give a tuple of texts")
        poses = as_poses("poses", self.poses)
        measurements = as_poses("measurements", self.measurements)
        count, nodes = len(measurements), len(poses)
        edges = self._numbers("edges", "whole numbers", count, 2)
        if (outside := np.argwhere((edges < 0) | (edges >= nodes))).size:
            row, column = outside[0]
            raise InputError("edges", f"node {edges[row, column]} in row {row}", f"there are {nodes} poses")
        information = self._numbers("information", "numbers", count, 6, 6)
        if (bad := np.flatnonzero(files.singular(information))).size:
            got = f"no symmetric positive definite matrix in row {bad[0]}"
            raise InputError("information", got, "give the inverse of a covariance")
        trust = files.trust_steps(edges)
        usual = {"probability": trust, "kept": np.ones(count, bool), "ids": np.arange(nodes)}
        for name, value in usual.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)
        probability = self._numbers("probability", "numbers", count)
        if not ((probability >= 0) & (probability <= 1)).all():
            raise refusal("probability", self.probability, "give numbers between 0 and 1")
        kept = self._numbers("kept", "truth values", count)
        ids = self._numbers("ids", "whole numbers", nodes)
        if len(np.unique(ids)) < nodes or (np.abs(ids) >= files.MOST_ID).any():
            raise refusal("ids", self.ids, "give different numbers below 2^53")
        checked = poses, edges, measurements, information, probability, kept, ids
        for name, value in zip(self.__dataclass_fields__, checked, strict=False):
            own = np.array(value, order="C")  # as the compiled core reads it
            own.flags.writeable = False
            object.__setattr__(self, name, own)

    def _numbers(self, name: str, what: str, *shape: int) -> NDArray[Any]:
        """Return a field as an array of one shape; an empty value becomes one without rows."""
        value, kind = getattr(self, name), _KINDS[what]
        array = as_array(name, value)
        if array.size == 0:
            array = np.empty((0, *shape[1:]), kind)
        if array.shape != shape or not np.can_cast(array.dtype, kind, "same_kind"):
            raise refusal(name, value, f"give ({','.join(map(str, shape))}) {what}")
        return array.astype(kind, copy=False)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> PoseGraph:
        """Read a graph from a file.

        Parameters
        ----------
        path : path-like
            Open3D's JSON by its suffix; else lines of g2o (VERTEX_SE3:QUAT, EDGE_SE3:QUAT) or of TORO and
            GTSAM (VERTEX3, EDGE3). FIX is ignored: the first node of a component keeps its pose.

        Returns
        -------
        PoseGraph
            Its nodes in the order of their numbers. Semi-definite information matrices, and those with
            negative eigenvalues within the rounding of few digits, are made positive definite; `notes` lists
            these edges.
        """
        path = as_path("path", path)
        parse = files.parse_json if path.suffix.lower() == ".json" else files.parse_text
        content = load_text(path)
        with naming(path):
            return cls(**parse(content)._asdict())

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the poses and the kept edges.

        Parameters
        ----------
        path : path-like
            Its suffix selects g2o or Open3D's JSON. JSON keeps poses to the bit; g2o has quaternions and
            keeps rotations to rounding. Its information is that of rotation vectors, as GTSAM and Ceres read
            it; g2o itself takes it for that of the vector part of the quaternion.
        """
        path = written_path(path, "pose graphs", ".g2o", ".json")
        write_file(path, self.encode(path.suffix.lower()))

    def encode(self, suffix: str, names: Sequence[str] = ()) -> bytes:
        """Return the content of a file; if the nodes are scans, it contains their names.

        :meta private:
        """
        form = files.format_json if suffix == ".json" else files.format_g2o
        return form(files.GraphContent._make((*self._arrays(self.kept), self.ids, ())), names).encode()

    def optimize(
        self,
        *,
        robust: bool = False,
        start: Literal["chordal", "given"] = "chordal",
        threads: int | None = None,
        progress: Callable[[float], object] | None = None,
    ) -> PoseGraph:
        """Return the graph with the poses of minimum cost.

        The first node of each component keeps its pose.

        Parameters
        ----------
        robust : bool
            Drop edges that contradict the others; those of probability 1 are kept.
        start : {"chordal", "given"}
            Start from the edges alone, or from the given poses.
        threads : int, optional
            As for `register`.
        progress : callable, optional
            Called with the finished fraction of the work.

        Returns
        -------
        PoseGraph
            With new poses, and with `kept` if robust.
        """
        robust = as_flag("robust", robust)
        chordal = as_choice("start", start, ("chordal", "given")) == "chordal"
        options = run_options(threads=threads, progress=progress)
        poses, kept = _core.optimize_poses(self._arrays(), options, chordal, robust)
        return replace(self, poses=poses, kept=kept)

    @property
    def cost(self) -> float:
        """Half the weighted squares of the kept edges, as GTSAM's ``graph.error``."""
        return 0.5 * float(np.sum(self.residuals[self.kept] ** 2))

    @cached_property
    def residuals(self) -> FloatArray:
        """Square roots of e' W e, one per edge, (M,)."""
        return np.sqrt(_core.squared_errors(self._arrays(), run_options()))

    def covariance(self, i: int) -> FloatArray:
        """Return the marginal covariance of a node's pose, given the kept edges.

        Parameters
        ----------
        i : int
            Row of `poses`.

        Returns
        -------
        (6,6) array of float64
            Of the twist (rotation vector in radians, translation) that moves the pose on its right; zero for
            the first node of a component, which is fixed.
        """
        node = as_index("i", i, len(self.poses), "nodes")
        return _core.pose_covariances(self._arrays(self.kept), np.array([node]), run_options())[0]

    def components(self) -> list[IndexArray]:
        """Return the components of nodes that are connected by kept edges.

        Returns
        -------
        list of (k,) arrays of int64
            Rows of `poses`, the largest component first.
        """
        labels, edges = np.arange(len(self.poses)), self.edges[self.kept]
        while len(apart := labels[edges][labels[edges[:, 0]] != labels[edges[:, 1]]]):
            np.minimum.at(labels, apart.max(axis=1), apart.min(axis=1))
            while (labels != labels[labels]).any():
                labels = labels[labels]
        parts = [np.flatnonzero(labels == label) for label in np.unique(labels)]
        return sorted(parts, key=len, reverse=True)

    def _arrays(self, rows: BoolArray | slice = slice(None)) -> tuple[Any, ...]:
        """Return the arguments of the compiled core, with some of the edges."""
        edges, probability = self.edges[rows], self.probability[rows]
        return self.poses, edges, self.measurements[rows], self.information[rows], probability
