"""How many of the initial matches are correct: end of section 4.3."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.benchmark.claims.base import Comparison, Finding
from cgroup.benchmark.claims.claim import claim
from cgroup.benchmark.claims.measures import expect_above, expect_below, name_level, need_levels

if TYPE_CHECKING:
    from cgroup.benchmark.claims.base import ClaimEvidence


@claim(
    "C-01",
    section="4.3, inputs",
    statement="On B3R with the least noise, more than half of the initial matches are correct.",
    criterion="Mean inlier ratio > 0.5 at noise of 0.05 pr.",
)
def _check_many_inliers_at_low_noise(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("noise", "B3R")
    ratios = need_levels(sample.matches("inlier_ratio").to_frame("ratio"), [0.05])["ratio"]
    return Finding([expect_above("mean inlier ratio at noise of 0.05 pr", float(ratios.iloc[0]), 0.5)])


@claim(
    "C-02",
    section="4.3, inputs",
    statement=(
        "On U3OR, less than 3 % of the initial matches are correct at most levels of clutter and occlusion."
    ),
    criterion="Mean inlier ratio < 0.03 at more than half of the levels of both.",
)
def _check_few_inliers_in_scenes(evidence: ClaimEvidence) -> Finding:
    tests: list[Comparison] = []
    for experiment in ("clutter", "occlusion"):
        sample = evidence.need(experiment, "U3OR")
        ratios = sample.matches("inlier_ratio")
        tests.extend(expect_below(name_level(sample, level), ratio, 0.03) for level, ratio in ratios.items())
    return Finding(tests, "most")
