"""What registering two clouds gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cgroup.types import Correspondences, FloatArray, Grouping


@dataclass(frozen=True, eq=False)
class Registration:
    """A source cloud placed on a target cloud, and how far that can be trusted.

    Attributes
    ----------
    T_target_source : (4,4) array of float64
        Pose refined on the surfaces: maps source points into the target's frame, p' = R p + t.
    ok : bool
        Whether the pose is held to be right.
    probability : float
        That it is, in [0,1]; see `docs/registration.md` for the data behind it.
    fitness : float
        Share of the source's surface that lies on the target's.
    inlier_rmse : float
        Root mean square of the distances there to the target's planes, in the unit of the points.
    information : (6,6) array of float64
        ``sum w J^T J`` of the last point-to-plane step, for a rotation vector about the target's origin
        (first) and a translation; divided by the variance of the distances, what a pose graph takes.
    open_motion : (6,) array of float64 or None
        The motion that the surfaces hardly resist (along a wall, about a pipe), in the same coordinates; None
        where they fix all six.
    alternatives : (k,4,4) array of float64
        Other poses that score almost as well, best first: a symmetric object has some.
    grouping : Grouping
        The verified group: matches that the pose lays together.
    correspondences : Correspondences
        All matches; the group's mask is aligned with them.
    voxel : float
        Edge length of the voxels, in the unit of the points.
    notes : tuple of str
        What a user should know of the pose: sentences.
    seconds : dict of str to float
        Wall time of each stage, in order.
    """

    T_target_source: FloatArray
    ok: bool
    probability: float
    fitness: float
    inlier_rmse: float
    information: FloatArray
    open_motion: FloatArray | None
    alternatives: FloatArray
    grouping: Grouping
    correspondences: Correspondences
    voxel: float
    notes: tuple[str, ...]
    seconds: dict[str, float]

    @property
    def resolution(self) -> float:
        """The unit pr of the matches, in the data's unit."""
        resolution = self.correspondences.resolution
        assert resolution is not None  # noqa: S101 - every front end sets it
        return resolution

    def __repr__(self) -> str:
        answer = "ok" if self.ok else "not ok"
        return f"Registration({answer}, probability={self.probability:.3f}, fitness={self.fitness:.2f})"
