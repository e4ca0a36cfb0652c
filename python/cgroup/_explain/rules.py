"""Explanations in words: facts about a group, and each match against the rule that selected it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cgroup._checks.arrays import BoolArray, FloatArray
from cgroup._show import words
from cgroup.errors import NoConsensusError
from cgroup.types import Agreement, Grouping, Rule

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
        self.points = None if points is None else (points[0].astype(np.float64), points[1].astype(np.float64))

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
        with np.errstate(invalid="ignore", over="ignore"):  # methods without points allow any
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


@dataclass(frozen=True)
class Verdict:
    """The reason why a match was kept or dropped, and the threshold."""

    reason: str
    remedy: str = ""
    threshold: float | None = None
    tolerance: float | None = None
    tells_residual: bool = False


def judge(facts: Facts, i: int) -> Verdict:
    """Return the reason why a match was kept or dropped."""
    return _by_nobody(facts, i) if facts.rule is None else _WORDINGS[facts.rule.kind](facts, facts.rule, i)


def _by_nobody(facts: Facts, i: int) -> Verdict:
    """Return the known facts for a user's own method."""
    grouping = facts.grouping
    if grouping.scores is None:
        what = "selected it" if grouping.mask[i] else "left it out"
        return Verdict(f"the method {what}, without a reason")
    if grouping.threshold is None:
        return Verdict(f"{_score(facts, i)} decided, by a cut that the method does not report")
    return _by_score(facts, None, i)


def _scores(facts: Facts) -> FloatArray:
    assert facts.grouping.scores is not None  # noqa: S101 - of methods that score
    return facts.grouping.scores


def _bound(rule: Rule) -> float:
    assert rule.bound is not None  # noqa: S101 - of rules that have one
    return rule.bound


def _score(facts: Facts, i: int, text: str | None = None) -> str:
    shown = words.number(float(_scores(facts)[i])) if text is None else text
    return f"its score of {shown} (rank {facts.rank(i)} of {len(_scores(facts))})"


def _by_score(facts: Facts, rule: Rule | None, i: int) -> Verdict:
    kept, score, cut = bool(facts.grouping.mask[i]), float(_scores(facts)[i]), facts.grouping.threshold
    if score == -np.inf:
        return Verdict("it has no descriptor, so that its similarity is -inf", threshold=cut)
    if cut is None:  # Otsu has no threshold for equal scores, GTM none without agreeing matches
        if rule is not None and rule.method == "gtm" and not kept:
            return Verdict("no two matches earn anything together, so that none was kept")
        outcome = "above 0, so that all were kept" if kept else "not above 0, so that none was kept"
        return Verdict(f"{_score(facts, i)} is that of all, {outcome}")
    shown, limit = words.told_apart(score, cut)
    if score == cut:
        place = "just reaches" if kept else "only equals"
    else:
        place = "is above" if kept else "is below"
    reason = f"{_score(facts, i, shown)} {place} the cut at {limit}"
    wanted = "at least" if rule is not None and rule.accepts_equality else "above"
    return Verdict(reason, "" if kept else f"with a score {wanted} {limit}", threshold=cut)


def _by_ratio(facts: Facts, rule: Rule, i: int) -> Verdict:
    ratio, greatest = words.told_apart(1.0 - float(_scores(facts)[i]), _bound(rule))
    reason = (
        f"its nearest descriptor is {ratio} times as far as the second nearest "
        f"(rank {facts.rank(i)} of {len(facts.grouping.mask)}), and {greatest} is accepted at most"
    )
    remedy = "" if facts.grouping.mask[i] else f"with a ratio of at most {greatest}"
    return Verdict(reason, remedy, threshold=facts.grouping.threshold)


def _by_residual(facts: Facts, rule: Rule, i: int) -> Verdict:
    bound, kept = _bound(rule), facts.grouping.mask[i]
    if facts.grouping.model is None or facts.residuals is None:
        return Verdict("the method found no pose, so that no match was kept", tolerance=bound)
    residual, limit = words.lengths(float(facts.residuals[i]), bound, rule.resolution)
    wanted = "at most" if rule.accepts_equality else "less than"
    reason = f"the group's pose leaves it {residual} from its partner, and {wanted} {limit} is accepted"
    instances = facts.grouping.instances
    if instances is not None and not kept and instances[:, i].any():
        reason += f"; it belongs to row {np.argmax(instances[:, i])} of the instances"
    remedy = "" if kept else f"with a residual of {wanted} {limit}"
    return Verdict(reason, remedy, tolerance=bound, tells_residual=True)


def _by_each_axis(facts: Facts, rule: Rule, i: int) -> Verdict:
    """TEASER++: pruned, or off along an axis."""
    bound = _bound(rule)
    if facts.grouping.model is None or facts.misfits is None:
        return Verdict("the method found no pose, so that no match was kept", tolerance=bound)
    misfit = float(np.abs(facts.misfits[i]).max())
    off, limit = words.lengths(misfit, bound, rule.resolution)
    along = f"along an axis of the target the pose leaves it {off} from its partner, and {limit} is accepted"
    if facts.grouping.mask[i]:
        return Verdict(f"{along}; the pruning left it", tolerance=bound)
    if misfit > bound:
        return Verdict(along, f"within {limit} along each axis, if the pruning left it", tolerance=bound)
    is_core = rule.kind == "axes in core"
    pruned = "the densest core" if is_core else "the largest set of matches that all keep their distances"
    reason = f"it isn't in {pruned}, which the pruning left, although the pose leaves it {off} along an axis"
    return Verdict(reason, tolerance=bound)


def _decider(rule: Rule, i: int) -> int:
    assert rule.decided_by is not None  # noqa: S101 - of rules that name one
    return int(rule.decided_by[i])


def _by_conflict(facts: Facts, rule: Rule, i: int) -> Verdict:
    """ST: accepted in the order of the scores, unless it conflicts with one that was accepted before."""
    scores, rival = _scores(facts), _decider(rule, i)
    if facts.grouping.mask[i]:
        return Verdict(f"{_score(facts, i)} had its turn before any that it conflicts with")
    if not facts.grouping.mask.any():
        return Verdict("no two matches agree, so that none was kept")
    if rival < 0:
        greatest = words.number(float(scores.max()))
        return Verdict(f"{_score(facts, i)} is nothing beside the greatest, {greatest}")
    own, other = words.told_apart(float(scores[i]), float(scores[rival]))
    order = f"{_score(facts, i, own)} comes after that of match {rival}, {other}, with which it conflicts"
    if rule.kind == "recomputed conflict":
        order = f"it conflicts with match {rival}, which was accepted before it"
    ratio, least = float(facts.ratios(*facts.edges(i, rival))[0]), _bound(rule)
    change = f"the ratio of their distances is {words.told_apart(ratio, least)[0]}, below {least:g}"
    reason = f"{order}: {'they share a point' if ratio <= 0.0 else change}"
    is_only = rule.conflicts is not None and rule.conflicts[i] == 1
    remedy = f"without match {rival}, the only one of the group that it conflicts with" if is_only else ""
    return Verdict(reason, remedy)


def _by_star(facts: Facts, rule: Rule, i: int) -> Verdict:
    """GC: the change of the distance to the seed."""
    scores, seed = _scores(facts), _decider(rule, i)
    own = words.number(float(scores[i]))
    if seed == i:
        return Verdict(f"it is the seed of the largest star, of {own} matches")
    ds, dt = facts.edges(i, seed)
    change, limit = words.lengths(float(abs(ds[0] - dt[0])), _bound(rule), rule.resolution)
    stars = f"{words.number(float(scores[seed]))} matches; its own has {own}"
    reason = (
        f"its distance to match {seed}, the seed of the largest star ({stars}), changes by {change}, and "
        f"less than {limit} is accepted"
    )
    return Verdict(reason, "" if facts.grouping.mask[i] else f"with a change of less than {limit}")


def _by_grown_set(facts: Facts, rule: Rule, i: int) -> Verdict:
    """GC as in PCL: a set with pairwise agreement, filtered by RANSAC."""
    mask, agreeing = facts.grouping.mask, facts.agreeing(i)
    if not mask.any():
        return Verdict(f"no set of more than {_bound(rule):g} matches keeps all its distances and has a pose")
    if mask[i]:
        return Verdict("it keeps its distance to the whole set, and the set's RANSAC filter left it")
    broken = 0 if agreeing is None else int(np.count_nonzero(mask & ~agreeing))
    if broken:
        return Verdict(f"it doesn't keep its distance to {broken} of the group, and one is too many")
    return Verdict(
        "it keeps its distance to all of the group, so that it broke that to one which the RANSAC filter "
        "removed, or was removed by that filter itself"
    )


def _by_largest(facts: Facts, _rule: Rule, i: int) -> Verdict:
    """CLIPPER: the k greatest entries, where k is the size of the set."""
    scores, mask = _scores(facts), facts.grouping.mask
    if not mask.any():
        return Verdict("no three matches that all agree fix a pose, so that none was kept")
    least = float(scores[mask].min())
    own, limit = words.told_apart(float(scores[i]), least)
    place = "is among" if mask[i] else "is not among"
    among = f"the {facts.grouping.size} greatest, as many as the densest set has members"
    reason = f"{_score(facts, i, own)} {place} {among}; the least of these is {limit}"
    return Verdict(reason, threshold=least)


def _by_vote(facts: Facts, rule: Rule, i: int) -> Verdict:
    """3DHV: the distance of a match's vote from the fullest bin, or from the group."""
    votes, mask = rule.votes, facts.grouping.mask
    assert votes is not None  # noqa: S101 - of 3DHV
    if not np.isfinite(votes[i]).all():
        return Verdict("it lacks a local frame, so that it casts no vote")
    if rule.kind == "maximum":
        return Verdict(_beside_the_maximum(facts, rule, votes, i))
    own, most = (int(np.count_nonzero((votes == place).all(axis=1))) for place in (votes[i], np.zeros(3)))
    where = f"in a bin {_steps(votes[i])} away from the fullest" if votes[i].any() else "in the fullest bin"
    count = f"its bin has {own} of the votes, the fullest {most}"
    reaches = {0: "", 6: " and the six that share a side with it", 26: " and the 26 around it"}
    reach = reaches[int(_bound(rule))]
    reason = f"it votes for a place of the source's centroid {where}: {count}"
    return Verdict(reason, "" if mask[i] else f"with a vote in the fullest bin{reach}")


def _steps(steps: FloatArray) -> str:
    parts = [f"{abs(step):.0f} along {axis}" for step, axis in zip(steps, "xyz", strict=True) if step]
    return " and ".join([", ".join(parts[:-1]), parts[-1]]) if len(parts) > 1 else parts[0]


def _beside_the_maximum(facts: Facts, rule: Rule, votes: FloatArray, i: int) -> str:
    """As in PCL: RANSAC filters the voters of each local maximum, and the largest set is selected."""
    mask = facts.grouping.mask
    if not mask.any():
        return "no maximum of the votes has voters whom one pose fits"
    off = words.length(float(np.linalg.norm(votes[i] - votes[mask].mean(axis=0))), rule.resolution)
    bins = words.length(_bound(rule), rule.resolution)
    place = f"it votes {off} from the group's mean vote (bins of {bins})"
    if mask[i]:
        return f"{place}, for the winning maximum, and the RANSAC filter left it"
    return f"{place}: not for the winning maximum, or the RANSAC filter of its voters removed it"


_WORDINGS: dict[str, Callable[[Facts, Rule, int], Verdict]] = {
    "score": _by_score, "ratio": _by_ratio, "residual": _by_residual, "axes in clique": _by_each_axis,
    "axes in core": _by_each_axis, "conflict": _by_conflict, "recomputed conflict": _by_conflict,
    "star": _by_star, "grown set": _by_grown_set, "greatest": _by_largest, "fullest bin": _by_vote,
    "maximum": _by_vote,
}  # fmt: skip
