"""Measure which methods depend on the order of the matches."""

from __future__ import annotations

from statistics import median

import numpy as np
import pandas as pd

import cgroup
from cgroup.datasets import make_problem
from cgroup.registry import METHOD_INFO

PROBLEMS = 250
SHARES = (0.5, 0.2, 0.1, 0.05)


def measure_order() -> pd.DataFrame:
    """Count groups that change if the matches are shuffled, and the fraction of matches that differ."""
    rng = np.random.default_rng(0)
    changes: dict[str, list[float]] = {name: [] for name in METHOD_INFO}
    for i in range(PROBLEMS):
        problem = make_problem(rng, int(rng.integers(30, 600)), inlier_ratio=SHARES[i % len(SHARES)])
        order = rng.permutation(len(problem.source))
        straight, shuffled = problem.correspondences(), problem.subset(order).correspondences()
        for name, found in changes.items():
            mask = cgroup.group(straight, name).mask[order]
            other = cgroup.group(shuffled, name).mask
            if not np.array_equal(mask, other):
                found.append(float((mask ^ other).sum() / (mask | other).sum()))
    rows = [
        (METHOD_INFO[name].label, str(len(found)), f"{100 * median(found):.0f} %")
        for name, found in sorted(changes.items(), key=lambda item: -len(item[1]))
        if found
    ]
    columns = [
        "method",
        f"different groups, of {PROBLEMS} problems",
        "matches in one group only, if different (median)",
    ]
    return pd.DataFrame(rows, columns=columns)
