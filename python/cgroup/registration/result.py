"""What registering two clouds gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cgroup.types import Correspondences, FloatArray, Grouping


@dataclass(frozen=True, eq=False)
class Registration:
    """A source cloud placed on a target cloud.

    Attributes
    ----------
    T_target_source : (4,4) array of float64
        Least-squares pose of the group: maps source points into the target's frame, p' = R p + t.
    grouping : Grouping
        The matches that agree.
    correspondences : Correspondences
        All matches; the group's mask is aligned with them.
    seconds : dict of str to float
        Wall time of each stage, in order.
    """

    T_target_source: FloatArray
    grouping: Grouping
    correspondences: Correspondences
    seconds: dict[str, float]

    @property
    def resolution(self) -> float:
        """The unit pr: mean of the two clouds' resolutions, in the data's unit."""
        resolution = self.correspondences.resolution
        assert resolution is not None  # noqa: S101 - `correspond` always sets it
        return resolution
