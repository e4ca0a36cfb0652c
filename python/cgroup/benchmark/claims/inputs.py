"""How many of the initial matches are correct: end of section 4.3."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.benchmark.claims.base import Claim, Comparison, Finding
from cgroup.benchmark.claims.measures import at, named_levels, over, under

if TYPE_CHECKING:
    from cgroup.benchmark.claims.base import Records


def _many_inliers_at_low_noise(records: Records) -> Finding:
    sample = records.need("noise", "B3R")
    ratios = named_levels(sample.matches("inlier_ratio").to_frame("ratio"), [0.05])["ratio"]
    return Finding([over("mean inlier ratio at noise of 0.05 pr", float(ratios.iloc[0]), 0.5)])


def _few_inliers_in_scenes(records: Records) -> Finding:
    tests: list[Comparison] = []
    for experiment in ("clutter", "occlusion"):
        sample = records.need(experiment, "U3OR")
        ratios = sample.matches("inlier_ratio")
        tests.extend(under(at(sample, level), ratio, 0.03) for level, ratio in ratios.items())
    return Finding(tests, "most")


CLAIMS = (
    Claim(
        "C-01",
        "4.3, inputs",
        "On B3R with the least noise, more than half of the initial matches are correct.",
        "Mean inlier ratio > 0.5 at noise of 0.05 pr.",
        _many_inliers_at_low_noise,
    ),
    Claim(
        "C-02",
        "4.3, inputs",
        "On U3OR, less than 3 % of the initial matches are correct at most levels of clutter and occlusion.",
        "Mean inlier ratio < 0.03 at more than half of the levels of both.",
        _few_inliers_in_scenes,
    ),
)
