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

    from cgroup.types import BoolArray, FloatArray, RealArray


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
    errors = None
    if pose is not None:
        errors = measure_pose(floats_from_bytes(pose, (4, 4)), truth.pose, truth.sample, truth.pr)
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
    known = (None, None, None) if errors is None else (rotation, translation, none_unless_finite(rmse))
    counts = (score.correct, score.selected, score.selected_correct)
    return ScoreRecord(truth.case_key, method_key, epsilon, *counts, *known, json.dumps(verdicts))


def measure_pose(
    pose: FloatArray, truth: FloatArray, sample: RealArray, pr: float
) -> tuple[float, float, float]:
    """Measure the errors of a pose.

    Parameters
    ----------
    pose, truth : (4,4) array of float64
        Estimated and true pose.
    sample : (m,3) array of float
        Source points in the overlap.
    pr : float
        Resolution.

    Returns
    -------
    rotation, translation, displacement : float
        In degrees, in the data's unit, and the mean over the sample in pr; the last is NaN without a sample.
    """
    gap = np.linalg.norm(apply(pose, sample) - apply(truth, sample), axis=1)
    rmse = float(gap.mean() / pr) if len(gap) else float("nan")
    return rotation_error(pose, truth), translation_error(pose, truth), rmse


def none_unless_finite(value: float) -> float | None:
    """Turn NaN and infinity into what the records hold for them."""
    return value if np.isfinite(value) else None
