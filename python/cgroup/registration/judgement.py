"""Which of the verified poses is right, and how likely: from surfaces, how closely they lie, and matches.

The coefficients were fitted on half of 1,200 pairs of real scans, right, unrelated and mirrored ones (see
`docs/registration.md`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cgroup.types import BoolArray, FloatArray, IndexArray
    from cgroup.verification import Alignment

ACCEPTED = 0.5
"""Probability from which a pose is held to be right."""

SURE = 0.9
"""Probability from which no better pose is sought."""

MOST_MATCHES = 20
"""Matches beyond which more of them tell nothing."""

LEAST_NOISE = 0.02
"""What a surface's points are from its planes at the least, in voxels."""

DIFFERENT_DEGREES, DIFFERENT_VOXELS = 10.0, 8.0
"""Angle, or displacement of the source's centre, beyond which two poses differ."""

MOST_LEAD = 3.0

_LEAST_SCORE = 1e-3
_NOTHING_PAIRED = 100.0


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
    """Which poses differ from one by more than 10 degrees, or 8 voxels at the source's centre."""
    rotations = poses[:, :3, :3]
    cosines = (np.einsum("nij,ij->n", rotations, rotations[best]) - 1) / 2
    centers = rotations @ center + poses[:, :3, 3]
    apart = np.linalg.norm(centers - centers[best], axis=1)
    return (cosines < np.cos(np.radians(DIFFERENT_DEGREES))) | (apart > DIFFERENT_VOXELS * voxel)
