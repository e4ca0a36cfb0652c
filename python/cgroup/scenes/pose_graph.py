"""Pose graphs: poses of nodes from measured motions between them."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cgroup import _core
from cgroup._checks.array_types import BoolArray, FloatArray, IndexArray
from cgroup._checks.arrays import as_array
from cgroup._checks.run_options import run_options
from cgroup._checks.values import as_choice, as_flag, as_index, as_path, refusal
from cgroup.errors import InputError
from cgroup.io import write_file
from cgroup.io._files import load_text, naming, written_path
from cgroup.io._graphs import (
    GraphContent,
    format_g2o,
    format_json,
    parse_json,
    parse_text,
    singular,
    trust_steps,
)
from cgroup.rigid import as_poses

__all__ = ["PoseGraph"]

_KINDS = {"numbers": np.float64, "whole numbers": np.int64, "truth values": np.bool_}


@dataclass(frozen=True, eq=False)
class PoseGraph:
    """Poses of nodes, and measured motions between them.

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
        How likely each edge is right before anything else is known; 1 where it is trusted always. Without it
        1 for edges from a node to the next one, .5 for others.
    kept : (M,) array_like of bool, optional
        False for edges that a robust optimization has dropped. Without it all True.
    ids : (N,) array_like of int, optional
        Numbers of the nodes in files. Without them 0 to N - 1.
    notes : tuple of str
        Changes that `read` made to what the file holds.

    Raises
    ------
    InputError
        If a shape differs, a pose isn't rigid, a node isn't there, or an information isn't symmetric and
        positive definite.

    Notes
    -----
    The start is that of Carlone and others (*Initialization Techniques for 3D SLAM*, ICRA 2015), the search
    the Levenberg-Marquardt method. Where trusted edges reach every node, other edges are taken in from these,
    nearest first; else wrong edges are dropped by graduated non-convexity with truncated squares (Yang and
    others, RA-L 2020). An edge is kept while e' W e is below 16.8, the quantile .99 of chi-squared,
    plus twice the log-odds of its probability.

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
        """Check shapes and numbers; make arrays read-only copies of what they are given."""
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
        if (bad := np.flatnonzero(singular(information))).size:
            got = f"no symmetric positive definite matrix in row {bad[0]}"
            raise InputError("information", got, "give the inverse of a covariance")
        usual = {"probability": trust_steps(edges), "kept": np.ones(count, bool), "ids": np.arange(nodes)}
        for name, value in usual.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)
        probability = self._numbers("probability", "numbers", count)
        if not ((probability >= 0) & (probability <= 1)).all():
            raise refusal("probability", self.probability, "give numbers between 0 and 1")
        kept = self._numbers("kept", "truth values", count)
        ids = self._numbers("ids", "whole numbers", nodes)
        checked = poses, edges, measurements, information, probability, kept, ids
        for name, value in zip(self.__dataclass_fields__, checked, strict=False):
            own = np.array(value, order="C")  # as the compiled core reads it
            own.flags.writeable = False
            object.__setattr__(self, name, own)

    def _numbers(self, name: str, what: str, *shape: int) -> NDArray[Any]:
        """Return a field as an array of one shape; what is empty stands for one without rows."""
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
            GTSAM (VERTEX3, EDGE3). FIX is passed over: the first node of a component keeps its pose.

        Returns
        -------
        PoseGraph
            Its nodes in the order of their numbers. An information matrix that is semi-definite, or whose
            negative eigenvalues are within the rounding of a file of few digits, is made positive definite;
            `notes` lists the edges.

        Raises
        ------
        InputError
            If the file can't be read, with the number of the line that is wrong.

        Examples
        --------
        >>> from cgroup.io import write_file
        >>> from cgroup.scenes import PoseGraph
        >>> write_file("one.g2o", b"VERTEX_SE3:QUAT 4 0 0 0 0 0 0 1")
        >>> PoseGraph.read("one.g2o").ids
        array([4])
        """
        path = as_path("path", path)
        parse = parse_json if path.suffix.lower() == ".json" else parse_text
        content = load_text(path)
        with naming(path):
            return cls(**parse(content)._asdict())

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the poses and the kept edges.

        Parameters
        ----------
        path : path-like
            Where to: g2o or Open3D's JSON, by the suffix. JSON keeps each bit of poses; g2o has quaternions,
            and keeps rotations to rounding.

        Raises
        ------
        InputError
            If the suffix is another, or the file can't be written.

        Examples
        --------
        >>> import numpy as np
        >>> from cgroup.scenes import PoseGraph
        >>> PoseGraph([np.eye(4)], [], [], []).write("one.json")
        >>> len(PoseGraph.read("one.json").poses)
        1
        """
        path = written_path(path, "pose graphs", ".g2o", ".json")
        form = format_json if path.suffix.lower() == ".json" else format_g2o
        write_file(path, form(GraphContent._make((*self._arrays(self.kept), self.ids, ()))).encode())

    def optimize(
        self,
        *,
        robust: bool = False,
        start: Literal["chordal", "given"] = "chordal",
        threads: int | None = None,
        progress: Callable[[float], object] | None = None,
    ) -> PoseGraph:
        """Move the poses to the least cost.

        The first node of each component keeps its pose.

        Parameters
        ----------
        robust : bool
            Drop edges that contradict the others; those of probability 1 are kept always.
        start : {"chordal", "given"}
            From the edges alone, or from the poses as they are.
        threads : int, optional
            Without it all cores. The result is the same on any number.
        progress : callable, optional
            Called with the share of the work done.

        Returns
        -------
        PoseGraph
            With other poses, and with `kept` where it was robust.

        Raises
        ------
        InputError
            If an argument isn't as described.
        OutOfMemoryError
            If the system gives no memory for the factor of the matrix.

        Examples
        --------
        >>> import numpy as np
        >>> from cgroup.scenes import PoseGraph
        >>> right, wrong, weights = np.eye(4), np.eye(4), [np.eye(6)] * 3
        >>> wrong[0, 3], edges = 9, [(0, 1), (1, 2), (0, 2)]
        >>> graph = PoseGraph([right] * 3, edges, [right, right, wrong], weights)
        >>> graph.optimize(robust=True).kept
        array([ True,  True, False])
        """
        robust = as_flag("robust", robust)
        chordal = as_choice("start", start, ("chordal", "given")) == "chordal"
        options = run_options(threads=threads, progress=progress)
        poses, kept = _core.optimize_poses(self._arrays(), options, chordal, robust)
        return replace(self, poses=poses, kept=kept)

    @property
    def cost(self) -> float:
        """Half the weighted squares of the kept edges, as GTSAM's ``graph.error``.

        Examples
        --------
        >>> import numpy as np
        >>> from cgroup.scenes import PoseGraph
        >>> graph = PoseGraph([np.eye(4)] * 2, [(0, 1)], [np.eye(4)], [np.eye(6)])
        >>> graph.cost
        0.0
        """
        return 0.5 * float(np.sum(self.residuals[self.kept] ** 2))

    @cached_property
    def residuals(self) -> FloatArray:
        """Square roots of e' W e, one per edge, (M,).

        Examples
        --------
        >>> import numpy as np
        >>> from cgroup.scenes import PoseGraph
        >>> shift = np.eye(4)
        >>> shift[0, 3] = 2
        >>> PoseGraph([np.eye(4)] * 2, [(0, 1)], [shift], [np.eye(6)]).residuals
        array([2.])
        """
        return np.sqrt(_core.squared_errors(self._arrays(), run_options()))

    def covariance(self, i: int) -> FloatArray:
        """Find the marginal covariance of a node's pose, given the kept edges.

        Parameters
        ----------
        i : int
            Row of `poses`.

        Returns
        -------
        (6,6) array of float64
            Of the twist (rotation vector in radians, translation) that moves the pose on its right; zero for
            the first node of a component, which is held.

        Raises
        ------
        InputError
            If there is no such node.

        Examples
        --------
        >>> import numpy as np
        >>> from cgroup.scenes import PoseGraph
        >>> graph = PoseGraph([np.eye(4)] * 2, [(0, 1)], [np.eye(4)], [4 * np.eye(6)])
        >>> graph.covariance(1).diagonal()
        array([0.25, 0.25, 0.25, 0.25, 0.25, 0.25])
        """
        node = as_index("i", i, len(self.poses), "nodes")
        return _core.pose_covariances(self._arrays(self.kept), np.array([node]), run_options())[0]

    def components(self) -> list[IndexArray]:
        """Find the nodes that hang together by kept edges.

        Returns
        -------
        list of (k,) arrays of int64
            Rows of `poses`, the largest component first.

        Examples
        --------
        >>> import numpy as np
        >>> from cgroup.scenes import PoseGraph
        >>> PoseGraph([np.eye(4)] * 3, [(0, 2)], [np.eye(4)], [np.eye(6)]).components()
        [array([0, 2]), array([1])]
        """
        labels, edges = np.arange(len(self.poses)), self.edges[self.kept]
        while len(apart := labels[edges][labels[edges[:, 0]] != labels[edges[:, 1]]]):
            np.minimum.at(labels, apart.max(axis=1), apart.min(axis=1))
            while (labels != labels[labels]).any():
                labels = labels[labels]
        parts = [np.flatnonzero(labels == label) for label in np.unique(labels)]
        return sorted(parts, key=len, reverse=True)

    def _arrays(self, rows: BoolArray | slice = slice(None)) -> tuple[Any, ...]:
        """Return what the compiled core takes, with some of the edges."""
        edges, probability = self.edges[rows], self.probability[rows]
        return self.poses, edges, self.measurements[rows], self.information[rows], probability
