"""NNSR: Lowe's ratio test (paper 3.1, Eq. 2).

Decisions where the paper is open
---------------------------------
* The test is done on the ratio itself (ratio <= max_ratio), not on 1 - ratio, which
  would move the border by rounding.
* The reported threshold belongs to the scores: 1 - max_ratio.
* A NaN ratio is never selected.
"""

from numpy.typing import ArrayLike

from .result import ReferenceGrouping, as_rows


def nnsr(ratio: ArrayLike, *, max_ratio: float = 0.8) -> ReferenceGrouping:
    distances_ratio = as_rows(ratio)
    scores = 1.0 - distances_ratio  # Eq. 2, left side
    mask = distances_ratio <= max_ratio  # Eq. 2 solved for the ratio
    return ReferenceGrouping(mask, scores, 1.0 - max_ratio)
