"""Rank poses, estimate their probability, and accept or reject them with reasons.

The coefficients were fitted on generated worlds and half of the pairs of real scans (see
`docs/registration-internals.md`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cgroup._runtime.workers import cached_property
from cgroup.registration.evidence import Evidence
from cgroup.registration.matching import turn_matches
from cgroup.registration.motions import say_motion
from cgroup.registration.prepare import LEAST_VOXELS, UNIT, PreparedScan
from cgroup.rigid import apply, invert
from cgroup.rigid.se3 import adjoint
from cgroup.types import Agreement, BoolArray, Correspondences, FloatArray, Grouping, IndexArray, Rule
from cgroup.verification import Alignment
from cgroup.verification.schedule import DIFFERENT_DEGREES, DIFFERENT_UNITS

ACCEPTED = 0.5  # probability from which a pose is accepted
SURE = 0.9  # probability from which the search ends
GROUP_WITHIN = 2.0  # residual in voxels within which a match belongs to the verified group
MOST_OPEN_MOTIONS = 1  # largest number of open motions: along a corridor a pose is still useful
MOST_MATCHES = 20  # number of matches beyond which more add no evidence
LEAST_NOISE = 0.02  # least deviation of a surface's points from its planes, in voxels
CROSSED_BY_CHANCE = 0.02  # share in free space that noise and coarse rings explain
# Number of planes that wrong poses align too, and largest number of further ones that count
PLANES_BY_CHANCE, MOST_FURTHER_PLANES = 4, 3
LEAD_BY_CHANCE = 1.0  # nats by which the best of equal poses leads
MOST_REPEATS = 0.01  # share of repeated points from which a note is added
AS_GOOD = 0.3  # share of the best pose's probability from which another one counts as an alternative

_LEAST_SCORE = 1e-3
_NOTHING_PAIRED = 100.0
_MOST_NATS = 30.0
_SIZES_DIFFER = 1.5


@dataclass(frozen=True, eq=False)
class Found:
    """The best pose of a search, and the evidence for it."""

    refined: Alignment  # the best pose, refined on the fine surfaces
    alternatives: FloatArray  # (k,4,4), other poses that share the probability
    probability: float  # that it is right
    fitness: float  # share of the source's surface that overlaps the target's
    matches: Correspondences  # every match of the search
    source: PreparedScan  # the scans, at the voxel of the search
    target: PreparedScan
    motions: int = 0  # number of open motions
    cases: tuple[Case, ...] = ()  # evidence for the pose, and for its rivals
    target_fitness: float = 0.0  # share of the target's surface that overlaps the source's
    places: FloatArray = field(default_factory=lambda: np.empty((0, 4, 4)))  # (c,4,4), the poses of these
    better_scale: float = 1.0  # scale of the source that fits clearly better than 1, or 1

    def turned(self) -> Found:
        """Swap source and target."""
        pose = self.refined.T_target_source
        back, change = invert(pose), adjoint(pose)  # T^-1 = Exp(-Ad(T^-1) x) T_found^-1
        open_motion = self.refined.open_motion
        refined = replace(
            self.refined,
            T_target_source=back,
            information=change.T @ self.refined.information @ change,
            open_motion=None if open_motion is None else -adjoint(back) @ open_motion,
        )
        return replace(
            self,
            refined=refined,
            alternatives=np.linalg.inv(self.alternatives),
            places=np.linalg.inv(self.places),
            better_scale=1 / self.better_scale,
            matches=turn_matches(self.matches, self.target.scan.centroid),
            source=self.target,
            target=self.source,
        )

    @cached_property
    def grouping(self) -> Grouping:
        """The matches that agree with the pose."""
        matches, pose, within = self.matches, self.refined.T_target_source, GROUP_WITHIN * self.source.voxel
        residuals = np.linalg.norm(apply(pose, matches.source) - matches.target, axis=1)
        positions = (matches.source, matches.target)
        rule = Rule(
            "register",
            "residual",
            within,
            accepts_equality=True,
            agreement=Agreement(2.0 * within),
            resolution=matches.resolution,
        )
        return Grouping(residuals <= within, None, None, pose, {}, rule=rule, _positions=positions)


@dataclass(frozen=True)
class Judgement:
    """Whether a pose is accepted, its probability, the reason of a rejection, and notes for the user."""

    ok: bool
    probability: float
    reason: str
    notes: tuple[str, ...]


def judge(
    found: Found | None,
    source: PreparedScan,
    target: PreparedScan,
    axis: FloatArray | None = None,
    *,
    scaled: bool = False,
) -> Judgement:
    """Judge the result of a search in two scans; `scaled` if the scale was estimated."""
    if found is None:
        reason = "no pose could be proposed" + ("" if axis is None else " that keeps the axis")
        reason = f"{reason}; {_remedy(source, target, axis, scaled=scaled)}"
        return Judgement(ok=False, probability=0.0, reason=reason, notes=())
    notes = tuple(_notes(found))
    notes += tuple(_count_strays(scan) for scan in (source, target) if scan.scan.strays)
    notes += tuple(_count_repeats(scan) for scan in (source, target) if _repeats(scan))
    if is_accepted(found.probability):
        notes += (*_find_rounded(source, target), *_find_layers(source, target))
        return Judgement(ok=True, probability=found.probability, reason="", notes=notes)
    reason = _explain(found, notes[0] if found.motions > MOST_OPEN_MOTIONS else "")
    reason = f"{reason}; {_remedy(source, target, axis, scaled=scaled)}"
    return Judgement(ok=False, probability=found.probability, reason=reason, notes=notes)


def is_accepted(probability: float) -> bool:
    """Return whether a pose is accepted."""
    return probability >= ACCEPTED


def is_sure(probability: float) -> bool:
    """Return whether a pose is probable enough to end the search."""
    return probability >= SURE


def rank(
    scores: FloatArray, evidence: IndexArray, alignments: Sequence[Alignment], voxel: float
) -> FloatArray:
    """Return the rank value of each pose from its score, agreeing matches and residuals; higher is better."""
    misfits = np.array([misfit(found, voxel) for found in alignments])
    support = np.log1p(np.minimum(evidence, MOST_MATCHES))
    known = len(alignments)
    return (
        np.log(np.maximum(scores[:known], _LEAST_SCORE))
        + 0.75 * support[:known]
        - 3.0 * np.log(misfits + 0.1)
    )


def misfit(found: Alignment, voxel: float) -> float:
    """Return the 9th decile of the residuals, each over the deviation of the points around it."""
    if len(found.residuals) == 0:
        return _NOTHING_PAIRED
    expected = np.hypot(found.deviations, LEAST_NOISE * voxel)
    return float(np.quantile(np.abs(found.residuals) / expected, 0.9))


@dataclass(frozen=True)
class Case:
    """Evidence for one pose: score of the surfaces, agreeing matches, normalized residual, and more."""

    score: float
    support: int
    misfit: float
    evidence: Evidence

    @property
    def support_nats(self) -> float:
        """Logarithm of the number of agreeing matches, which saturates."""
        return float(np.log1p(min(self.support, MOST_MATCHES)))

    @property
    def shape_nats(self) -> float:
        """Logarithm of the number of cells off all planes in which the surfaces agree."""
        return float(np.log1p(self.evidence.cells))

    @property
    def misfit_nats(self) -> float:
        """Logarithm of the misfit; residuals below the noise count as noise."""
        return float(np.log(max(self.misfit, 1.0)))

    @property
    def crossed_nats(self) -> float:
        """Logarithm of the fraction in free space; 0 without any, or without viewpoints."""
        return float(np.log1p(np.nan_to_num(self.evidence.crossed) / CROSSED_BY_CHANCE))

    @property
    def further_planes(self) -> int:
        """Number of agreeing planes beyond those of any refined pose."""
        return int(np.clip(self.evidence.planes - PLANES_BY_CHANCE, 0, MOST_FURTHER_PLANES))

    @property
    def score_nats(self) -> float:
        """Logarithm of the score."""
        return float(np.log(max(self.score, _LEAST_SCORE)))


def weigh(case: Case) -> float:
    """Return the evidence for a pose in nats, for comparison with other poses of the same scans."""
    return (
        4.0 * case.score_nats
        + 0.5 * case.support_nats
        + 0.8 * case.shape_nats
        + 0.6 * case.further_planes
        - 1.5 * case.misfit_nats
        - 1.5 * case.crossed_nats
    )


def lead_over_chance(case: Case) -> float:
    """Return the lead of a pose in nats over random poses of unrelated scans."""
    could_be_refuted = not np.isnan(case.evidence.crossed)
    return (
        2.0 * case.score_nats
        + 2.1 * case.shape_nats
        + 3.0 * case.further_planes
        - 2.8 * case.misfit_nats
        - 5.0 * case.crossed_nats
        + 2.8 * could_be_refuted
    )


def share_probability(best: Case, rivals: Sequence[Case], scales: int = 1) -> tuple[float, FloatArray]:
    """Divide the probability among the best pose, its rivals, and "none of these".

    The best of equal poses leads by chance, so a rival has a full share until the lead exceeds
    `LEAD_BY_CHANCE`. "None of these" counts once per tried scale, as more freedom fits more by chance.

    Return the probability that the best pose is correct, and that of each rival as a multiple of it.
    """
    leads = np.array([weigh(best) - weigh(rival) for rival in rivals])
    shares = np.exp(np.clip(LEAD_BY_CHANCE - leads, -_MOST_NATS, LEAD_BY_CHANCE))
    none = scales * float(np.exp(np.clip(-lead_over_chance(best), -_MOST_NATS, _MOST_NATS)))
    return float(1.0 / (1.0 + none + shares.sum())), shares


def are_alternatives(probability: float, shares: FloatArray) -> BoolArray:
    """Return the mask of rivals with at least 30 % of the best pose's probability.

    It is empty if all of them together are not accepted.
    """
    return (shares >= AS_GOOD) & is_accepted(probability * (1.0 + float(shares.sum())))


def bound_by_size(probability: float, *scans: PreparedScan) -> float:
    """Reduce the probability for clouds of few voxels, which fit unrelated clouds by chance."""
    return probability * min(1.0, min(len(scan) for scan in scans) / LEAST_VOXELS)


def bound_by_motions(probability: float, motions: int) -> float:
    """Bound the probability of a pose with open motions, along which other poses are as good."""
    return probability if motions <= MOST_OPEN_MOTIONS else min(probability, 1.0 / (1 + motions))


def differ(poses: FloatArray, best: int, center: FloatArray, voxel: float) -> BoolArray:
    """Return the mask of poses that differ from one, as in `Verification.margin`: 10 degrees or 8 voxels."""
    rotations = poses[:, :3, :3]
    cosines = (np.einsum("nij,ij->n", rotations, rotations[best]) - 1) / 2
    centers = rotations @ center + poses[:, :3, 3]
    apart = np.linalg.norm(centers - centers[best], axis=1)
    return (cosines < np.cos(np.radians(DIFFERENT_DEGREES))) | (apart > DIFFERENT_UNITS * UNIT * voxel)


def choose_apart(poses: FloatArray, center: FloatArray, voxel: float) -> list[int]:
    """Return the rows of the poses that differ from all chosen before them."""
    chosen: list[int] = []
    left = np.ones(len(poses), dtype=bool)
    while left.any():
        chosen.append(int(np.argmax(left)))
        left &= differ(poses, chosen[-1], center, voxel)
    return chosen


def _explain(found: Found, open_motions: str) -> str:
    if open_motions:
        return open_motions
    if found.better_scale != 1.0:
        return _say_scale(found)
    if len(found.alternatives):
        count = 1 + len(found.alternatives)
        return (
            f"several places look the same: {count} poses share the probability, and the best has "
            f"{found.probability:.2f}"
        )
    total = len(found.matches)
    matched = f", and {found.grouping.size} of {total} matches agree" if total else ""
    return (
        f"the best pose is right with a probability of only {found.probability:.2f}: "
        f"{100 * found.fitness:.0f} % of the source overlaps the target{matched}"
    )


def _say_scale(found: Found) -> str:
    return (
        f"the surfaces fit better with the source scaled by {found.better_scale:.3f}: the shapes may differ "
        "in size; let `register` estimate `scale`"
    )


def _count_strays(scan: PreparedScan) -> str:
    strays = scan.scan.strays
    counted = "one point" if strays == 1 else f"{strays} single points"
    return f"{scan.scan.name}: {counted} far from all others set aside"


def _repeats(scan: PreparedScan) -> bool:
    return scan.scan.repeats > MOST_REPEATS * len(scan.scan.given)


def _count_repeats(scan: PreparedScan) -> str:
    one = scan.scan
    return f"{one.name}: {one.repeats} of {len(one.given)} points repeat others and were set aside"


def _find_rounded(*scans: PreparedScan) -> list[str]:
    """Return notes on coordinates with lost digits."""
    return [
        f"{scan.scan.name}: coordinates of single precision lie {scan.scan.rounding:.2g} apart so far from "
        "the origin, too much for its points: give float64, or subtract an offset before they are rounded"
        for scan in scans
        if scan.scan.rounding
    ]


def _find_layers(*scans: PreparedScan) -> list[str]:
    """Return notes on viewpoints from which points occlude each other."""
    layered: list[str] = []
    for scan in scans:
        if not scan.shows_layers:
            continue
        name, seen = scan.scan.name, "points lie behind each other"
        if scan.scan.is_far(scan.viewpoint):
            remedy = "give another `view_direction`, or none for a cloud fused from several scans"
            layered.append(f"seen along the view direction of {name}, {seen}: {remedy}")
        else:
            place = f"{name}_viewpoint" if name in {"source", "target"} else f"the viewpoint of {name}"
            remedy = "give the scanner's position, its `view_direction`, or neither"
            layered.append(f"seen from {place}, {seen}: {remedy} for a cloud fused from several scans")
    return layered


def _remedy(source: PreparedScan, target: PreparedScan, axis: FloatArray | None, *, scaled: bool) -> str:
    """Return the likely cause of a failure, and an argument that may help."""
    rounded = _find_rounded(source, target)
    if rounded:
        return rounded[0]
    sizes = source.scan.diagonal, target.scan.diagonal
    if not scaled and max(sizes) > _SIZES_DIFFER * min(sizes):
        return (
            f"the clouds are {sizes[0]:.3g} and {sizes[1]:.3g} across: if both show the same, scale one, or "
            "let `register` estimate `scale`"
        )
    layered = _find_layers(source, target)
    if layered:
        return layered[0]
    unseen = [role for role, scan in (("source", source), ("target", target)) if scan.viewpoint is None]
    causes = "the clouds may share too little"
    causes += "" if axis is None else ", or not the axis"
    causes += "" if len(unseen) == 2 else ", or a viewpoint may be wrong"
    if len(unseen) == 2:
        return (
            f"{causes}; if each is a single scan, give the scanner's position by `viewpoint`, or its "
            "direction by `view_direction`"
        )
    if unseen:
        return f"{causes}; if the {unseen[0]} is a single scan, give `{unseen[0]}_viewpoint` too"
    return (
        causes if axis is not None else f"{causes}; if both share a direction such as gravity's, give `axis`"
    )


def _notes(found: Found) -> list[str]:
    notes: list[str] = []
    if found.motions > MOST_OPEN_MOTIONS:
        notes.append(
            f"the surfaces leave the source free to move in {found.motions} of six ways, as a plane, a ball "
            "or a pipe does: give clouds that show more of the surroundings"
        )
    if found.refined.open_motion is not None:
        points = apply(found.refined.T_target_source, found.source.voxels.points)
        how = say_motion(found.refined.open_motion, points)
        notes.append(f"the source is free to {how}: the surfaces hardly resist that")
    if found.better_scale != 1.0:
        notes.append(_say_scale(found))
    others = len(found.alternatives)
    if others:
        shared = "1 other pose shares" if others == 1 else f"{others} other poses share"
        notes.append(f"{shared} the probability: the shape may be symmetric, or repeat")
    return notes
