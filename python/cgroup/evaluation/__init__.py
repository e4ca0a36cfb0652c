"""Scores of groups, poses of pairs, and poses of many scans against the true poses."""

from cgroup.evaluation.ground_truth import (
    alignment_error,
    clutter_and_occlusion,
    correct_matches,
    match_errors,
    overlap,
)
from cgroup.evaluation.metrics import GroupScore, score_group
from cgroup.evaluation.protocols import PROTOCOLS, Protocol
from cgroup.evaluation.recalls import (
    feature_matching_recall,
    inlier_ratio,
    mean_average_accuracy,
    redwood_error,
    registration_recall,
)
from cgroup.evaluation.scene_scores import SceneScore, ecdf, score_scene
from cgroup.rigid import rotation_error, translation_error

__all__ = [
    "PROTOCOLS", "GroupScore", "Protocol", "SceneScore", "alignment_error", "clutter_and_occlusion",
    "correct_matches", "ecdf", "feature_matching_recall", "inlier_ratio", "match_errors",
    "mean_average_accuracy", "overlap", "redwood_error", "registration_recall", "rotation_error",
    "score_group", "score_scene", "translation_error",
]  # fmt: skip
