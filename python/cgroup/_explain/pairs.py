"""When two matches keep their distance: each method's own rule, or a stated one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cgroup._show import words

if TYPE_CHECKING:
    from collections.abc import Callable

    from cgroup._checks.array_types import BoolArray, FloatArray
    from cgroup._runtime.run import Run

_STATED_DIFFERENCE = 3.0
"""Resolutions, where the method has no rule of its own."""

_STATED_RATIO = 0.9

_LEAST_AFFINITY = 1e-4
"""CLIPPER takes a lower affinity for none."""

ZERO_EDGE = 1e-12
"""Share of a side's bounding box within which two of its points coincide."""


@dataclass(frozen=True)
class PairRule:
    """A bound on how a distance changes from the source to the target.

    Attributes
    ----------
    bound : float
        On ``|ds - dt|``, or on ``min(ds/dt, dt/ds)``.
    is_ratio : bool
        Which of the two.
    text : str
        The rule in words.
    accepts_equality : bool
        Whether the bound itself is accepted.
    least_sum, least_each : float or None
        What ``ds + dt``, or each of the two, has to exceed.
    scale : float
        Factor of the source's lengths.
    """

    bound: float
    is_ratio: bool
    text: str
    accepts_equality: bool = False
    least_sum: float | None = None
    least_each: float | None = None
    scale: float = 1.0

    def holds(self, ds: FloatArray, dt: FloatArray, zero: BoolArray) -> BoolArray:
        """Tell which pairs keep their distance; `zero` marks those that share a point."""
        ds = self.scale * ds
        if self.is_ratio:
            change, bound = -distance_ratio(ds, dt, zero), -self.bound
        else:
            change, bound = np.abs(ds - dt), self.bound
        held = change <= bound if self.accepts_equality else change < bound
        if self.least_sum is not None:
            held &= ds + dt > self.least_sum
        if self.least_each is not None:
            held &= np.minimum(ds, dt) > self.least_each
        return held


def distance_ratio(ds: FloatArray, dt: FloatArray, zero: BoolArray) -> FloatArray:
    """Return ``min(ds/dt, dt/ds)``, 0 where two share a point."""
    longer = np.maximum(ds, dt)
    ratio = np.divide(np.minimum(ds, dt), longer, out=np.zeros_like(longer), where=longer > 0.0)
    return np.where(zero, 0.0, ratio)


def option_length(run: Run, name: str, multiple: float) -> float:
    """Return a length among the options: as given, or a multiple of the resolution."""
    given = run.options.get(name)
    return float(given) if given is not None else multiple * (run.resolution or np.nan)


def pair_rule(run: Run | None, diagnostics: dict[str, float]) -> PairRule:
    """Return the rule by which a method's matches keep their distance."""
    own = None if run is None else _own_rule(run, diagnostics)
    if own is not None:
        return own
    resolution = None if run is None else run.resolution
    remark = "(the method has no rule of its own for that)"
    if resolution is None:
        return PairRule(_STATED_RATIO, is_ratio=True, text=f"within a ratio of {_STATED_RATIO} {remark}")
    return PairRule(
        _STATED_DIFFERENCE * resolution,
        is_ratio=False,
        text=f"within {_STATED_DIFFERENCE:g} pr {remark}",
    )


def _own_rule(run: Run, diagnostics: dict[str, float]) -> PairRule | None:
    if run.method == "teaser":  # the one whose lengths may be scaled
        return _difference(run, _bound_or(run, 2.0, 2.5), least_sum=0.0, scale=diagnostics.get("scale", 1.0))
    rule = _OWN_RULES.get(run.method)
    return None if rule is None else rule(run)


def _ratio_rule(run: Run) -> PairRule:
    bound = float(run.options["min_distance_ratio"])
    text = f"within a ratio of {words.number(bound)}"
    return PairRule(bound, is_ratio=True, text=text, accepts_equality=run.method == "st")


def _consistency_voting_rule(run: Run) -> PairRule:
    bound = option_length(run, "distance_scale", 10.0)
    text = f"within {words.length(bound, run.resolution)} (where a vote has fallen to 1/e)"
    return PairRule(bound, is_ratio=False, text=text)


def _game_rule(run: Run) -> PairRule | None:
    if run.options["payoff"] != "distance_difference":
        return None
    return _difference(run, option_length(run, "tolerance", 3.0), accepts_equality=True)


def _geometric_consistency_rule(run: Run) -> PairRule:
    is_clique = run.options["variant"] == "clique"
    return _difference(run, option_length(run, "tolerance", 3.0), accepts_equality=is_clique)


def _residual_rule(run: Run) -> PairRule:
    bound = 2.0 * option_length(run, "tolerance", 5.0)
    text = f"within {words.length(bound, run.resolution)} (as any two do that one pose fits)"
    return PairRule(bound, is_ratio=False, text=text)


def _turboreg_rule(run: Run) -> PairRule:
    given = run.options["nms_radius"]
    least = 1.5 * option_length(run, "tolerance", 5.0) if given is None else float(given)
    return _difference(run, _bound_or(run, 0.12, 5.0), least_sum=least)


def _bound_or(run: Run, share: float, multiple: float) -> float:
    """Return the bound on the distance difference, by default a share of the tolerance."""
    given = run.options["max_distance_difference"]
    return share * option_length(run, "tolerance", multiple) if given is None else float(given)


def _clipper_rule(run: Run) -> PairRule:
    bound = option_length(run, "max_distance_difference", 5.0)
    deviation = run.options["deviation"]
    deviation = bound / 3.0 if deviation is None else float(deviation)
    felt = deviation * float(np.sqrt(-2.0 * np.log(_LEAST_AFFINITY)))
    return _difference(run, min(bound, felt), least_each=float(run.options["min_distance"]))


def _difference(
    run: Run,
    bound: float,
    *,
    accepts_equality: bool = False,
    least_sum: float | None = None,
    least_each: float | None = None,
    scale: float = 1.0,
) -> PairRule:
    return PairRule(
        bound,
        is_ratio=False,
        text=f"within {words.length(bound, run.resolution)}",
        accepts_equality=accepts_equality,
        least_sum=least_sum,
        least_each=least_each,
        scale=scale,
    )


_OWN_RULES: dict[str, Callable[[Run], PairRule | None]] = {
    "si": _ratio_rule,
    "cv": _consistency_voting_rule,
    "ransac": _residual_rule,
    "st": _ratio_rule,
    "gc": _geometric_consistency_rule,
    "gtm": _game_rule,
    "lc": lambda run: _difference(run, option_length(run, "tolerance", 3.0)),
    "mac": lambda run: _difference(run, _bound_or(run, 0.2, 5.0), accepts_equality=True),
    "sc2pcr": lambda run: _difference(run, _bound_or(run, 1.0, 5.0)),
    "turboreg": _turboreg_rule,
    "clipper": _clipper_rule,
    "register": _residual_rule,
}
