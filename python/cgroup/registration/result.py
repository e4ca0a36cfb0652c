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
        That it is, in [0,1], fitted on half of 1,200 pairs of real scans: right, unrelated and mirrored ones.
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

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.registration import register
    >>> pair = standin_pair(pixels=60)
    >>> done = register(pair.source, pair.target)
    >>> done.ok, done.probability > 0.9, done.T_target_source.shape
    (True, True, (4, 4))
    >>> len(done.correspondences) == len(done.grouping.mask), done.open_motion
    (True, None)
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
        """The unit pr of the matches, in the data's unit.

        Examples
        --------
        >>> from cgroup.datasets import standin_pair
        >>> from cgroup.registration import register
        >>> pair = standin_pair(pixels=60)
        >>> register(pair.source, pair.target, voxel=5.0).resolution  # 0.4 of the voxel
        2.0
        """
        resolution = self.correspondences.resolution
        assert resolution is not None  # noqa: S101 - every front end sets it
        return resolution

    def __repr__(self) -> str:
        answer = "ok" if self.ok else "not ok"
        return f"Registration({answer}, probability={self.probability:.3f}, fitness={self.fitness:.2f})"
