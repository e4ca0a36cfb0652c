"""How time grows with the number of matches."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

PAPER_COMPLEXITY = {
    "ss": "n log n",
    "nnsr": "n",
    "si": "n log n",
    "cv": "n log n",
    "ransac": "n³",
    "st": "n³",
    "gc": "n²",
    "3dhv": "n",
    "gtm": "n²",
}
"""The paper's table of complexities, section 5.3."""

FIT_FROM = 1000
"""Below this number of matches, time is mostly what a call costs."""


def scaling_exponent(n: ArrayLike, seconds: ArrayLike) -> float:
    """Fit ``seconds = c n^b``.

    Parameters
    ----------
    n : (k,) array_like of float
        Numbers of matches; those below `FIT_FROM` are left out.
    seconds : (k,) array_like of float
        Times.

    Returns
    -------
    float
        The exponent b, by least squares on the logarithms; NaN with fewer than two different n.
    """
    sizes, times = np.asarray(n, dtype=np.float64), np.asarray(seconds, dtype=np.float64)
    used = (sizes >= FIT_FROM) & (times > 0)
    if len(np.unique(sizes[used])) < 2:
        return float("nan")
    slope, _ = np.polyfit(np.log(sizes[used]), np.log(times[used]), 1)
    return float(slope)
