"""Criteria of a registered pair, by name; the paper's levels of clutter, occlusion and overlap.

3DMatch's own criterion, an RMSE below 0.2 m by ``gt.info``, is not among these; ``cgroup evaluate`` has both.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from cgroup.evaluation.metrics import REGISTERED_PRECISION
from cgroup.types import FloatArray


@dataclass(frozen=True)
class Protocol:
    """Limits of a registered pair; None for a value without a limit.

    Attributes
    ----------
    name : str
        Its key in `PROTOCOLS`.
    precision_above : float or None
        Exclusive lower bound of the group's precision.
    max_rotation, max_translation, max_rmse : float or None
        Largest errors, inclusive: of the rotation in degrees, of the translation in m, and
        `cgroup.evaluation.alignment_error` in pr.
    title : str
        A readable name, for figures and tables.
    """

    name: str
    precision_above: float | None = None
    max_rotation: float | None = None
    max_translation: float | None = None
    max_rmse: float | None = None
    title: str = ""

    def judge(
        self, precision: float, rotation_error: float, translation_error: float, rmse_pr: float
    ) -> bool | None:
        """Return whether a pair counts as registered.

        Parameters
        ----------
        precision : float
            Of the group; 0 for an empty one.
        rotation_error, translation_error, rmse_pr : float
            In degrees, in the data's unit, and `cgroup.evaluation.alignment_error` in pr; infinite without a
            pose, NaN if unknown.

        Returns
        -------
        bool or None
            None if a value with a limit is NaN.
        """
        limits = (self.max_rotation, self.max_translation, self.max_rmse)
        errors = zip((rotation_error, translation_error, rmse_pr), limits, strict=True)
        limited = [(error, limit) for error, limit in errors if limit is not None]
        judged = [error for error, _ in limited] + ([] if self.precision_above is None else [precision])
        if any(map(math.isnan, judged)):
            return None
        precise = self.precision_above is None or precision > self.precision_above
        return precise and all(error <= limit for error, limit in limited)


PAPER_PROTOCOL = "precision>0.1"  # the paper's own criterion

# Prefix of record columns with the verdict by one criterion; that by the paper's is ``registered``.
PROTOCOL_PREFIX = "ok:"
PROTOCOLS: dict[str, Protocol] = {
    protocol.name: protocol
    for protocol in (
        # The paper, on all data; needs no pose.
        Protocol(PAPER_PROTOCOL, REGISTERED_PRECISION, title="precision > 0.1 (the paper's)"),
        # Later work on U3M.
        Protocol("rmse<=1pr", max_rmse=1.0, title="RMSE at most 1 pr"),
        Protocol("rmse<=5pr", max_rmse=5.0, title="RMSE at most 5 pr"),
        # cgroup, for whole scans.
        Protocol("5deg+5pr", max_rotation=5.0, max_rmse=5.0, title="5°, 5 pr over the overlap"),
        Protocol("2deg+2pr", max_rotation=2.0, max_rmse=2.0, title="2°, 2 pr over the overlap"),
        # DGR, PointDSC, MAC; the strict one is cgroup's, for whole scans.
        Protocol("3dmatch", max_rotation=15.0, max_translation=0.3, title="3DMatch: 15°, 0.3 m"),
        Protocol("3dmatch-strict", max_rotation=5.0, max_translation=0.1, title="5°, 0.1 m"),
        # DGR, PointDSC, MAC; the second one FCGF, Predator, GeoTransformer.
        Protocol("kitti", max_rotation=5.0, max_translation=0.6, title="KITTI: 5°, 0.6 m"),
        Protocol("kitti-2m", max_rotation=5.0, max_translation=2.0, title="5°, 2 m"),
    )
}
"""Criteria by name, with the works that use them."""


@dataclass(frozen=True)
class Bins:
    """Levels of a property of pairs, evenly spaced and ascending.

    By the rule "nearest" a value belongs to the nearest level; by "from" to the greatest level not above it,
    up to one spacing above the last level, inclusive.
    """

    levels: tuple[float, ...]
    rule: Literal["nearest", "from"]


# The paper's, section 4.3.
CLUTTER = Bins((0.65, 0.70, 0.75, 0.80, 0.85, 0.90, 0.95), "nearest")
OCCLUSION = Bins((0.60, 0.65, 0.70, 0.75, 0.80, 0.85, 0.90), "nearest")
OVERLAP = Bins((0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9), "from")
LEAST_PAIRS = 5  # least number of pairs of a level; the mean of fewer is unreliable
_ROUNDING = 1e-9  # 0.7 read from a file belongs to the level 0.7


def binned(values: ArrayLike, bins: Bins) -> FloatArray:
    """Replace each value (n,) in [0,1] by its level; NaN for a value outside all levels."""
    given = np.asarray(values, dtype=np.float64)
    levels = np.array(bins.levels)
    step = levels[1] - levels[0]
    place = (given - levels[0]) / step
    if bins.rule == "nearest":
        place = np.clip(np.floor(place + 0.5 + _ROUNDING), 0, len(levels) - 1)
    else:
        end = np.abs(place - len(levels)) <= _ROUNDING
        place = np.where(end, len(levels) - 1, np.floor(place + _ROUNDING))
    inside = (place >= 0) & (place < len(levels))
    chosen = np.where(inside, place, 0).astype(np.intp)
    return np.where(inside, levels[chosen], np.nan)
