"""What a peer answers, and how good the answer is."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from peers.cases import INLIER_RESIDUAL, Array, Case

if TYPE_CHECKING:
    from numpy.typing import NDArray

Mask: TypeAlias = "NDArray[np.bool_]"
Answer: TypeAlias = "tuple[Mask | None, Array | None]"
"""The selected matches, or None for those within 5 pr of the pose; and the pose (4,4), if there is one."""

Call: TypeAlias = Callable[[], Answer]
Make: TypeAlias = Callable[[Case, int], Call]
"""From a case and a number of threads to the call that is timed."""


def rigid(rotation: Array, translation: Array) -> Array:
    """Put a pose together: (4,4), column vectors."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, np.ravel(translation)
    return pose


def within(case: Case, pose: Array, residual: float = INLIER_RESIDUAL) -> Mask:
    """Tell which matches a pose explains."""
    offsets = case["src"].astype(float) @ pose[:3, :3].T + pose[:3, 3] - case["tgt"]
    return np.einsum("ij,ij->i", offsets, offsets) <= residual**2


def quality(case: Case, answer: Answer) -> dict[str, float]:
    """Precision, recall and F of the selection at 5 pr, and how many were selected."""
    mask, pose = answer
    if mask is None:
        mask = np.zeros(len(case["gt"]), bool) if pose is None else within(case, pose)
    correct = case["gt"] == 1
    hits, selected = int((mask & correct).sum()), int(mask.sum())
    precision, recall = hits / max(1, selected), hits / max(1, int(correct.sum()))
    f = 2 * precision * recall / (precision + recall) if hits else 0.0
    return {
        "selected": selected,
        "precision": round(precision, 4),
        "recall": round(recall, 4),
        "f": round(f, 4),
    }
