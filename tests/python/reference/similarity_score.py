"""SS: keep the correspondences with similar descriptors (paper 3.1, Eq. 1).

Decisions where the paper is open
---------------------------------
* Non-finite similarities (-inf: zero descriptor) are never selected, whatever the
  threshold, and take no part in Otsu's method.
* A fixed threshold selects s >= threshold. With Otsu the mask is the one of
  `otsu_split`, s > threshold; for the midpoint thresholds both readings are the same.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from .otsu import OtsuMode, otsu_split
from .result import ReferenceGrouping, as_rows


def ss(
    similarity: ArrayLike,
    *,
    threshold: float | Literal["otsu"] = "otsu",
    otsu: OtsuMode = "minmax",
    bins: int = 100,
) -> ReferenceGrouping:
    scores = as_rows(similarity)  # Eq. 1, left side: 1 - |f_norm - f'_norm|
    finite = np.isfinite(scores)
    mask = np.zeros(len(scores), dtype=bool)
    if threshold == "otsu":
        mask[finite], cut = otsu_split(scores[finite], otsu, bins)  # t_ss adaptive (Table 1)
    else:
        cut = float(threshold)
        mask[finite] = scores[finite] >= cut  # Eq. 1
    return ReferenceGrouping(mask, scores, cut)
