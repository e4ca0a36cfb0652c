"""What is known of a group and its matches, computed once for all that are explained."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cgroup._explain.pairs import ZERO_EDGE, PairRule, distance_ratio, pair_rule
from cgroup.errors import NoConsensusError

if TYPE_CHECKING:
    from cgroup._checks.array_types import BoolArray, FloatArray
    from cgroup._runtime.run import Run
    from cgroup.types import Grouping


class Edges(NamedTuple):
    """From one match to all: lengths on both sides, and where either is none."""

    ds: FloatArray
    dt: FloatArray
    zero: BoolArray

    @property
    def ratio(self) -> FloatArray:
        """``min(ds/dt, dt/ds)``, 0 where two share a point."""
        return distance_ratio(self.ds, self.dt, self.zero)


class Facts:
    """A group, the points of all matches, and what follows from them."""

    def __init__(self, grouping: Grouping) -> None:
        self.grouping = grouping
        self.run: Run | None = grouping._run  # noqa: SLF001  # pyright: ignore[reportPrivateUsage] - what it is there for
        self.resolution = None if self.run is None else self.run.resolution
        points = grouping._positions  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
        self.points: tuple[FloatArray, FloatArray] | None = (
            None if points is None else (points[0].astype(np.float64), points[1].astype(np.float64))
        )

    @cached_property
    def rule(self) -> PairRule:
        """When two matches keep their distance."""
        return pair_rule(self.run, self.grouping.diagnostics)

    @cached_property
    def pose(self) -> FloatArray | None:
        """The model, or the least-squares pose of the group."""
        if self.grouping.model is not None or self.points is None:
            return self.grouping.model
        try:
            return self.grouping.transform()
        except NoConsensusError:
            return None

    @cached_property
    def misfits(self) -> FloatArray | None:
        """(n,3) of the target points from where the pose lays their source points."""
        if self.points is None or self.pose is None:
            return None
        source, target = self.points
        return source @ self.pose[:3, :3].T + self.pose[:3, 3] - target

    @cached_property
    def residuals(self) -> FloatArray | None:
        """(n,) lengths of the misfits."""
        return None if self.misfits is None else np.linalg.norm(self.misfits, axis=1)

    @cached_property
    def order(self) -> FloatArray | None:
        """Scores ascending."""
        scores = self.grouping.scores
        return None if scores is None else np.sort(scores)

    def rank(self, i: int) -> int | None:
        """Place of a match by its score, 1 for the greatest."""
        scores, order = self.grouping.scores, self.order
        if scores is None or order is None:
            return None
        return len(order) - int(np.searchsorted(order, scores[i], side="right")) + 1

    @cached_property
    def _zero_lengths(self) -> tuple[float, float]:
        assert self.points is not None  # noqa: S101 - edges ask for it
        source, target = (ZERO_EDGE * float(np.linalg.norm(np.ptp(side, axis=0))) for side in self.points)
        return source, target

    def edges(self, i: int) -> Edges | None:
        """Distances of one match to all."""
        if self.points is None:
            return None
        ds, dt = (np.linalg.norm(side - side[i], axis=1) for side in self.points)
        least = self._zero_lengths
        return Edges(ds, dt, (ds <= least[0]) | (dt <= least[1]))

    def agreeing(self, i: int) -> BoolArray | None:
        """Which others keep their distance to a match."""
        edges = self.edges(i)
        if edges is None:
            return None
        agreeing = self.rule.holds(*edges)
        agreeing[i] = False
        return agreeing
