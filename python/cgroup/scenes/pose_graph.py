"""Pose graphs: poses of nodes from measured motions between them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from cgroup import _core
from cgroup._checks.array_types import BoolArray, FloatArray, IndexArray
from cgroup._checks.arrays import as_array, as_floats
from cgroup._checks.run_options import run_options
from cgroup._checks.values import as_count, as_flag, as_path, refusal
from cgroup.errors import InputError
from cgroup.io import write_file
from cgroup.io._files import naming, read_content, written_path
from cgroup.scenes.graph_files import (
    GraphContent,
    format_g2o,
    format_json,
    parse_json,
    parse_text,
    singular,
)

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

__all__ = ["PoseGraph"]


@dataclass(frozen=True, eq=False)
class PoseGraph:
    """Poses, and measured motions between them."""

    poses: FloatArray
    edges: IndexArray
    measurements: FloatArray
    information: FloatArray
    probability: FloatArray = field(default=None)  # type: ignore[assignment]
    kept: BoolArray = field(default=None)  # type: ignore[assignment]
    ids: IndexArray = field(default=None)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        """Check shapes and numbers; make arrays read-only copies of what they are given."""
        poses = _motions("poses", self.poses)
        edges = as_array("edges", self.edges)
        if edges.size == 0:
            edges = np.empty((0, 2), np.int64)
        if edges.ndim != 2 or edges.shape[1] != 2 or edges.dtype.kind not in "iu":
            raise refusal("edges", self.edges, "give (M,2) whole numbers, the nodes i and j of each edge")
        count = len(edges)
        outside = (edges < 0) | (edges >= len(poses))
        if outside.any():
            row, column = np.argwhere(outside)[0]
            raise InputError(
                "edges", f"node {edges[row, column]} in row {row}", f"there are {len(poses)} poses"
            )
        measurements = _motions("measurements", self.measurements, count)
        information = (
            as_floats("information", self.information).reshape(-1, 6, 6)
            if count == 0
            else as_floats("information", self.information)
        )
        if information.shape != (count, 6, 6):
            raise InputError("information", f"shape {information.shape}", f"give ({count},6,6)")
        if not np.isfinite(information).all():
            raise InputError("information", "no number", "give finite numbers")
        bad = (
            ~np.isclose(information, information.transpose(0, 2, 1), rtol=1e-6, atol=0).all(axis=(1, 2))
            & False
        )
        bad |= singular(information)
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(
                "information", f"no positive definite matrix in row {row}", "give the inverse of a covariance"
            )
        probability = self.probability
        if probability is None:
            probability = np.where(np.diff(edges, axis=1)[:, 0] == 1, 1.0, 0.5)
        probability = as_floats("probability", probability)
        if probability.shape != (count,) or not ((probability >= 0) & (probability <= 1)).all():
            raise refusal("probability", self.probability, f"give ({count},) numbers between 0 and 1")
        kept = np.ones(count, bool) if self.kept is None else as_array("kept", self.kept)
        if kept.shape != (count,) or kept.dtype != bool:
            raise refusal("kept", self.kept, f"give ({count},) truth values")
        ids = np.arange(len(poses)) if self.ids is None else as_array("ids", self.ids)
        if ids.shape != (len(poses),) or ids.dtype.kind not in "iu":
            raise refusal("ids", self.ids, f"give ({len(poses)},) whole numbers")
        values = (
            poses,
            edges.astype(np.int64),
            measurements,
            information,
            probability,
            kept,
            ids.astype(np.int64),
        )
        for name, value in zip(self.__dataclass_fields__, values, strict=True):
            own = np.array(value)
            own.flags.writeable = False
            object.__setattr__(self, name, own)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> PoseGraph:
        """Read a graph."""
        path = as_path("path", path)
        content = read_content(path)
        with naming(path):
            is_json = path.suffix.lower() == ".json"
            found = parse_json(content) if is_json else parse_text(content)
            probability = None if found.uncertain is None else np.where(found.uncertain, 0.5, 1.0)
            return cls(*found[:4], probability, None, found.ids)  # type: ignore[arg-type]

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the kept edges."""
        path = written_path(path, "pose graphs", ".g2o", ".json")
        kept = self.kept
        content = GraphContent(
            self.poses,
            self.edges[kept],
            self.measurements[kept],
            self.information[kept],
            self.ids,
            self.probability[kept] < 1,
        )
        write_file(path, format_json(content) if path.suffix.lower() == ".json" else format_g2o(content))

    def optimize(
        self,
        *,
        robust: bool = False,
        start: Literal["chordal", "given"] = "chordal",
        threads: int | None = None,
        progress: Callable[[float], object] | None = None,
    ) -> PoseGraph:
        """Move the poses to the least cost."""
        robust = as_flag("robust", robust)
        if start not in ("chordal", "given"):
            raise refusal("start", start, 'choose one of "chordal", "given"')
        options = run_options(threads=threads, progress=progress)
        poses, kept = _core.optimize_poses(self._arrays(), options, start == "chordal", robust)
        return replace(self, poses=poses, kept=kept)

    @property
    def cost(self) -> float:
        """Half the weighted squares of the kept edges."""
        return 0.5 * float(np.sum(self.residuals[self.kept] ** 2))

    @cached_property
    def residuals(self) -> FloatArray:
        """Weighted lengths of the errors."""
        return np.sqrt(_core.squared_errors(self._arrays(), run_options()))

    def covariance(self, i: int) -> FloatArray:
        """Marginal covariance of a node."""
        node = as_count("i", i, 0)
        if node >= len(self.poses):
            raise InputError("i", node, f"give the number of a node, below {len(self.poses)}")
        arrays = tuple(array[self.kept] for array in self._arrays()[1:])
        return _core.pose_covariances((self.poses, *arrays), np.array([node]), run_options())[0]

    def components(self) -> list[IndexArray]:
        """Nodes that hang together."""
        label = np.arange(len(self.poses))
        edges = self.edges[self.kept]
        while True:
            before = label.copy()
            least = np.minimum(label[edges[:, 0]], label[edges[:, 1]])
            np.minimum.at(label, edges.ravel(), np.repeat(least, 2))
            np.minimum.at(label, before[edges].ravel(), np.repeat(least, 2))
            label = label[label]
            if np.array_equal(before, label):
                break
        parts = [np.flatnonzero(label == first) for first in np.unique(label)]
        return sorted(parts, key=len, reverse=True)

    def _arrays(self) -> tuple[FloatArray, IndexArray, FloatArray, FloatArray, FloatArray]:
        return self.poses, self.edges, self.measurements, self.information, self.probability


def _motions(name: str, value: FloatArray, count: int | None = None) -> FloatArray:
    motions = as_floats(name, value)
    if motions.size == 0:
        motions = motions.reshape(0, 4, 4)
    if motions.shape[1:] != (4, 4) or count not in (None, len(motions)):
        raise InputError(name, f"shape {motions.shape}", f"give ({'N' if count is None else count},4,4)")
    return motions
