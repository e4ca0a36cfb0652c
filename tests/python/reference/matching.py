"""Nearest descriptors by a full table of distances."""

import numpy as np

from .neighborhood import FloatArray


def match(
    source: FloatArray,
    target: FloatArray,
    *,
    k: int = 1,
    mutual: bool = False,
    max_distance: float | None = None,
) -> list[tuple[int, int, int, float, float, float, float, bool]]:
    """Rows (source, target, rank, distance, second distance, similarity, ratio, is mutual)."""
    valid_source = np.flatnonzero(np.isfinite(source).all(axis=1))
    valid_target = np.flatnonzero(np.isfinite(target).all(axis=1))
    if len(valid_target) == 0:
        return []
    table = np.linalg.norm(source[valid_source][:, None] - target[valid_target], axis=2)
    result = []
    for i, distances in enumerate(table):
        order = np.argsort(distances, kind="stable")
        second = distances[order[1]] if len(order) > 1 else np.inf
        for place, j in enumerate(order[:k]):
            distance = distances[j]
            is_mutual = np.argmin(table[:, j]) == i
            if (mutual and not is_mutual) or (max_distance is not None and distance > max_distance):
                continue
            row, other = valid_source[i], valid_target[j]
            ratio = 1.0 if not np.isfinite(second) or second**2 <= 1e-7 else min(distance / second, 1.0)
            score = similarity(source[row], target[other])
            result.append((row, other, place + 1, distance, second, score, ratio, is_mutual))
    return result


def similarity(f: FloatArray, g: FloatArray) -> float:
    """1 - |f_norm - g_norm|, -inf for a zero vector."""
    if not f.any() or not g.any():
        return -np.inf
    return float(1 - np.linalg.norm(f / np.linalg.norm(f) - g / np.linalg.norm(g)))
