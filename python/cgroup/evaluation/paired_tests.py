"""Tests of results on the same pairs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from math import comb
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cgroup.evaluation.recall_protocols import Recall
from cgroup.evaluation.result_files import Key, PairErrors
from cgroup.types import BoolArray


def compare_results(found: Mapping[str, PairErrors], recall: Recall) -> list[dict[str, Any]]:
    """Test every two results of the same pairs, in any order: pairs registered by one only, and p by Holm.

    Pairs without numbers are identified by their order in the scene.
    """
    keys: dict[str, list[Key]] = {}
    registered: dict[str, BoolArray] = {}
    for name, one in found.items():
        rows = sorted(np.flatnonzero(recall.counted(one)).tolist(), key=one.keys.__getitem__)
        keys[name], registered[name] = [one.keys[row] for row in rows], recall.registered(one)[rows]
    tests: list[dict[str, Any]] = []
    for one, other in combinations(found, 2):
        if keys[one] == keys[other]:
            first, second = registered[one], registered[other]
            only = {"only_one": int((first & ~second).sum()), "only_other": int((second & ~first).sum())}
            tests.append({"one": one, "other": other, **only, "p": mcnemar(first, second)})
    for test, p in zip(tests, holm([test["p"] for test in tests]), strict=True):
        test["p"] = p
    return tests


def mcnemar(one: ArrayLike, other: ArrayLike) -> float:
    """Return the p of McNemar's exact test on paired successes."""
    first, second = np.asarray(one, dtype=bool), np.asarray(other, dtype=bool)
    only_first, only_second = int((first & ~second).sum()), int((second & ~first).sum())
    count = only_first + only_second
    tail = sum(comb(count, k) for k in range(min(only_first, only_second) + 1))
    return min(1.0, 2 * tail / 2**count)


def holm(p: Sequence[float]) -> list[float]:
    """Adjust the p of several tests for the family-wise error (Holm, Scand. J. Statistics 1979)."""
    adjusted = [0.0] * len(p)
    so_far = 0.0
    for rank, i in enumerate(sorted(range(len(p)), key=lambda i: p[i])):
        so_far = max(so_far, min(1.0, (len(p) - rank) * p[i]))
        adjusted[i] = so_far
    return adjusted
