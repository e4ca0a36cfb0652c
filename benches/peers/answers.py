"""What a peer answers, how good the answer is, and whether it is ours."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from peers.cases import INLIER_RESIDUAL, Array, Case, Mask

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


def within(case: Case, pose: Array) -> Mask:
    """Tell which matches a pose explains."""
    offsets = case["src"].astype(float) @ pose[:3, :3].T + pose[:3, 3] - case["tgt"]
    return np.einsum("ij,ij->i", offsets, offsets) < INLIER_RESIDUAL**2


def selected_by(case: Case, answer: Answer) -> Mask:
    """Return the group that an answer stands for; none without mask and pose."""
    mask, pose = answer
    if mask is not None:
        return mask
    return np.zeros(len(case["gt"]), bool) if pose is None else within(case, pose)


def pack(mask: Mask) -> str:
    """Write a mask in hexadecimal digits, the first row in the highest bit; `pcl_peers.cpp` does the same."""
    return np.packbits(mask).tobytes().hex()


def unpack(digits: str, n: int) -> Mask:
    """Read what `pack` wrote."""
    return np.unpackbits(np.frombuffer(bytes.fromhex(digits), np.uint8), count=n).astype(bool)


def judge(case: Case, mask: Mask, ours: Mask | None) -> dict[str, Any]:
    """Precision, recall and F at 5 pr, and on how many matches the mask differs from ours."""
    from cgroup.evaluation import score_group  # noqa: PLC0415 - the libraries' environment lacks cgroup

    score = score_group(mask, case["gt"] == 1)
    return {
        "selected": score.selected,
        "precision": round(score.precision, 4),
        "recall": round(score.recall, 4),
        "f": round(score.f_score, 4),
        "differs": None if ours is None else int((mask != ours).sum()),
    }
