"""Poses from surveyed targets: least squares, and tests that name blunders."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.arrays import finite_points
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.quoting import escape
from cgroup._checks.values import as_items, as_length
from cgroup._show.words import number
from cgroup.errors import InputError
from cgroup.rigid import apply
from cgroup.rigid.se3 import about, cross
from cgroup.types import BoolArray, FloatArray

__all__ = ["TargetFit", "fit_targets"]

_NAMED, _DOUBTED = 0.001, 0.01  # probabilities of naming, and of suspecting, a blunder where there is none
_KNOWN = 10  # observations that a given sigma counts as; it is then right to 22 %
_MOST_TARGETS, _MOST_SUBSETS = 1000, 5000
_ROUNDING, _ON_A_LINE = 1e-15, 1e-6  # parts of the coordinates, and of the extent
_LINE = 20.0  # standard deviations beside a line below which targets are almost on it
_BETTER = 100.0  # ratio of squared residuals by which swapped axes or another unit are noticed
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)


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
        called, one, other, notes = _match_names(source, target)
    else:
        one, other, notes = finite_points("source", source), finite_points("target", target), []
        called = [*map(str, range(1, len(one) + 1))] if names is None else _as_names(names, len(one))
    expected = None if sigma is None else as_length("sigma", sigma)
    if len(one) != len(other) or not 3 <= len(one) <= _MOST_TARGETS:
        got = f"{len(one)} and {len(other)} targets"
        raise InputError("source, target", got, f"give three to {_MOST_TARGETS}, in both frames")
    fits = _Fits(one, other, expected)
    if not fits.fit(np.ones((1, len(one)), dtype=bool), fits.source)[-1][0]:
        got = "targets on one line, about which the pose may rotate"
        raise InputError("source, target", got, "add one beside that line")
    return _report(fits, called, notes)


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


class _Fits:
    """Least-squares poses of subsets of the targets, which are masks (m,n)."""

    def __init__(self, source: FloatArray, target: FloatArray, expected: float | None) -> None:
        self.middles = source.mean(axis=0), target.mean(axis=0)
        self.source, self.target = source - self.middles[0], target - self.middles[1]
        self.known = 0 if expected is None else _KNOWN
        self._sum = self.known * (expected or 0.0) ** 2
        self._floor = (_ROUNDING * max(np.abs(source).max(), np.abs(target).max())) ** 2

    def fit(
        self, masks: BoolArray, source: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
        """Return poses (m,4,4), residuals (m,n,3), sums of squares (m,), and whether they are fixed (m,)."""
        shares = masks / masks.sum(axis=1, keepdims=True)
        one, other = shares @ source, shares @ self.target
        spread = np.einsum("mn,ni,nj->mij", shares, self.target, source) - other[:, :, None] * one[:, None]
        left, sizes, right = np.linalg.svd(spread)
        left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
        poses = np.tile(np.eye(4), (len(masks), 1, 1))
        poses[:, :3, :3] = turns = left @ right
        poses[:, :3, 3] = other - np.einsum("mij,mj->mi", turns, one)
        residuals = self.target - np.einsum("mij,nj->mni", turns, source) - poses[:, None, :3, 3]
        sums = np.einsum("mn,mni,mni->m", masks, residuals, residuals)
        return poses, residuals, sums, sizes[:, 1] > _ON_A_LINE**2 * sizes[:, 0]

    def variance(self, sums: FloatArray, redundancy: int) -> FloatArray:
        """Return the variance of a coordinate; a given one counts as `known` observations."""
        return (sums + self._sum) / (redundancy + self.known) + self._floor

    def test(self, excess: FloatArray, size: int, sums: FloatArray, redundancy: int) -> FloatArray:
        """Return the probability of such an excess of squares by some targets, beside those of the others."""
        ratio = excess / (3 * size) / self.variance(sums, redundancy)
        return f_tail(ratio, 3 * size, redundancy + self.known)

    def leave_one_out(self, used: BoolArray) -> FloatArray:
        """Return the distance (n,) of each target from where the other used ones place it."""
        _, residuals, _, fixed = self.fit(used & ~np.eye(len(used), dtype=bool), self.source)
        return np.where(fixed, np.linalg.norm(np.einsum("nni->ni", residuals), axis=1), np.nan)

    def doubts(self, used: BoolArray) -> list[str]:
        """Return what is doubtful about the fit of the used targets."""
        rows, redundancy, found = np.ones((1, len(used)), dtype=bool), 3 * int(used.sum()) - 6, list[str]()
        squares = self.fit(used[None], self.source)[2]
        if len(used) == 3 and not self.known:
            found.append("three targets have no redundancy in which a blunder could be named")
        ratio = squares / redundancy / (self._sum / _KNOWN + self._floor)
        if self.known and f_tail(ratio, redundancy, _KNOWN) < _DOUBTED:
            found.append("the residuals are larger than sigma explains")
        width = np.linalg.svd(self.source[used] - self.source[used].mean(axis=0))[1][1]
        if width < _LINE * np.sqrt(self.variance(squares, redundancy)):
            found.append("the targets are almost on one line, about which the pose is uncertain")
        unit = float(np.linalg.norm(self.target) / np.linalg.norm(self.source))
        changed = self.source, self.source[:, [1, 0, 2]], unit * self.source
        own, swapped, scaled = (float(self.fit(rows, points)[2][0]) for points in changed)
        if len(used) > 3 and _BETTER * swapped < own:
            found.append("one file has x and y swapped: the mirrored targets agree")
        elif len(used) > 3 and _BETTER * scaled < own:
            found.append(f"the units differ: the target's distances are {unit:.6g} of the source's")
        return found

    def find_blunders(self) -> tuple[BoolArray, BoolArray, BoolArray, float]:
        """Return masks of used targets, blunders and suspects, and the probability that no other is one."""
        used, named, suspects = np.ones(len(self.source), bool), *np.zeros((2, len(self.source)), bool)
        while not suspects.any():
            best, possible, chance = self._find_set(used)
            if best is None:
                return used, named, suspects, chance
            sure = used & ~possible.any(axis=0)
            suspects = used & ~possible.all(axis=0) & ~sure
            used, named = best, named | sure
        return used, named, suspects, 1.0

    def _find_set(self, used: BoolArray) -> tuple[BoolArray | None, BoolArray, float]:
        """Return the targets that a set of blunders leaves, each possible set, and the least probability."""
        rows, chances, found = np.flatnonzero(used), [1.0], []
        everything, most = self.fit(used[None], self.source)[2][0], len(rows) - max(3, len(used) // 2 + 1)
        for size in range(1, most + 1):
            if (count := comb(len(rows), size)) > _MOST_SUBSETS:
                break
            masks = np.tile(used, (count, 1))
            masks[np.arange(count)[:, None], [*combinations(rows.tolist(), size)]] = False
            _, _, sums, fixed = self.fit(masks, self.source)
            best, left = int(np.argmin(np.where(fixed, sums, np.inf))), 3 * (len(rows) - size) - 6
            chance = float(self.test(everything - sums[best], size, sums[best], left)) if fixed[best] else 1.0
            chances.append(2 ** (size - 1) * count * chance)
            if chances[-1] < _NAMED:
                possible = self.test(sums - sums[best], 1, sums[best], left) >= _DOUBTED
                found.append((masks[best], masks[possible]))
                if possible.sum() == 1:
                    break
        # The smallest significant set that no other of its size equals, or else the smallest one.
        clear = [one for one in found if len(one[1]) == 1] or found or [(None, used[None])]
        return *clear[0], min(chances[:2])


def f_tail(ratio: ArrayLike, count: int, freedom: int) -> FloatArray:
    """Return the probability that a ratio of variances, of `count` to `freedom` observations, is larger."""

    def integrate(top: FloatArray) -> FloatArray:
        angles = top[..., None] * (_NODES + 1) / 2
        return top * (np.sin(angles) ** (freedom - 1) * np.cos(angles) ** (count - 1) @ _WEIGHTS)

    top = np.asarray(np.arctan2(np.sqrt(freedom), np.sqrt(count * np.maximum(ratio, 0.0))))
    return integrate(top) / integrate(np.full_like(top, np.pi / 2))


def _report(fits: _Fits, called: list[str], notes: list[str]) -> TargetFit:
    used, named, suspects, chance = fits.find_blunders()
    (pose,), (residuals,), (squares,), _ = fits.fit(used[None], fits.source)
    away, redundancy, doubts = fits.leave_one_out(used), 3 * int(used.sum()) - 6, fits.doubts(used)
    variance, freedom = fits.variance(squares, redundancy), redundancy + fits.known
    placed = apply(pose, fits.source[used])
    extent = np.abs(placed).max()
    motion = np.concatenate([-cross(placed / extent), np.tile(np.eye(3), (len(placed), 1, 1))], axis=2)
    change = about(-fits.middles[1]) @ np.diag([1 / extent] * 3 + [1.0] * 3)
    cofactors = change @ np.linalg.inv(np.einsum("nki,nkj->ij", motion, motion)) @ change.T
    pose[:3, 3] += fits.middles[1] - pose[:3, :3] @ fits.middles[0]
    if suspects.any():
        some = _list(name for name, suspect in zip(called, suspects, strict=True) if suspect)
        doubts.append(f"a blunder exists that cannot be named: it is among {some}")
    elif chance < _DOUBTED:
        doubts.append("a blunder is possible, but none is significant")
    places = ((escape(called[row]), number(away[row])) for row in np.flatnonzero(named))
    blunders = (f"{name} is a blunder: {distance} from its place" for name, distance in places)
    return TargetFit(
        pose=pose,
        covariance=variance * freedom / (freedom - 2) * cofactors,
        residuals=residuals,
        leave_one_out=away,
        is_blunder=named,
        is_used=used,
        sigma=float(np.sqrt(variance)),
        redundancy=redundancy,
        ok=not doubts,
        names=called,
        notes=(*blunders, *doubts, *notes),
    )
