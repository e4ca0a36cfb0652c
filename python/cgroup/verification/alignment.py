"""The last refinement of a pose, and the residuals between two surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cgroup import _core
from cgroup._checks.values import as_instance, as_length, run_options
from cgroup.features.cloud import CloudLike, core_cloud
from cgroup.rigid import check_rigid
from cgroup.types import FloatArray

SAMPLES = 3000  # samples of a fine surface


class FineSurface:
    """A finely downsampled cloud, prepared once for `align`.

    It serves with any number of partners. Planes are fitted to the points within 2.4 spacings of about 3,000
    samples, which are drawn against the frequency of their normals. `threads` is as for `shot`.

    Parameters
    ----------
    points : Cloud or (N,3) array_like of float
        Whole cloud.
    spacing : float
        Edge length of its voxels, one to a few times the distance between points. Both surfaces of a pair
        need the same.

    Examples
    --------
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.verification import FineSurface
    >>> points = standin_pair(pixels=60).source.points
    >>> len(FineSurface(points, 1.5 * features.resolution(points))) < len(points)
    True
    """

    __slots__ = ("_core", "_spacing")

    def __init__(self, points: CloudLike, spacing: float, *, threads: int | None = None) -> None:
        self._spacing = as_length("spacing", spacing)
        self._core = _core.FineSurface(core_cloud(points), run_options(threads), self._spacing)

    @property
    def spacing(self) -> float:
        """Edge length of the voxels, in the unit of the points."""
        return self._spacing

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self._core)

    def __repr__(self) -> str:
        return f"FineSurface(n={len(self)}, spacing={self._spacing:.4g})"


@dataclass(frozen=True, eq=False)
class Alignment:
    """A refined pose, and the residuals between the surfaces under it.

    Attributes
    ----------
    T_target_source : (4,4) array of float64
        The refined pose.
    residuals : (m,) array of float64
        Signed distance of each paired sample's plane from the nearest point of the other surface. A sample is
        paired if that point is within 3 spacings.
    deviations : (m,) array of float64
        Standard deviation of the points around each of these samples from its own plane (three degrees of
        freedom are the plane's): noise and curvature.
    paired : float
        Fraction of the samples of both surfaces that are paired.
    information : (6,6) array of float64
        ``sum w J^T J`` of a point-to-plane step, for a rotation vector about the target's origin (first)
        and a translation. Divide by the variance of the residuals for the information of a pose graph.
    open_motion : (6,) array of float64 or None
        The motion that the surfaces hardly resist, in the same coordinates, scaled to move them by about one
        spacing; None if they determine all six.
    """

    T_target_source: FloatArray
    residuals: FloatArray
    deviations: FloatArray
    paired: float
    information: FloatArray
    open_motion: FloatArray | None

    @property
    def rmse(self) -> float:
        """Root mean square of the residuals; NaN without pairs."""
        return float(np.sqrt(np.mean(self.residuals**2))) if len(self.residuals) else float("nan")

    def __repr__(self) -> str:
        return f"Alignment(paired={self.paired:.2f}, rmse={self.rmse:.3g})"


def align(
    source: FineSurface, target: FineSurface, pose: ArrayLike, *, threads: int | None = None
) -> Alignment:
    """Refine a pose whose error is at most about two spacings.

    Point-to-plane steps in both directions, with planes of the samples' own neighbourhoods: reach shrinks
    from 3 to 1.5 spacings, and residuals are weighted by Tukey's function at 4.685 times their robust
    deviation (Y. Chen and G. Medioni, *Object modelling by registration of multiple range images*, 1992).
    `threads` is as for `shot`.

    Parameters
    ----------
    source, target : FineSurface
        Of the same spacing.
    pose : (4,4) array_like of float
        Rigid transform from the source into the target.

    Returns
    -------
    Alignment
        The refined pose, with the residuals under it.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.verification import FineSurface, align
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = features.resolution(points)
    >>> surface = FineSurface(points, 1.5 * pr)
    >>> bool(np.allclose(align(surface, surface, np.eye(4)).T_target_source, np.eye(4)))
    True
    """
    as_instance("source", source, FineSurface)
    as_instance("target", target, FineSurface)
    return align_each(source, target, check_rigid(pose, "pose")[None], SAMPLES, threads)[0]


def align_each(
    source: FineSurface, target: FineSurface, poses: FloatArray, samples: int, threads: int | None
) -> list[Alignment]:
    """Refine checked poses with at most `samples` samples of either surface."""
    surfaces = source._core, target._core  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] - not for users
    aligned = _core.align(*surfaces, poses, run_options(threads), samples)
    return [
        Alignment(pose, residuals, deviations, len(residuals) / count, *resistance)
        for pose, residuals, deviations, count, resistance in aligned
    ]


def sample_points(surface: FineSurface) -> FloatArray:
    """Return the positions of the samples of a surface, (n,3)."""
    return surface._core.sample_points()  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] - not for users


def plane_distances(
    source: FineSurface, target: FineSurface, pose: FloatArray, threads: int | None
) -> FloatArray:
    """Return distances of the target's nearest points from the samples' planes; NaN beyond 3 spacings."""
    surfaces = source._core, target._core  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] - not for users
    return _core.plane_distances(*surfaces, pose[None], run_options(threads))
