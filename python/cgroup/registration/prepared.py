"""A scan made ready once, for registration with any number of others."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup import features
from cgroup._checks.arrays import in_double
from cgroup._checks.values import as_length
from cgroup._runtime.progress import ignore_progress
from cgroup.errors import InputError
from cgroup.features import DescribedCloud
from cgroup.registration.checks import as_viewpoint, check_normals, check_voxels
from cgroup.verification import FineSurface, Surface

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike

    from cgroup.features import Viewpoint, Voxels
    from cgroup.registration.scan import Scan
    from cgroup.types import FloatArray

VOXELS = 5000
"""Voxels that a cloud is thinned to, about."""

UNIT = 0.4
"""Unit of the surfaces, in voxels."""

_NORMAL_NEIGHBORS, _FEATURE_NEIGHBORS = 30, 100

_FINE = (1 / 3, 2 / 3, 4 / 3)
"""Spacings of the surfaces for the last refinement, in voxels: the first at which both clouds have planes."""


@dataclass(frozen=True)
class DenseFront:
    """Every voxel a keypoint, described by FPFH.

    Clouds to be matched need the same. Lengths are in voxels.

    Attributes
    ----------
    normal_radius : float
        Radius of the planes that normals are fitted to, of at most 30 neighbours.
    support : float
        Radius of the descriptor's support, of at most 100 neighbours.
    frame_radius : float
        Radius of the support of SHOT's frames.

    Raises
    ------
    InputError
        For a radius that is not positive.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.registration import DenseFront, prepare
    >>> prepare(standin_pair(pixels=60).source, front=DenseFront(support=6.0)).front
    DenseFront(normal_radius=2.0, support=6.0, frame_radius=8.0)
    """

    normal_radius: float = 2.0
    support: float = 5.0
    frame_radius: float = 8.0

    def __post_init__(self) -> None:
        for name in ("normal_radius", "support", "frame_radius"):
            as_length(name, getattr(self, name))


@dataclass(frozen=True, eq=False)
class PreparedScan:
    """A scan with all that registering it needs, made once by `prepare`.

    Attributes
    ----------
    scan : Scan
        The whole cloud.
    front : DenseFront
        Radii, in voxels.
    voxel : float
        Edge length of the voxels, in the unit of the points.
    viewpoint : (float, float, float) or None
        Where the scanner stood, if that is known.
    voxels : Voxels
        The cloud thinned out.
    normals : (M,3) array of float64
        Of the voxels: outwards for a model, towards the viewpoint where those of both scans are known, else
        to the side of SHOT's z axis; NaN for none.
    described : DescribedCloud
        Frames and FPFH of the voxels that have them; `DescribedCloud.indices` are rows of `voxels`.
    surface : Surface
        What poses are judged on, of unit 0.4 voxel.
    by_frames : bool
        Whether normals are to the side of SHOT's z axis.
    threads : int or None
        Threads to compute on.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.registration import prepare
    >>> scan = prepare(standin_pair(pixels=60).source, voxel=6.0)
    >>> scan
    PreparedScan(points=2554, voxels=306, voxel=6)
    >>> scan.normals.shape == scan.voxels.points.shape
    True
    """

    scan: Scan
    front: DenseFront
    voxel: float
    viewpoint: Viewpoint | None
    voxels: Voxels
    normals: FloatArray
    described: DescribedCloud
    surface: Surface
    by_frames: bool
    threads: int | None
    _fine_surfaces: dict[float, FineSurface | None] = field(default_factory=dict)

    def fine_surface(self, share: float) -> FineSurface | None:
        """Return the cloud in more detail, at a share of the voxel.

        Parameters
        ----------
        share : float
            Spacing of the surface, in voxels.

        Returns
        -------
        FineSurface or None
            Made once for each share; None where that is too fine for the cloud.

        Examples
        --------
        >>> from cgroup.datasets import standin_pair
        >>> from cgroup.registration import prepare
        >>> scan = prepare(standin_pair(pixels=60).source, voxel=6.0)
        >>> scan.fine_surface(2 / 3).spacing, scan.fine_surface(1e-3)
        (4.0, None)
        """
        if share not in self._fine_surfaces:
            try:
                surface = FineSurface(self.scan.cloud, share * self.voxel, threads=self.threads)
            except InputError:
                surface = None
            self._fine_surfaces[share] = surface
        return self._fine_surfaces[share]

    @cached_property
    def turned_by_frames(self) -> PreparedScan:
        """The same scan with normals to the side of SHOT's z axis.

        That is what a partner without a viewpoint needs. The scan itself where its normals are so already;
        otherwise made once.

        Examples
        --------
        >>> from cgroup.datasets import standin_pair
        >>> from cgroup.registration import prepare
        >>> pair = standin_pair(pixels=60)
        >>> scan = prepare(pair.source, viewpoint=pair.source_viewpoint)
        >>> scan.by_frames, scan.turned_by_frames.by_frames
        (False, True)
        """
        if self.by_frames:
            return self
        return prepare_scan(
            self.scan, self.voxel, self.viewpoint, self.front, self.threads, ignore_progress, by_frames=True
        )

    def resized(self, factor: float, begin: Callable[[str], Any] = ignore_progress) -> PreparedScan:
        """Make the same scan ready with voxels of another size.

        Parameters
        ----------
        factor : float
            New edge length over that of now.
        begin : callable
            Called with the name of each stage as it begins; by default nothing is.

        Returns
        -------
        PreparedScan
            With the same viewpoint and radii.

        Raises
        ------
        InputError
            If the new voxel leaves too little or too much of the cloud, or is not positive.
        OutOfMemoryError
            Where the system gives no memory for the computation.

        Examples
        --------
        >>> from cgroup.datasets import standin_pair
        >>> from cgroup.registration import prepare
        >>> scan = prepare(standin_pair(pixels=60).source, voxel=6.0)
        >>> finer = scan.resized(0.75)
        >>> finer.voxel, len(finer) > len(scan)
        (4.5, True)
        """
        return prepare_scan(
            self.scan,
            factor * self.voxel,
            self.viewpoint,
            self.front,
            self.threads,
            begin,
            by_frames=self.by_frames,
        )

    def __len__(self) -> int:
        """Return the number of voxels."""
        return len(self.voxels)

    def __repr__(self) -> str:
        return f"PreparedScan(points={len(self.scan.cloud)}, voxels={len(self)}, voxel={self.voxel:.4g})"


def fine_surfaces(
    source: PreparedScan, target: PreparedScan, shares: Sequence[float] = _FINE
) -> tuple[FineSurface, FineSurface]:
    """Return both clouds in more detail: at the first share of the voxel that the sparser allows."""
    for share in shares:
        both = source.fine_surface(share), target.fine_surface(share)
        if both[0] is not None and both[1] is not None:
            return both[0], both[1]
    message = (
        f"voxel: got {source.voxel:.4g}, at which source or target has too few points next to each other for "
        "the last refinement; give a larger `voxel`"
    )
    raise InputError(message)


def prepare_scan(
    scan: Scan,
    voxel: float,
    viewpoint: ArrayLike | None,
    front: DenseFront,
    threads: int | None,
    begin: Callable[[str], Any],
    *,
    by_frames: bool,
) -> PreparedScan:
    """Make a scan ready with voxels of a known size; normals by frames, the viewpoint, or those it has."""
    eye = None if viewpoint is None else as_viewpoint(scan, viewpoint)
    begin("voxels")
    given = None if by_frames or eye is not None else scan.normals
    voxels = features.voxel_downsample(scan.cloud, voxel, normals=given, threads=threads)
    check_voxels(scan, voxel, len(voxels))
    thinned = features.Cloud(voxels.points, name=scan.name)
    begin("normals")
    normals = features.normals(
        thinned,
        radius=front.normal_radius * voxel,
        neighbors=_NORMAL_NEIGHBORS,
        viewpoint=eye or features.ORIGIN,
        threads=threads,
    )
    check_normals(scan, voxel, normals)
    begin("frames")
    radius = front.frame_radius * voxel
    frames = features.shot_lrf(thinned, np.arange(len(voxels)), radius=radius, threads=threads)
    if by_frames or voxels.normals is not None:
        outwards = frames[:, 2] if voxels.normals is None else voxels.normals
        normals *= _signs(normals, outwards)[:, None]
    begin("descriptors")
    radius = front.support * voxel
    values = features.fpfh(thinned, normals, radius=radius, max_neighbors=_FEATURE_NEIGHBORS, threads=threads)
    rows = np.flatnonzero(np.isfinite(values).all(axis=1) & values.any(axis=1))
    center = in_double(scan.cloud.points).mean(axis=0)
    described = DescribedCloud(rows, voxels.points[rows], frames[rows], values[rows], UNIT * voxel, center)
    begin("surface")
    surface = Surface(
        voxels.points, normals, unit=UNIT * voxel, viewpoint=eye, oriented=not by_frames, threads=threads
    )
    return PreparedScan(scan, front, voxel, eye, voxels, normals, described, surface, by_frames, threads)


def _signs(normals: FloatArray, towards: FloatArray) -> FloatArray:
    """Return -1 where a normal points away from a direction, else 1."""
    return np.where(np.einsum("ij,ij->i", normals, towards) < 0, -1.0, 1.0)
