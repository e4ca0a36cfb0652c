"""Poses from surveyed targets: least squares, and tests that name blunders."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cgroup import _core
from cgroup._checks.arrays import finite_points
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.quoting import escape
from cgroup._checks.values import as_items, as_length, as_named, run_options
from cgroup._show.words import number
from cgroup.errors import InputError
from cgroup.types import BoolArray, FloatArray

__all__ = ["TargetFit", "fit_targets"]

_DOUBTS = {
    "swapped": "one file has x and y swapped: the mirrored targets agree",
    "units": "the units differ: the target's distances are {unit:.6g} of the source's",
    "redundancy": "three targets have no redundancy in which a blunder could be named",
    "residuals": "the residuals are larger than sigma explains",
    "line": "the targets are almost on one line, about which the pose is uncertain",
    "suspects": "a blunder exists that cannot be named: it is among {suspects}",
    "possible": "a blunder is possible, but none is significant",
}


@dataclass(frozen=True, eq=False)
class TargetFit:
    """The pose of a source in the frame of surveyed targets, and tests of each.

    Attributes
    ----------
    pose : (4,4) array of float64
        Least-squares pose of the used targets: maps source points into the target's frame.
    covariance : (6,6) array of float64
        Of (rotation vector, translation) in the target's frame, as for `Registration.covariance`; by
        Student's distribution, because sigma is estimated.
    residuals : (n,3) array of float64
        Target minus posed source, of each target.
    leave_one_out : (n,) array of float64
        Distance of each target from its place by the pose of the other used ones; NaN if these fix none.
    is_blunder : (n,) array of bool
        Targets that are named as blunders. They are not used.
    is_used : (n,) array of bool
        Targets of the pose. One that is neither used nor a blunder is a suspect: see `notes`.
    sigma : float
        Estimated standard deviation of a coordinate of the residuals, source and target together.
    redundancy : int
        Observed coordinates of the used targets beyond the six of the pose.
    ok : bool
        Whether no doubt remains: the used targets can reveal a blunder, and they agree.
    names : list of str
        Names of the targets.
    notes : tuple of str
        Blunders, doubts, and unmatched names, one sentence each.
    """

    pose: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    leave_one_out: FloatArray
    is_blunder: BoolArray
    is_used: BoolArray
    sigma: float
    redundancy: int
    ok: bool
    names: list[str]
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        answer, used = "ok" if self.ok else "not ok", f"{self.is_used.sum()} of {len(self.names)}"
        return f"TargetFit({answer}, targets={used} used, sigma={self.sigma:.3g})"


@explain_wrong_calls
def fit_targets(
    source: ArrayLike | Mapping[str, ArrayLike],
    target: ArrayLike | Mapping[str, ArrayLike],
    *,
    names: Sequence[str] | None = None,
    sigma: float | None = None,
) -> TargetFit:
    """Estimate the pose of a source from surveyed targets, and name blunders.

    The smallest set of targets without which the others agree significantly better is named, if no other set
    of its size explains the residuals as well (W. Baarda's data snooping, extended to sets). Three targets
    have no redundancy in which a blunder could be named; among four, one is named if it distorts all
    triangles but one.

    Parameters
    ----------
    source, target : (n,3) array_like of float, or dict of str to (3,) array_like of float
        Three to 1000 targets in both frames and in one unit: row by row, or matched by name.
    names : sequence of str, optional
        Names of the rows; by default their numbers from 1.
    sigma : float, optional
        Expected standard deviation of a coordinate of the residuals. It counts as ten observations.

    Returns
    -------
    TargetFit
        Pose, covariance, and residuals.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import fit_targets
    >>> source = np.random.default_rng(0).uniform(0, 50, (6, 3))
    >>> target = source + np.random.default_rng(1).normal(0, 0.003, (6, 3))
    >>> target[4, 0] += 0.5
    >>> fit = fit_targets(source, target, names=["T1", "T2", "T3", "T4", "T5", "T6"])
    >>> fit, fit.notes
    (TargetFit(ok, targets=5 of 6 used, sigma=0.00156), ('T5 is a blunder: 0.5 from its place',))
    """
    if isinstance(source, Mapping) and isinstance(target, Mapping):
        remedy = "give a dict of points by name"
        source = as_named("source", source, remedy, may_be_empty=True)
        target = as_named("target", target, remedy, may_be_empty=True)
        called, one, other, notes = _match_names(source, target)
    else:
        one, other, notes = finite_points("source", source), finite_points("target", target), []
        called = [*map(str, range(1, len(one) + 1))] if names is None else _as_names(names, len(one))
    expected = None if sigma is None else as_length("sigma", sigma)
    fit, suspects, unit, doubts = _core.fit_targets(one, other, expected, run_options())
    words = {"unit": unit, "suspects": _list(called[row] for row in np.flatnonzero(suspects))}
    away, named = fit[3:5]
    places = ((escape(called[row]), number(away[row])) for row in np.flatnonzero(named))
    blunders = (f"{name} is a blunder: {distance} from its place" for name, distance in places)
    wording = (_DOUBTS[doubt].format(**words) for doubt in doubts)
    return TargetFit(*fit, ok=not doubts, names=called, notes=(*blunders, *wording, *notes))


def _match_names(
    source: Mapping[str, ArrayLike], target: Mapping[str, ArrayLike]
) -> tuple[list[str], FloatArray, FloatArray, list[str]]:
    """Return the common names, their rows, and notes on the other names."""
    called = [name for name in source if name in target]
    if len(called) < 3:
        got = f"{len(called)} common names; source: {_list(source)}; target: {_list(target)}"
        raise InputError("source, target", got, "a pose needs three targets of the same names")
    both = ("source", source), ("target", target)
    one, other = (finite_points(where, [some[name] for name in called]) for where, some in both)
    lonely = [(where, [name for name in some if name not in called]) for where, some in both]
    return called, one, other, [f"only in the {where}: {_list(some)}" for where, some in lonely if some]


def _as_names(names: Sequence[str], count: int) -> list[str]:
    called = [*map(str, as_items("names", names, "give one per target"))]
    if len(called) != count or len({*called}) != count:
        raise InputError("names", f"{len({*called})} for {count} targets", "give one per target, each once")
    return called


def _list(names: Iterable[str]) -> str:
    return ", ".join(map(escape, names)) or "none"
