"""Judge poses: which one is best, how likely it is right, whether it can be trusted, and why not.

The coefficients were fitted on half of 1,200 pairs of real scans, right, unrelated and mirrored ones (see
`docs/registration.md`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cgroup.registration.prepare import UNIT
from cgroup.rigid import apply
from cgroup.types import Agreement, Grouping, Rule
from cgroup.verification.schedule import DIFFERENT_DEGREES, DIFFERENT_UNITS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cgroup.registration.prepare import PreparedScan
    from cgroup.types import BoolArray, Correspondences, FloatArray, IndexArray
    from cgroup.verification import Alignment

ACCEPTED = 0.5
"""Probability from which a pose is held to be right."""

SURE = 0.9
"""Probability from which no better pose is sought."""

GROUP_WITHIN = 2.0
"""Residual in voxels within which a match belongs to the verified group."""

MOST_OPEN_MOTIONS = 1
"""Motions that may be open: along a corridor a pose is still of use."""

MOST_MATCHES = 20
"""Matches beyond which more of them tell nothing."""

LEAST_NOISE = 0.02
"""What a surface's points are from its planes at the least, in voxels."""

MOST_LEAD = 3.0

_LEAST_SCORE = 1e-3
_NOTHING_PAIRED = 100.0
_AS_GOOD = 0.7
_SIZES_DIFFER = 1.5
_OPEN = 0.01  # share of the resistance of all pairs, as for `Alignment.open_motion`


@dataclass(frozen=True, eq=False)
class Found:
    """The best pose of a search, and the evidence for it.

    Attributes
    ----------
    refined : Alignment
        The best one, refined on the fine surfaces.
    poses : (k,4,4) array of float64
        The finalists, refined too, best first.
    values : (k,) array of float64
        What they are ranked by.
    probability : float
        That it is right.
    fitness : float
        Share of the source's surface that lies on the target's.
    matches : Correspondences
        Every match of the search.
    source, target : PreparedScan
        The scans, at the voxel where it was found.
    is_object : bool
        Whether the source is a model: one that can turn on itself, such as a ball, is still found.
    """

    refined: Alignment
    poses: FloatArray
    values: FloatArray
    probability: float
    fitness: float
    matches: Correspondences
    source: PreparedScan
    target: PreparedScan
    is_object: bool = False

    @cached_property
    def alternatives(self) -> FloatArray:
        """Other poses that score almost as well."""
        return self.poses[1:][self.values[1:] >= self.values[0] - _AS_GOOD]

    @cached_property
    def grouping(self) -> Grouping:
        """The matches that the pose lays together."""
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
    """Whether a pose can be trusted, how likely it is right, why not, and what a user should know of it."""

    ok: bool
    probability: float
    reason: str
    notes: tuple[str, ...]


def judge(
    found: Found | None, source: PreparedScan, target: PreparedScan, axis: FloatArray | None = None
) -> Judgement:
    """Judge what a search in two scans has found, if anything."""
    if found is None:
        reason = "no pose could be proposed" + ("" if axis is None else " that keeps the axis")
        return Judgement(
            ok=False, probability=0.0, reason=_with_remedy(reason, source, target, axis), notes=()
        )
    points = apply(found.refined.T_target_source, found.source.voxels.points)
    motions = count_open_motions(found.refined.information, points)
    notes = tuple(_notes(found.refined.open_motion, motions, len(found.alternatives)))
    reason = ""
    if not is_accepted(found.probability):
        reason = (
            f"the best pose is right with a probability of {found.probability:.2f} only: it lays "
            f"{100 * found.fitness:.0f} % of the source on the target and {found.grouping.size} of "
            f"{len(found.matches)} matches together"
        )
        reason = _with_remedy(reason, source, target, axis)
    elif motions > MOST_OPEN_MOTIONS and not found.is_object:
        reason = notes[0]
    return Judgement(not reason, found.probability, reason, notes)


def is_accepted(probability: float) -> bool:
    """Whether a pose is held to be right."""
    return probability >= ACCEPTED


def is_sure(probability: float) -> bool:
    """Whether a pose is so likely right that no better one is sought."""
    return probability >= SURE


def rank(
    scores: FloatArray, evidence: IndexArray, alignments: Sequence[Alignment], voxel: float
) -> FloatArray:
    """Value of each pose, the best has the highest: ``ln s + 0.75 ln(1 + min(m, 20)) - 3 ln(c + 0.1)``.

    s is the score of the surfaces, m the number of matches that the pose lays together, and c the 9th
    decile of the distances between the fine surfaces over what noise and curvature explain (`misfit`).
    """
    misfits = np.array([misfit(found, voxel) for found in alignments])
    support = np.log1p(np.minimum(evidence, MOST_MATCHES))
    return np.log(np.maximum(scores, _LEAST_SCORE)) + 0.75 * support - 3.0 * np.log(misfits + 0.1)


def misfit(found: Alignment, voxel: float) -> float:
    """9th decile of the distances between two surfaces, each over the deviation of the points around it."""
    if len(found.residuals) == 0:
        return _NOTHING_PAIRED
    expected = np.hypot(found.deviations, LEAST_NOISE * voxel)
    return float(np.quantile(np.abs(found.residuals) / expected, 0.9))


def probability(values: FloatArray, poses: FloatArray, center: FloatArray, voxel: float) -> float:
    """Probability that the pose of the highest value is right: a logistic model of the value and its lead."""
    best = int(np.argmax(values))
    rivals = values[differ(poses, best, center, voxel)]
    lead = min(float(values[best] - rivals.max()), MOST_LEAD) if len(rivals) else MOST_LEAD
    return float(1.0 / (1.0 + np.exp(2.2 - 1.2 * values[best] - 2.3 * lead)))


def differ(poses: FloatArray, best: int, center: FloatArray, voxel: float) -> BoolArray:
    """Tell the poses that differ from one, as in `Verification.margin`: by 10 degrees, or 8 voxels."""
    rotations = poses[:, :3, :3]
    cosines = (np.einsum("nij,ij->n", rotations, rotations[best]) - 1) / 2
    centers = rotations @ center + poses[:, :3, 3]
    apart = np.linalg.norm(centers - centers[best], axis=1)
    return (cosines < np.cos(np.radians(DIFFERENT_DEGREES))) | (apart > DIFFERENT_UNITS * UNIT * voxel)


def count_open_motions(information: FloatArray, points: FloatArray) -> int:
    """Count the motions that surfaces hardly resist.

    Parameters
    ----------
    information : (6,6) array of float64
        ``sum w J^T J`` for a rotation vector about the origin and a translation.
    points : (N,3) array of float64
        Of the surfaces, in the same frame.

    Returns
    -------
    int
        Eigenvalues below 0.01 of the sum of weights, with rotations about the median of the points and scaled
        by their median distance from it: 3 for a plane or a ball, 2 for a pipe, 1 for a corridor.
    """
    center = np.median(points, axis=0)  # a few stray points don't move it
    radius = np.median(np.linalg.norm(points - center, axis=1))
    x, y, z = center
    change = np.eye(6)
    change[3:, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    change[:, :3] /= radius
    weight = np.trace(information[3:, 3:])  # normals are of unit length
    return int((np.linalg.eigvalsh(change.T @ information @ change) <= _OPEN * weight).sum())


def _with_remedy(reason: str, source: PreparedScan, target: PreparedScan, axis: FloatArray | None) -> str:
    """Say what may help."""
    return f"{reason}; {_remedy(source, target, axis)}"


def _remedy(source: PreparedScan, target: PreparedScan, axis: FloatArray | None) -> str:
    sizes = source.scan.cloud.diagonal, target.scan.cloud.diagonal
    if max(sizes) > _SIZES_DIFFER * min(sizes):
        return (
            f"the clouds are {sizes[0]:.3g} and {sizes[1]:.3g} across: if both show the same, scale one, as "
            "scale is not estimated"
        )
    if axis is not None:
        return "the clouds may share too little, or not the axis"
    if source.viewpoint is None or target.viewpoint is None:
        return (
            "the clouds may share too little; if each is a single scan, say where the scanner stood by "
            "`source_viewpoint` and `target_viewpoint`"
        )
    return "the clouds may share too little, or a viewpoint may be wrong; `effort='high'` may find a pose"


def _notes(open_motion: FloatArray | None, motions: int, alternatives: int) -> list[str]:
    notes: list[str] = []
    if motions > MOST_OPEN_MOTIONS:
        notes.append(
            f"the surfaces leave {motions} of the six motions open, as a plane, a ball or a pipe does: give "
            "clouds that show more of the surroundings"
        )
    if open_motion is not None:
        turn, shift = open_motion[:3], open_motion[3:]
        notes.append(
            "the surfaces hardly resist a motion: rotation vector "
            f"({', '.join(f'{x:.3g}' for x in turn)}), translation ({', '.join(f'{x:.3g}' for x in shift)})"
        )
    if alternatives:
        notes.append(
            f"{alternatives} other pose{'s' if alternatives > 1 else ''} lay the surfaces together almost as "
            "well: the shape may be symmetric"
        )
    return notes
