"""By which rule each method keeps a match, and how a match stands to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cgroup._explain.pairs import option_length
from cgroup._explain.voting import explain_vote
from cgroup._show import words

if TYPE_CHECKING:
    from collections.abc import Callable

    from cgroup._explain.facts import Facts
    from cgroup._runtime.run import Run

_NEGLIGIBLE = 1e-12
"""ST ends where scores are below this share of the greatest."""


@dataclass(frozen=True)
class Verdict:
    """Why a match was kept or dropped, and by which cut."""

    reason: str
    remedy: str = ""
    threshold: float | None = None
    tolerance: float | None = None
    tells_residual: bool = False


def judge(facts: Facts, i: int) -> Verdict:
    """Say why a match was kept or dropped."""
    if facts.run is None:
        return _by_nobody(facts, i)
    return _RULES[facts.run.method](facts, facts.run, i)


def _by_nobody(facts: Facts, i: int) -> Verdict:
    """Return what is known of a method of one's own."""
    grouping = facts.grouping
    if grouping.scores is None:
        what = "selected it" if grouping.mask[i] else "left it out"
        return Verdict(f"the method {what}, and says no more")
    if grouping.threshold is None:
        return Verdict(f"{_score(facts, i)} decided, by a cut that the method doesn't tell")
    return _by_score(facts, i)


def _score(facts: Facts, i: int, text: str | None = None) -> str:
    scores = facts.grouping.scores
    assert scores is not None  # noqa: S101 - of methods that score
    shown = words.number(float(scores[i])) if text is None else text
    return f"its score of {shown} (rank {facts.rank(i)} of {len(scores)})"


def _by_score(facts: Facts, i: int, *, accepts_equality: bool = False) -> Verdict:
    grouping, kept = facts.grouping, bool(facts.grouping.mask[i])
    assert grouping.scores is not None  # noqa: S101 - of methods that score
    score, cut = float(grouping.scores[i]), grouping.threshold
    if score == -np.inf:
        return Verdict("it has no descriptor, so that its similarity is -inf", threshold=cut)
    if cut is None:
        return _without_cut(facts, i)
    shown, limit = words.told_apart(score, cut)
    if score == cut:
        place = "just reaches" if kept else "only equals"
    else:
        place = "lies above" if kept else "lies below"
    reason = f"{_score(facts, i, shown)} {place} the cut at {limit}"
    wanted = "at least" if accepts_equality else "above"
    return Verdict(reason, "" if kept else f"with a score {wanted} {limit}", threshold=cut)


def _without_cut(facts: Facts, i: int) -> Verdict:
    """Otsu finds no cut where all scores are alike, and GTM looks for none where no two agree."""
    kept = bool(facts.grouping.mask[i])
    if facts.run is not None and facts.run.method == "gtm" and not kept:
        return Verdict("no two matches earn anything together, so that none was kept")
    outcome = "above 0, so that all were kept" if kept else "not above 0, so that none was kept"
    return Verdict(f"{_score(facts, i)} is that of all, {outcome}")


def _by_similarity(facts: Facts, run: Run, i: int) -> Verdict:
    return _by_score(facts, i, accepts_equality=run.options["threshold"] != "otsu")


def _by_ratio(facts: Facts, run: Run, i: int) -> Verdict:
    grouping, kept = facts.grouping, bool(facts.grouping.mask[i])
    assert grouping.scores is not None  # noqa: S101 - NNSR scores
    ratio, greatest = words.told_apart(1.0 - float(grouping.scores[i]), float(run.options["max_ratio"]))
    reason = (
        f"its nearest descriptor is {ratio} times as far as the second nearest "
        f"(rank {facts.rank(i)} of {len(grouping.mask)}), and {greatest} is accepted at most"
    )
    remedy = "" if kept else f"with a ratio of at most {greatest}"
    return Verdict(reason, remedy, threshold=grouping.threshold)


def _by_cut(facts: Facts, _run: Run, i: int) -> Verdict:
    return _by_score(facts, i)


def _by_residual(
    multiple: float, *, share: float = 1.0, accepts_equality: bool = False
) -> Callable[[Facts, Run, int], Verdict]:
    """Return the rule of a method whose group is what its pose fits.

    Parameters
    ----------
    multiple : float
        The default tolerance in resolutions.
    share : float
        The bound as a multiple of the tolerance.
    accepts_equality : bool
        Whether the bound itself is accepted.
    """

    def rule(facts: Facts, run: Run, i: int) -> Verdict:
        bound = share * option_length(run, "tolerance", multiple)
        if facts.grouping.model is None or facts.residuals is None:
            return Verdict("the method found no pose, so that no match was kept", tolerance=bound)
        residual, limit = words.lengths(float(facts.residuals[i]), bound, run.resolution)
        wanted = "at most" if accepts_equality else "less than"
        reason = f"the group's pose leaves it {residual} from its partner, and {wanted} {limit} is accepted"
        reason += _instance(facts, i)
        remedy = "" if facts.grouping.mask[i] else f"with a residual of {wanted} {limit}"
        return Verdict(reason, remedy, tolerance=bound, tells_residual=True)

    return rule


def _instance(facts: Facts, i: int) -> str:
    """Name the further group of LC that a match belongs to."""
    instances = facts.grouping.instances
    if instances is None or facts.grouping.mask[i]:
        return ""
    holding = np.flatnonzero(instances[:, i])
    return f"; it belongs to row {holding[0]} of the instances" if len(holding) else ""


def _by_each_axis(facts: Facts, run: Run, i: int) -> Verdict:
    """TEASER++: pruned, or off along an axis."""
    bound = option_length(run, "tolerance", 2.5)
    if facts.grouping.model is None or facts.misfits is None:
        return Verdict("the method found no pose, so that no match was kept", tolerance=bound)
    off, limit = words.lengths(float(np.abs(facts.misfits[i]).max()), bound, run.resolution)
    along = f"along an axis of the target the pose leaves it {off} from its partner, and {limit} is accepted"
    if facts.grouping.mask[i]:
        return Verdict(f"{along}; the pruning left it", tolerance=bound)
    if np.abs(facts.misfits[i]).max() > bound:
        return Verdict(along, f"within {limit} along each axis, if the pruning left it", tolerance=bound)
    core = run.options["prune"] == "core"
    pruned = "the densest core" if core else "the largest set of matches that all keep their distances"
    reason = f"it isn't in {pruned}, which the pruning left, although the pose leaves it {off} along an axis"
    return Verdict(reason, tolerance=bound)


def _by_conflict(facts: Facts, run: Run, i: int) -> Verdict:
    """ST: accepted in the order of the scores, unless it conflicts with one that was accepted before."""
    grouping = facts.grouping
    assert grouping.scores is not None  # noqa: S101 - ST scores
    if grouping.mask[i]:
        return Verdict(f"{_score(facts, i)} had its turn before any that it conflicts with")
    edges = facts.edges(i)
    if edges is None or not grouping.mask.any():
        return Verdict("no two matches agree, so that none was kept")
    least = float(run.options["min_distance_ratio"])
    ratio, rule = edges.ratio, run.options["conflict"]
    conflicting = (ratio < least) & (rule != "one_to_one") | (ratio <= 0.0) & (rule != "rigidity")
    rivals = np.flatnonzero(conflicting & grouping.mask)
    if len(rivals) == 0:
        greatest = float(grouping.scores.max())
        if grouping.scores[i] <= _NEGLIGIBLE * greatest:
            return Verdict(f"{_score(facts, i)} is nothing beside the greatest, {words.number(greatest)}")
        rivals = grouping.indices[[int(np.argmin(ratio[grouping.indices]))]]  # at the bound but for rounding
    rival = int(rivals[np.argmax(grouping.scores[rivals])])
    own, other = words.told_apart(float(grouping.scores[i]), float(grouping.scores[rival]))
    change = (
        f"the ratio of their distances is {words.told_apart(float(ratio[rival]), least)[0]}, below {least:g}"
    )
    why = "they share a point" if ratio[rival] <= 0.0 else change
    order = f"{_score(facts, i, own)} comes after that of match {rival}, {other}, with which it conflicts"
    if run.options["recompute"]:
        order = f"it conflicts with match {rival}, which was accepted before it"
    reason = f"{order}: {why}"
    count = len(rivals)
    remedy = "" if count > 1 else f"without match {rival}, the only one of the group that it conflicts with"
    return Verdict(reason, remedy)


def _by_star(facts: Facts, run: Run, i: int) -> Verdict:
    """GC: how well it keeps its distance to the seed."""
    if run.options["variant"] == "clique":
        return _by_grown_set(facts, run, i)
    grouping, edges = facts.grouping, facts.edges(i)
    assert grouping.scores is not None and edges is not None  # noqa: PT018, S101 - GC scores, and has points
    seeds = np.array([int(grouping.diagnostics["seed_index"])])
    if run.options["ties"] == "union":
        seeds = np.flatnonzero(grouping.scores == grouping.scores.max())
    if i in seeds:
        return Verdict(f"it is the seed of the largest star, of {words.number(grouping.scores[i])} matches")
    changes = np.abs(edges.ds - edges.dt)[seeds]
    seed = int(seeds[np.argmin(changes)])
    bound = option_length(run, "tolerance", 3.0)
    change, limit = words.lengths(float(changes.min()), bound, run.resolution)
    stars = f"{words.number(grouping.scores[seed])} matches; its own has {words.number(grouping.scores[i])}"
    reason = (
        f"its distance to match {seed}, the seed of the largest star ({stars}), changes by {change}, and "
        f"less than {limit} is accepted"
    )
    return Verdict(reason, "" if grouping.mask[i] else f"with a change of less than {limit}")


def _by_grown_set(facts: Facts, run: Run, i: int) -> Verdict:
    """GC as in PCL: a set whose members all agree, filtered by RANSAC."""
    grouping = facts.grouping
    if not grouping.mask.any():
        least = int(run.options["min_cluster_size"])
        return Verdict(f"no set of more than {least} matches keeps all its distances and has a pose")
    if grouping.mask[i]:
        return Verdict("it keeps its distance to the whole set, and the set's RANSAC filter left it")
    agreeing = facts.agreeing(i)
    assert agreeing is not None  # noqa: S101 - GC has points
    broken = int(np.count_nonzero(grouping.mask & ~agreeing))
    if broken:
        return Verdict(f"it doesn't keep its distance to {broken} of the group, and one is too many")
    return Verdict(
        "it keeps its distance to all of the group, so that it broke that to one which the RANSAC filter "
        "removed, or was removed by that filter itself"
    )


def _by_largest(facts: Facts, _run: Run, i: int) -> Verdict:
    """CLIPPER: the greatest entries, as many as the set has members."""
    grouping = facts.grouping
    assert grouping.scores is not None  # noqa: S101 - CLIPPER scores
    if not grouping.mask.any():
        return Verdict("no three matches that all agree fix a pose, so that none was kept")
    least = float(grouping.scores[grouping.mask].min())
    own, limit = words.told_apart(float(grouping.scores[i]), least)
    among = (
        f"the {grouping.size} greatest, as many as the densest set has members; the least of these is {limit}"
    )
    place = "is among" if grouping.mask[i] else "is not among"
    return Verdict(f"{_score(facts, i, own)} {place} {among}", threshold=least)


def _by_vote(facts: Facts, run: Run, i: int) -> Verdict:
    return Verdict(*explain_vote(facts, run, i))


_RULES: dict[str, Callable[[Facts, Run, int], Verdict]] = {
    "ss": _by_similarity,
    "nnsr": _by_ratio,
    "si": _by_cut,
    "cv": _by_cut,
    "ransac": _by_residual(5.0),
    "st": _by_conflict,
    "gc": _by_star,
    "3dhv": _by_vote,
    "gtm": _by_cut,
    "lc": _by_residual(3.0, share=5.0 / 3.0, accepts_equality=True),
    "mac": _by_residual(5.0),
    "sc2pcr": _by_residual(5.0),
    "turboreg": _by_residual(5.0),
    "teaser": _by_each_axis,
    "clipper": _by_largest,
    "register": _by_residual(np.nan, accepts_equality=True),
}
