"""Evaluate a group against the true pose: which matches are correct, and how good the group is.

Knows nothing of the methods that made the group.
"""

from cgroup.evaluation.ground_truth import (
    alignment_error,
    clutter_and_occlusion,
    correct_matches,
    match_errors,
    mean_displacement,
    overlap,
    within,
)
from cgroup.evaluation.metrics import GroupScore, Scores, score_counts, score_group
from cgroup.evaluation.protocols import PROTOCOLS, Protocol
from cgroup.rigid import rotation_error, translation_error

__all__ = [
    "PROTOCOLS",
    "GroupScore",
    "Protocol",
    "Scores",
    "alignment_error",
    "clutter_and_occlusion",
    "correct_matches",
    "match_errors",
    "mean_displacement",
    "overlap",
    "rotation_error",
    "score_counts",
    "score_group",
    "translation_error",
    "within",
]
