"""Measure how long `register` takes on clouds of many points."""

from __future__ import annotations

import statistics
import time

import numpy as np
import pandas as pd

from cgroup.datasets import standin_pair
from cgroup.evaluation import rotation_error
from cgroup.registration import register

REPEATS = (1, 27, 90)
ROUNDS = 5
SPREAD = 0.3
"""Standard deviation of the repeated points about the scanned ones, in mm: a third of their spacing."""


def measure_clouds() -> pd.DataFrame:
    """Register two scans whose points are repeated with noise; the median of some calls."""
    pair, rng = standin_pair(seed=0), np.random.default_rng(0)
    rows: list[dict[str, str]] = []
    for count in REPEATS:
        clouds = [np.repeat(scan.points, count, axis=0) for scan in (pair.source, pair.target)]
        source, target = (cloud + rng.normal(0, SPREAD, cloud.shape) for cloud in clouds)
        times: list[float] = []
        for _ in range(ROUNDS):
            start = time.perf_counter()
            done = register(source, target, threads=2)
            times.append(time.perf_counter() - start)
        angle = rotation_error(done.T_target_source, pair.T_target_source)
        rows.append(
            {
                "points of both clouds": f"{len(source) + len(target):,}",
                "seconds to the pose": f"{statistics.median(times):.2f}",
                "off by": f"{angle:.2f}°",
                "probability": f"{done.probability:.2f}",
            }
        )
    return pd.DataFrame(rows)
