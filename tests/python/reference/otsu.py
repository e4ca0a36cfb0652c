"""Otsu's adaptive threshold on continuous scores.

The best cut maximises the between-class variance J = n1 n2 (mean1 - mean2)^2.

Decisions where the paper is open
---------------------------------
* Constant scores (hi - lo <= 1e-9 max(|lo|, |hi|)) are recognised before anything
  else and in all four modes: all selected when lo > 0, none otherwise. There is no
  cut then, so the threshold is None. No scores: empty mask, None.
* In every mode the lower class of candidate k holds the bins <= k, for k = 0..B-2,
  and the first candidate wins unless a later one is better by more than 1e-12
  (relative).
* ``minmax`` and ``legacy`` use `bins`; ``exact`` and ``covis`` ignore it.
* ``covis``: bin = floor(s B) clamped to [0, B-1]. One occupied bin (or B = 1) leaves
  the threshold at 0, so that all positive scores are selected.
* ``legacy``: bin = floor(s / step) clamped to [0, B-1], class means from the scores;
  one occupied bin gives (hi - lo)/2.
* Every mode selects s > threshold.
"""

from typing import Literal

import numpy as np

from .result import BoolArray, FloatArray, IntArray

OtsuMode = Literal["minmax", "exact", "covis", "legacy"]

CONSTANT = 1e-9
STRICTLY_BETTER = 1.0 + 1e-12


def otsu_split(
    scores: FloatArray, mode: OtsuMode = "minmax", bins: int = 100
) -> tuple[BoolArray, float | None]:
    """Split finite `scores` in two: True above the threshold, which is None for constant scores."""
    if len(scores) == 0:
        return np.zeros(0, dtype=bool), None
    lo, hi = float(scores.min()), float(scores.max())
    if hi - lo <= CONSTANT * max(abs(lo), abs(hi)):
        return np.full(len(scores), lo > 0.0), None
    cut = {"minmax": _minmax, "exact": _exact, "covis": _covis, "legacy": _legacy}[mode]
    threshold = cut(scores, bins)
    return scores > threshold, threshold


def select_above(
    scores: FloatArray, threshold: float | Literal["otsu"], mode: OtsuMode
) -> tuple[BoolArray, float | None]:
    """Select scores > threshold, where "otsu" finds the threshold."""
    if threshold == "otsu":
        return otsu_split(scores, mode)
    return scores > threshold, float(threshold)


def _minmax(scores: FloatArray, bins: int) -> float:
    """B bins between the smallest and the largest score."""
    lo, hi = scores.min(), scores.max()
    width = (hi - lo) / bins
    bin_of = np.minimum(bins - 1, np.floor((scores - lo) / width).astype(np.int64))
    best = _best_candidate(bin_of, scores, bins)
    assert best is not None  # the extremes lie in different bins
    lower = bin_of <= best
    return float((scores[lower].max() + scores[~lower].min()) / 2.0)


def _exact(scores: FloatArray, _bins: int) -> float:
    """Every gap between two distinct scores is a candidate."""
    values, bin_of = np.unique(scores, return_inverse=True)
    best = _best_candidate(bin_of, scores, len(values))
    return float((values[best] + values[best + 1]) / 2.0)


def _covis(scores: FloatArray, _bins: int) -> float:
    """About sqrt(n) bins over the fixed range [0, 1]; means of bin indices."""
    bins = int(np.floor(np.sqrt(len(scores)) + 0.5))
    bin_of = np.clip(np.floor(scores * bins), 0, bins - 1).astype(np.int64)
    best = _best_candidate(bin_of, bin_of.astype(np.float64), bins)
    return 0.0 if best is None else best / (bins - 1)


def _legacy(scores: FloatArray, bins: int) -> float:
    """Bins of the right width but counted from zero instead of the minimum."""
    spread = float(scores.max() - scores.min())
    step = spread / bins
    bin_of = np.clip(np.floor(scores / step), 0, bins - 1).astype(np.int64)
    best = _best_candidate(bin_of, scores, bins)
    return spread / 2.0 if best is None else best * step


def _best_candidate(bin_of: IntArray, values: FloatArray, bins: int) -> int | None:
    """First k with the greatest J(k) for the classes {bin <= k} and {bin > k}."""
    best, best_variance = None, 0.0
    for k in range(bins - 1):
        lower = bin_of <= k
        if not lower.any() or lower.all():
            continue
        n1, n2 = int(lower.sum()), int((~lower).sum())
        variance = n1 * n2 * (values[lower].mean() - values[~lower].mean()) ** 2  # J(k)
        if best is None or variance > best_variance * STRICTLY_BETTER:
            best, best_variance = k, variance
    return best
