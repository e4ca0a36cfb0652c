"""Facts about a group and its matches, computed once for all explanations."""

from functools import cached_property

import numpy as np

from cgroup._checks.arrays import BoolArray, FloatArray
from cgroup._show import words
from cgroup.errors import NoConsensusError
from cgroup.types import Agreement, Grouping

_STATED_DIFFERENCE = 3.0  # resolutions, where the method has no rule of its own
_STATED_RATIO = 0.9

_ZERO_EDGE = 1e-12  # share of a side's bounding box within which two of its points coincide
_NOTES = {
    "cv": " (where a vote has fallen to 1/e)",
    "ransac": " (as any two do that one pose fits)",
    "register": " (as any two do that one pose fits)",
}
"""What a method's bound on distances means, where it is no test of the method."""


class Facts:
    """A group, its rule, the points of all matches, and derived values."""

    def __init__(self, grouping: Grouping) -> None:
        self.grouping = grouping
        self.rule = grouping.rule
        self.resolution = None if grouping.rule is None else grouping.rule.resolution
        points = grouping._positions  # noqa: SLF001  # pyright: ignore[reportPrivateUsage] - what it is there for
        self.points: tuple[FloatArray, FloatArray] | None = (
            None if points is None else (points[0].astype(np.float64), points[1].astype(np.float64))
        )

    @cached_property
    def agreement(self) -> Agreement:
        """Criterion for two matches that preserve their distance: the method's own, or the default."""
        if self.rule is not None and self.rule.agreement is not None:
            return self.rule.agreement
        if self.resolution is None:
            return Agreement(_STATED_RATIO, is_ratio=True)
        return Agreement(_STATED_DIFFERENCE * self.resolution)

    @cached_property
    def agreement_text(self) -> str:
        """The criterion in words."""
        bound, is_own = self.agreement.bound, self.rule is not None and self.rule.agreement is not None
        shown = words.number(bound) if self.agreement.is_ratio else words.length(bound, self.resolution)
        note = _NOTES.get(self.rule.method, "") if self.rule is not None and is_own else ""
        remark = note if is_own else " (the method has no rule of its own for that)"
        return f"within {'a ratio of ' if self.agreement.is_ratio else ''}{shown}{remark}"

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
        """(n,3) differences of the moved source points from their target points."""
        if self.points is None or self.pose is None:
            return None
        source, target = self.points
        return source @ self.pose[:3, :3].T + self.pose[:3, 3] - target

    @cached_property
    def residuals(self) -> FloatArray | None:
        """(n,) lengths of the misfits."""
        return None if self.misfits is None else np.linalg.norm(self.misfits, axis=1)

    def rank(self, i: int) -> int | None:
        """Place of a match by its score, 1 for the greatest."""
        scores = self.grouping.scores
        return None if scores is None else 1 + int(np.count_nonzero(scores > scores[i]))

    @cached_property
    def _zero_lengths(self) -> tuple[float, float]:
        assert self.points is not None  # noqa: S101 - needed for ratios
        source, target = (_ZERO_EDGE * float(np.linalg.norm(np.ptp(side, axis=0))) for side in self.points)
        return source, target

    def edges(self, i: int, other: int | None = None) -> tuple[FloatArray, FloatArray]:
        """Distances of one match to another, or to all, in the source and in the target."""
        assert self.points is not None  # noqa: S101 - of methods that take points
        rows = slice(None) if other is None else [other]
        ds, dt = (np.linalg.norm(side[rows] - side[i], axis=1) for side in self.points)
        return ds, dt

    def ratios(self, ds: FloatArray, dt: FloatArray) -> FloatArray:
        """Return ``min(ds/dt, dt/ds)``, 0 for two matches with a common point."""
        longer = np.maximum(ds, dt)
        ratio = np.divide(np.minimum(ds, dt), longer, out=np.zeros_like(longer), where=longer > 0.0)
        return np.where((ds <= self._zero_lengths[0]) | (dt <= self._zero_lengths[1]), 0.0, ratio)

    def agreeing(self, i: int) -> BoolArray | None:
        """Mask of the other matches that preserve their distance to a match."""
        if self.points is None:
            return None
        rule, (ds, dt) = self.agreement, self.edges(i)
        if rule.is_ratio:
            change, bound = -self.ratios(ds, dt), -rule.bound
        else:
            change, bound = np.abs(rule.scale * ds - dt), rule.bound
        agreeing = change <= bound if rule.accepts_equality else change < bound
        if rule.least_sum is not None:
            agreeing &= rule.scale * ds + dt > rule.least_sum
        if rule.least_each is not None:
            agreeing &= np.minimum(ds, dt) > rule.least_each
        agreeing[i] = False
        return agreeing
