"""CV: consistency voting, Yang et al. 2019 (paper 3.1, Eq. 7 to 11).

Decisions where the paper is open
---------------------------------
* Voters are the min(voters, n) smallest ratios, ties by index, whether or not they
  have a frame. A pair with a missing frame on either correspondence adds 0, and so
  does the vote of a frameless voter for itself.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from .otsu import OtsuMode, select_above
from .pairwise import distance_difference
from .result import FloatArray, ReferenceGrouping, as_rows, has_frame, length


def cv(
    source: ArrayLike,
    target: ArrayLike,
    *,
    ratio: ArrayLike,
    source_lrf: ArrayLike,
    target_lrf: ArrayLike,
    resolution: float | None = None,
    distance_scale: float | None = None,
    angle_scale: float = 10.0,
    voters: int = 200,
    exclude_self: bool = False,
    threshold: float | Literal["otsu"] = "otsu",
    otsu: OtsuMode = "minmax",
) -> ReferenceGrouping:
    p, q, lowe = as_rows(source, 3), as_rows(target, 3), as_rows(ratio)
    source_frames, target_frames = as_rows(source_lrf, 3, 3), as_rows(target_lrf, 3, 3)
    delta_r = length(distance_scale, resolution, 10.0)

    voting_set = np.argsort(lowe, kind="stable")[:voters]  # C_v: top k by 1 - ratio
    rigidity = distance_difference(p, q)  # r(c_i, c_j), Eq. 7
    angle_source = frame_angles(source_frames)  # Eq. 9
    angle_target = frame_angles(target_frames)
    affinity = np.abs(angle_source - angle_target)  # L(c_i, c_j), Eq. 8
    compatibility = np.exp(
        -((rigidity / delta_r) ** 2) - (affinity / angle_scale) ** 2
    )  # D(c_i, c_j), Eq. 10
    framed = has_frame(source_frames, target_frames)
    compatibility[~(framed[:, None] & framed[None, :])] = 0.0
    if exclude_self:
        np.fill_diagonal(compatibility, 0.0)
    scores = compatibility[:, voting_set].sum(axis=1)  # s(c), Eq. 11
    mask, cut = select_above(scores, threshold, otsu)
    details = {
        "voters": voting_set,
        "compatibility": compatibility,
        "angle_source": angle_source,
        "angle_target": angle_target,
    }
    return ReferenceGrouping(mask, scores, cut, details)


def frame_angles(frames: FloatArray) -> FloatArray:
    """(n,n) angle in degrees between every two frames, Eq. 9.

    trace(L_i L_j^-1) is the sum of the products of the entries of L_i and L_j.
    """
    trace = np.einsum("iab,jab->ij", frames, frames)
    return np.degrees(np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0)))
