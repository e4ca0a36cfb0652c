"""The third stage: groups judged against the true pose, at any threshold."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.records.packing import floats_from_bytes, unpack, unpack_mask
from cgroup.benchmark.records.types import ScoreRecord
from cgroup.evaluation import match_errors, rotation_error, score_group, translation_error
from cgroup.evaluation.protocols import PROTOCOLS
from cgroup.rigid import apply

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cgroup.types import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Truth:
    """What the groups of one case are judged against.

    Attributes
    ----------
    case_key : str
        Which case.
    pose : (4,4) array of float64
        True pose.
    errors : (n,) array of float64
        Distance of each match from its true place, in pr.
    sample : (m,3) array of float64
        Source points in the overlap.
    pr : float
        Resolution.
    protocols : tuple of str
        Criteria of registration to judge by.
    """

    case_key: str
    pose: FloatArray
    errors: FloatArray
    sample: FloatArray
    pr: float
    protocols: tuple[str, ...]

    @classmethod
    def unpack(
        cls, case_key: str, content: bytes, truth: bytes, sample: bytes, protocols: tuple[str, ...]
    ) -> Truth:
        """Unpack what the first stage recorded."""
        matches, pose = unpack(content), floats_from_bytes(truth, (4, 4))
        pr = matches.resolution
        assert pr is not None  # noqa: S101 - the first stage has checked it
        errors = match_errors(matches.source, matches.target, pose) / pr
        return cls(case_key, pose, errors, floats_from_bytes(sample, (-1, 3)), pr, protocols)


def score_grouping(
    truth: Truth, method_key: str, mask: bytes, pose: bytes | None, epsilons: Sequence[float]
) -> list[ScoreRecord]:
    """Judge one group at several thresholds.

    Parameters
    ----------
    truth : Truth
        Of the case.
    method_key : str
        Which method made the group.
    mask, pose : bytes
        As the second stage recorded them.
    epsilons : sequence of float
        Thresholds in pr.

    Returns
    -------
    list of ScoreRecord
        One per threshold.
    """
    group = unpack_mask(mask, len(truth.errors))
    errors = _measure_pose(truth, None if pose is None else floats_from_bytes(pose, (4, 4)))
    return [_judge(truth, method_key, group, errors, epsilon) for epsilon in epsilons]


def _judge(
    truth: Truth,
    method_key: str,
    group: BoolArray,
    errors: tuple[float, float, float] | None,
    epsilon: float,
) -> ScoreRecord:
    score = score_group(group, truth.errors <= epsilon)
    # A group that fixes no pose is as far off as can be.
    rotation, translation, rmse = (np.inf, np.inf, np.inf) if errors is None else errors
    verdicts = {
        name: PROTOCOLS[name].judge(score.precision, rotation, translation, rmse) for name in truth.protocols
    }
    known = (None, None, None) if errors is None else (rotation, translation, _none_unless_finite(rmse))
    counts = (score.correct, score.selected, score.selected_correct)
    return ScoreRecord(truth.case_key, method_key, epsilon, *counts, *known, json.dumps(verdicts))


def _measure_pose(truth: Truth, pose: FloatArray | None) -> tuple[float, float, float] | None:
    """Rotation in degrees, translation in the data's unit, mean displacement of the overlap in pr."""
    if pose is None:
        return None
    gap = np.linalg.norm(apply(pose, truth.sample) - apply(truth.pose, truth.sample), axis=1)
    rmse = float(gap.mean() / truth.pr) if len(gap) else float("nan")
    return rotation_error(pose, truth.pose), translation_error(pose, truth.pose), rmse


def _none_unless_finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
