"""Criteria by which a pair counts as registered, by name.

| name | registered if | used by |
|---|---|---|
| ``precision>0.1`` | the group's precision exceeds 0.1; needs no pose | the paper, on all data |
| ``rmse<=1pr``, ``rmse<=5pr`` | the mean error over the overlap is within that | later work on U3M |
| ``5deg+5pr``, ``2deg+2pr`` | rotation and mean error over the overlap | cgroup, for whole scans |
| ``3dmatch`` | rotation within 15 degrees, translation within 0.3 m | DGR, PointDSC, MAC |
| ``3dmatch-strict`` | rotation within 5 degrees, translation within 0.1 m | cgroup, for whole scans |
| ``kitti`` | rotation within 5 degrees, translation within 0.6 m | DGR, PointDSC, MAC |
| ``kitti-2m`` | rotation within 5 degrees, translation within 2 m | FCGF, Predator, GeoTransformer |

3DMatch's own criterion, which Predator and GeoTransformer report, is another: an RMSE below 0.2 m over the
true matches of two fragments, by way of the covariances in ``gt.info``. It isn't among these; recalls by
``3dmatch`` compare with those of the methods in the table only. ``cgroup evaluate`` scores poses by both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from cgroup.evaluation.metrics import REGISTERED_PRECISION


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
    """

    name: str
    precision_above: float | None = None
    max_rotation: float | None = None
    max_translation: float | None = None
    max_rmse: float | None = None

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
        errors = (
            (rotation_error, self.max_rotation),
            (translation_error, self.max_translation),
            (rmse_pr, self.max_rmse),
        )
        kept = [(error, limit) for error, limit in errors if limit is not None]
        if any(math.isnan(error) for error, _ in kept):
            return None
        if self.precision_above is not None and math.isnan(precision):
            return None
        precise = self.precision_above is None or precision > self.precision_above
        return precise and all(error <= limit for error, limit in kept)


PAPER_PROTOCOL = "precision>0.1"
"""The paper's own criterion."""

PROTOCOL_PREFIX = "ok:"
"""Prefix of record columns with the verdict by one criterion; that by the paper's is ``registered``."""

PROTOCOLS: dict[str, Protocol] = {
    protocol.name: protocol
    for protocol in (
        Protocol(PAPER_PROTOCOL, precision_above=REGISTERED_PRECISION),
        Protocol("rmse<=1pr", max_rmse=1.0),
        Protocol("rmse<=5pr", max_rmse=5.0),
        Protocol("5deg+5pr", max_rotation=5.0, max_rmse=5.0),
        Protocol("2deg+2pr", max_rotation=2.0, max_rmse=2.0),
        Protocol("3dmatch", max_rotation=15.0, max_translation=0.3),
        Protocol("3dmatch-strict", max_rotation=5.0, max_translation=0.1),
        Protocol("kitti", max_rotation=5.0, max_translation=0.6),
        Protocol("kitti-2m", max_rotation=5.0, max_translation=2.0),
    )
}
"""Criteria by name."""
