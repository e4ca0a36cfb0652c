"""Results of a registration."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from cgroup import features
from cgroup._checks.values import as_choice
from cgroup._runtime.workers import cached_property
from cgroup._show.drawing import plot
from cgroup._show.words import pose_html, result_table
from cgroup.fronts.matching import scale_matches
from cgroup.registration.judge import Found, Judgement
from cgroup.rigid import apply
from cgroup.rigid.se3 import CONVENTIONS, Convention, covariance_in, deviations_at
from cgroup.rigid.transforms import split_scale
from cgroup.types import AnyCloud, Correspondences, FloatArray, Grouping, PointCloud
from cgroup.types.point_cloud import as_cloud, join_clouds

SEARCH = "search"  # the stage that the core divides further
# Red, green and blue of source and target, if the clouds have no colours
SCAN_COLORS = (230, 159, 0), (0, 114, 178)


_ELSEWHERE = {
    **dict.fromkeys(
        ("transformation", "transform", "pose", "T", "matrix", "estimated_transform"),
        "T_target_source",
    ),
    **dict.fromkeys(("converged", "valid", "success", "is_converged", "has_converged"), "ok"),
    "correspondence_set": "correspondences",
    "matches": "correspondences",
    "score": "probability",
    "confidence": "probability",
}
"""Attributes of results elsewhere (Open3D, small_gicp, KISS-Matcher, PCL), and ours."""


@dataclass(frozen=True, eq=False)
class Registration:
    """The pose of a source in a target's frame, with its probability and covariance.

    Attributes
    ----------
    T_target_source : (4,4) array of float64
        Refined pose: maps source points into the target's frame, p' = R p + t; a similarity, p' = s R p + t,
        if the scale was estimated.
    ok : bool
        Whether the pose is accepted.
    probability : float
        Probability that it is right, in [0,1], against all other places and "none of these"; places that look
        the same share it.
    fitness : float
        Fraction of the source's surface that overlaps the target's.
    target_fitness : float
        Fraction of the target's surface that overlaps the source's.
    inlier_rmse : float
        Root mean square of the distances to the target's planes in the overlap, in the unit of the points.
    covariance : (6,6) array of float64
        Of the small motion x = (rotation vector, translation) in the target's frame to the true pose,
        ``T_true = Exp(x) T_target_source``, if the pose is correct; `covariance_in` returns those of other
        libraries. Along an open motion the deviation is about five voxels.
    open_motion : (6,) array of float64 or None
        The motion that the surfaces hardly resist (along a wall, about a pipe), in the same coordinates; None
        if they fix all six.
    alternatives : (k,4,4) array of float64
        Other poses that share the probability, the likeliest first, as for repeating structures.
    grouping : Grouping
        The verified group: matches that agree with the pose.
    correspondences : Correspondences
        All matches; the group's mask is aligned with them.
    voxel : float
        Edge length of the fine voxels, in the unit of the points.
    notes : tuple of str
        Remarks on the pose, one sentence each.
    seconds : dict of str to float
        Wall time of each stage.
    scale : float
        The scale s: length of the source's unit in the target; 1 unless it was estimated. All lengths above
        are in the target's unit, and `covariance` is that of the source in that unit, at this scale.
    scale_deviation : float
        Relative standard deviation of `scale`; 0 unless it was estimated.
    decoy_probability : float or None
        Probability of the best pose of the mirrored source, a wrong one, for `false_accepts`; None if no pose
        was searched for.
    """

    T_target_source: FloatArray
    ok: bool
    probability: float
    fitness: float
    target_fitness: float
    inlier_rmse: float
    open_motion: FloatArray | None
    alternatives: FloatArray
    grouping: Grouping
    correspondences: Correspondences
    voxel: float
    notes: tuple[str, ...]
    seconds: dict[str, float]
    scale: float = 1.0
    scale_deviation: float = 0.0
    decoy_probability: float | None = None
    _covariance: FloatArray | Callable[[], FloatArray] = field(
        default_factory=lambda: np.full((6, 6), np.nan)
    )

    @cached_property
    def covariance(self) -> FloatArray:
        """The covariance, computed when it is first read."""
        return self._covariance() if callable(self._covariance) else self._covariance

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields with the covariance computed, for pickle and copy."""
        return {**vars(self), "_covariance": self.covariance}

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> object:
            """Raise `AttributeError`; suggest the attribute for names from other libraries."""
            ours = _ELSEWHERE.get(name)
            guess = f"; did you mean {ours!r}?" if ours else ""
            raise AttributeError(f"a Registration has no {name!r}{guess}", name=name, obj=self)

    @property
    def resolution(self) -> float:
        """The unit pr of the matches, in the data's unit."""
        resolution = self.correspondences.resolution
        assert resolution is not None  # noqa: S101 - every front end sets it
        return resolution

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard deviations of the rotation, and of the position of the source's centre.

        In degrees, and in the unit of the points: square roots of the traces of the two blocks of
        `covariance`, about the mean of the source's points.
        """
        middle = self.correspondences.source_centroid
        assert middle is not None  # noqa: S101 - every front end sets it
        return deviations_at(self.covariance, apply(self.T_target_source, middle[None])[0])

    def covariance_in(self, convention: Convention) -> FloatArray:
        """Return the covariance in the convention of another library's pose graph.

        Parameters
        ----------
        convention : {"gtsam", "g2o", "ros"}
            "gtsam": of (rotation vector, translation) in the source's frame, for the noise model of a
            ``BetweenFactorPose3(target, source, T_target_source)``. "g2o": of (translation, vector part of
            the quaternion) in the source's frame, whose inverse an ``EDGE_SE3:QUAT target source`` takes.
            "ros": of (translation of the source's origin, rotation vector) about the target's axes, for
            ``geometry_msgs/PoseWithCovariance``.

        Returns
        -------
        (6,6) array of float64
            To first order. If the scale was estimated, the source's frame is in the target's unit.
        """
        as_choice("convention", convention, CONVENTIONS)
        return covariance_in(convention, self.covariance, self._rigid)

    @property
    def _rigid(self) -> FloatArray:
        """The pose of the source in the target's unit."""
        return self.T_target_source if self.scale == 1.0 else split_scale(self.T_target_source)[1]

    def merged(self, source: AnyCloud, target: AnyCloud) -> PointCloud:
        """Merge the aligned source and the target into one cloud.

        Parameters
        ----------
        source, target : PointCloud or (N,3) array_like of float
            The clouds that were registered.

        Returns
        -------
        PointCloud
            In the target's frame, downsampled to the finer point spacing of the two, so that the overlap is
            not denser. Colours are those of the clouds if both have some, else orange for the source and blue
            for the target; normals if both have some.
        """
        return merge_clouds((self.place(source), as_cloud("target", target)), SCAN_COLORS)

    def place(self, source: AnyCloud) -> PointCloud:
        """Move the source into the target's frame.

        Parameters
        ----------
        source : PointCloud or (N,3) array_like of float
            The cloud that was registered.

        Returns
        -------
        PointCloud
            In the target's frame and unit, with rotated normals.
        """
        return self._in_the_target_unit(as_cloud("source", source)).transformed(self._rigid)

    def _in_the_target_unit(self, cloud: PointCloud) -> PointCloud:
        if self.scale == 1.0:
            return cloud
        place = None if cloud.viewpoint is None else np.multiply(self.scale, cloud.viewpoint)
        return replace(cloud, points=np.multiply(self.scale, cloud.points), viewpoint=place)

    def plot(
        self,
        source: AnyCloud | None = None,
        target: AnyCloud | None = None,
        *,
        correct: ArrayLike | None = None,
        interactive: bool = False,
    ) -> Any:  # noqa: ANN401 - matplotlib's Figure or plotly's
        """Draw both clouds, the matches that agree with the pose, and the aligned clouds.

        Parameters are as for `plot` of `Correspondences`.

        Returns
        -------
        matplotlib.figure.Figure or plotly.graph_objects.Figure
            Not shown; notebooks show the value of a cell.
        """
        matches = self.correspondences
        if self.scale != 1.0:
            matches = scale_matches(matches, self.scale)
            source = None if source is None else self._in_the_target_unit(as_cloud("source", source))
        given = {"source": source, "target": target, "pose": self._rigid, "correct": correct}
        title = f"right with a probability of {self.probability:.2f}"
        return plot(
            given,
            matches,
            self.grouping.mask,
            interactive=interactive,
            title=title,
            grouping=self.grouping,
            is_placed=True,
        )

    def _repr_html_(self) -> str:
        answer = "the pose is reliable" if self.ok else "the pose is not reliable"
        together = f"{self.grouping.size} of {len(self.correspondences)} that agree with the pose"
        shares = [f"{100 * share:.0f} %" for share in (self.fitness, self.target_fitness)]
        rows = [
            ("probability", f"{self.probability:.3f}"),
            (
                "overlap",
                f"{shares[0]} of the source overlaps the target, {shares[1]} of the target the source",
            ),
            ("residual", f"{self.inlier_rmse:.3g} there"),
            ("matches", together),
            ("voxel", f"{self.voxel:.4g}"),
            ("scale", "" if self.scale == 1.0 else f"{self.scale:.5g} to {100 * self.scale_deviation:.1g} %"),
            *(("note", note) for note in self.notes),
            ("time", f"{sum(self.seconds.values()):.2f} s"),
            ("pose", pose_html(self.T_target_source)),
        ]
        return result_table(f"Registration: {answer}", self.probability, rows)

    def __repr__(self) -> str:
        answer = "ok" if self.ok else "not ok"
        return f"Registration({answer}, probability={self.probability:.3f}, fitness={self.fitness:.2f})"


def merge_clouds(
    clouds: Sequence[PointCloud], colors: Iterable[ArrayLike], voxel: float | None = None
) -> PointCloud:
    """Merge posed clouds into one, downsampled by a voxel: the finest point spacing by default.

    Each gets its own colour unless all have colours.
    """
    if voxel is None:
        voxel = min(features.resolution(cloud.points) for cloud in clouds)
    if any(cloud.colors is None for cloud in clouds):
        clouds = [
            replace(cloud, colors=np.full((len(cloud), 3), color, np.uint8))
            for cloud, color in zip(clouds, colors, strict=True)
        ]
    voxels = features.voxel_downsample(join_clouds(clouds), voxel)
    return PointCloud(voxels.points, voxels.normals, colors=voxels.colors, intensities=voxels.intensities)


def registration_of(found: Found, judgement: Judgement, seconds: dict[str, float]) -> Registration:
    """Return the result of a search that has a pose."""
    return Registration(
        T_target_source=found.pose,
        ok=judgement.ok,
        probability=judgement.probability,
        fitness=found.fitness,
        target_fitness=found.target_fitness,
        inlier_rmse=found.rmse,
        open_motion=found.open_motion,
        alternatives=found.alternatives,
        grouping=found.grouping,
        correspondences=found.matches,
        voxel=found.voxel,
        notes=judgement.notes,
        decoy_probability=found.decoy,
        seconds={stage: value for stage, value in seconds.items() if stage != SEARCH} | found.seconds,
        _covariance=found.covariance,
    )
