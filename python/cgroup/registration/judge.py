"""Accept or reject poses with reasons, and word notes for the user."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from cgroup import _core
from cgroup._runtime.workers import cached_property
from cgroup._show.words import say_direction
from cgroup.fronts.scan import Scan
from cgroup.registration.prepare import LEAST_VOXELS, PreparedScan
from cgroup.rigid import apply
from cgroup.rigid.locks import Locks
from cgroup.types import Agreement, BoolArray, Correspondences, FloatArray, Grouping, Rule

ACCEPTED = 0.5  # probability from which a pose is accepted
ACCEPTED_WITH_RIVALS = 0.7  # the same if there are alternatives, of which the evidence can prefer a wrong one
GROUP_WITHIN = 2.0  # residual in voxels within which a match belongs to the verified group
MOST_OPEN_MOTIONS = 1  # largest number of open motions: along a corridor a pose is still useful
MOVED_BY_REFINING = 0.4  # displacement by refining, in voxels, at which half of a pose's probability is left
MOST_REPEATS = 0.01  # share of repeated points from which a note is added
AS_GOOD = 0.3  # share of the best pose's probability from which another one counts as an alternative
_SIZES_DIFFER = 1.5
_SLIGHT = 0.1  # part of a motion that is left out of its description, beside the other part

Case: TypeAlias = "tuple[float, int, float, float, int, float, float]"
"""Evidence: score, agreeing matches, misfit, cells, planes, share in free space (or NaN), chance (or NaN)."""


@dataclass(frozen=True, eq=False)
class Found:
    """The best pose of a search, and the evidence for it."""

    pose: FloatArray  # (4,4), refined on the fine surfaces
    probability: float  # that it is right
    alternatives: FloatArray  # (k,4,4), other poses that share the probability
    fitness: float  # share of the source's surface that overlaps the target's
    target_fitness: float  # share of the target's surface that overlaps the source's
    rmse: float  # root mean square of the residuals
    open_motion: FloatArray | None  # (6,), the motion that the surfaces hardly resist
    matches: Correspondences  # every match of the search
    points: FloatArray  # (M,3), voxels of the source
    voxel: float  # of the search
    covariance: Callable[[], FloatArray]  # computes the covariance, (6,6)
    overlap: Callable[[FloatArray], list[tuple[float, ...]]]  # of poses (k,4,4): fitness of both, rmse
    motions: int = 0  # number of open motions
    cases: Sequence[Case] = ()  # evidence for the pose, and for its rivals
    shares: FloatArray = field(default_factory=lambda: np.empty(0))  # probability of rivals, as a multiple
    places: FloatArray = field(default_factory=lambda: np.empty((0, 4, 4)))  # (c,4,4), poses of the cases
    better_scale: float = 1.0  # scale of the source that fits clearly better than 1, or 1
    scale_factor: float = 1.0  # factor of the probability by that scale
    decoy: float | None = None  # probability of the best pose of the mirrored source
    seconds: dict[str, float] = field(default_factory=dict)  # wall time of the stages

    @property
    def is_accepted(self) -> bool:
        """Whether the pose is accepted, by its probability and its alternatives."""
        return is_accepted(self.probability, has_rivals=len(self.alternatives) > 0)

    @cached_property
    def grouping(self) -> Grouping:
        """The matches that agree with the pose."""
        matches, within = self.matches, GROUP_WITHIN * self.voxel
        moved = matches.source @ self.pose[:3, :3].T + self.pose[:3, 3]
        residuals = np.linalg.norm(moved - matches.target, axis=1)
        positions = (matches.source, matches.target)
        rule = Rule(
            "register",
            "residual",
            within,
            accepts_equality=True,
            agreement=Agreement(2.0 * within),
            resolution=matches.resolution,
        )
        return Grouping(residuals <= within, None, None, self.pose, {}, rule=rule, _positions=positions)


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
    notes = tuple(_notes(found, source.scan, target.scan))
    if found.is_accepted:
        notes += (*_find_rounded(source, target), *_find_layers(source, target))
        return Judgement(ok=True, probability=found.probability, reason="", notes=notes)
    reason = _explain(found, notes[0] if found.motions > MOST_OPEN_MOTIONS else "")
    reason = f"{reason}; {_remedy(source, target, axis, scaled=scaled)}"
    return Judgement(ok=False, probability=found.probability, reason=reason, notes=notes)


def is_accepted(probability: float, *, has_rivals: bool = False) -> bool:
    """Return whether a pose is accepted; more is needed if other poses share the probability."""
    return probability >= (ACCEPTED_WITH_RIVALS if has_rivals else ACCEPTED)


def lock(found: Found, judgement: Judgement, locks: Locks) -> tuple[Found, Judgement]:
    """Return the likeliest pose with locked values; its probability falls as the source moves."""
    pose, covariance = locks.condition(found.pose, found.covariance())
    moved = apply(pose, found.points) - apply(found.pose, found.points)
    voxels = float(np.sqrt((moved**2).sum(axis=1).mean())) / found.voxel
    chance = found.probability * share_left(voxels)
    reason = judgement.reason
    locked = replace(found, pose=pose, probability=chance, covariance=lambda: covariance)
    if judgement.ok and not locked.is_accepted:
        degrees = float(np.degrees(np.linalg.norm(locks.excess(found.pose)[:3])))
        reason = f"the best pose is {voxels:.2g} voxels and {degrees:.2g} degrees off the locked axes"
        reason += "; leave out `free`, or correct the frames"
    return locked, replace(judgement, ok=locked.is_accepted, probability=chance, reason=reason)


def share_probability(cases: Sequence[Case], scales: int = 1) -> tuple[float, FloatArray]:
    """Return the probability of the first pose, and that of each other as a multiple of it."""
    chance, shares = _core.share_probability(list(cases), scales)
    return chance, np.array(shares)


def are_alternatives(probability: float, shares: FloatArray) -> BoolArray:
    """Return the mask of rivals with at least 30 % of the best pose's probability.

    It is empty if the best pose would not be accepted without rivals.
    """
    return (shares >= AS_GOOD) & is_accepted(probability / (1.0 - probability * float(shares.sum())))


def share_left(moved: float) -> float:
    """Return the share of a given pose's probability that is left if refining moves it by some voxels."""
    return 0.5 ** min(moved / MOVED_BY_REFINING, 1e9) ** 4


def bound_by_size(probability: float, *scans: PreparedScan) -> float:
    """Reduce the probability for clouds of few voxels, which fit unrelated clouds by chance."""
    return probability * min(1.0, min(len(scan) for scan in scans) / LEAST_VOXELS)


def bound_by_motions(probability: float, motions: int) -> float:
    """Bound the probability of a pose with open motions, along which other poses are as good."""
    return probability if motions <= MOST_OPEN_MOTIONS else min(probability, 1.0 / (1 + motions))


def choose_apart(poses: FloatArray, center: FloatArray, voxel: float) -> list[int]:
    """Return the rows of the poses that differ from all chosen before them: by 10 degrees or 8 voxels."""
    return _core.choose_apart(np.ascontiguousarray(poses), center.tolist(), voxel)


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


def _notes(found: Found, *scans: Scan) -> list[str]:
    notes: list[str] = []
    if found.motions > MOST_OPEN_MOTIONS:
        notes.append(
            f"the surfaces leave the source free to move in {found.motions} of six ways, as a plane, a ball "
            "or a pipe does: give clouds that show more of the surroundings"
        )
    if found.open_motion is not None:
        how = say_motion(found.open_motion, apply(found.pose, found.points))
        notes.append(f"the source is free to {how}: the surfaces hardly resist that")
    if found.better_scale != 1.0:
        notes.append(_say_scale(found))
    others = len(found.alternatives)
    if others:
        shared = "1 other pose shares" if others == 1 else f"{others} other poses share"
        notes.append(f"{shared} the probability: the shape may be symmetric, or repeat")
    for scan in scans:
        if scan.outliers:
            counted = "one point" if scan.outliers == 1 else f"{scan.outliers} single points"
            notes.append(f"{scan.name}: {counted} far from all others set aside")
    for scan in scans:
        if scan.repeats > MOST_REPEATS * len(scan.given):
            points = f"{scan.repeats} of {len(scan.given)} points"
            notes.append(f"{scan.name}: {points} repeat others and were set aside")
    return notes


def say_motion(vector: FloatArray, points: FloatArray) -> str:
    """Describe a motion (rotation vector, translation of the origin) of some points in words."""
    middle, radius = _middle(points)
    turn, shift = vector[:3], vector[3:] + np.cross(vector[:3], middle)
    angle, length = np.linalg.norm(turn), np.linalg.norm(shift)
    if angle * radius < _SLIGHT * length:
        return f"slide along {say_direction(_upwards(shift))}"
    words = f"turn about an axis along {say_direction(_upwards(turn))}"
    is_screw = abs(shift @ turn) > _SLIGHT * angle**2 * radius
    return f"{words} while sliding along it" if is_screw else words


def _upwards(vector: FloatArray) -> FloatArray:
    """Return a vector or its opposite, such that the largest coordinate is positive."""
    return vector * np.sign(vector[np.argmax(np.abs(vector))])


def _middle(points: FloatArray) -> tuple[FloatArray, float]:
    """Return the median of the points and the median distance from it, both robust to outliers."""
    middle = np.median(points, axis=0)
    return middle, float(np.median(np.linalg.norm(points - middle, axis=1)))
