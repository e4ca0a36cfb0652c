"""Prepare scans: voxels of one size, with normals on one side, descriptors and a surface."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup import features
from cgroup._checks.arrays import in_double
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_choice, as_instance, as_length
from cgroup._runtime.memory import report_refused_memory
from cgroup._runtime.progress import as_stage_function, ignore_progress
from cgroup._runtime.workers import cached_property
from cgroup.errors import InputError
from cgroup.features import Cloud, DescribedCloud, Viewpoint, Voxels
from cgroup.features.voxels import choose_thinning, thin
from cgroup.registration.planes import Planes, find_planes, number_cells
from cgroup.registration.rings import fill_between_rings
from cgroup.registration.scan import (
    NORMALS,
    Normals,
    Scan,
    as_model,
    as_surface,
    as_viewpoint,
    check_sizes,
    shows_layers,
    viewpoint_name,
    without_strays,
)
from cgroup.types import AnyCloud, FloatArray, IndexArray
from cgroup.verification import FineSurface, Surface
from cgroup.verification.alignment import sample_points

UNIT = 0.4  # unit of the surfaces and of the matches, in voxels
VOXELS = 5000  # voxels that a cloud is thinned to, about
LEAST_VOXELS = 100  # voxels below which unrelated clouds fit each other too well by chance
MOST_VOXELS = 100_000  # voxels beyond which matching each with all others takes more than some 20 seconds
# Share and number of the voxels that have a normal, below which they are too far apart
LEAST_PLANES, LEAST_PLANAR_VOXELS = 0.1, 10
FEW_VOXELS = 20  # voxels below which a cloud is no surface
# Points below which a voxel chosen by number may be too small. It grows in such steps until a share of the
# voxels has a normal; a diagonal has more voxels than the last.
_SPARSE, _USUAL_PLANES, _COARSER, _LEAST_ACROSS = 2000, 0.9, 2**0.25, 5.0
# Points of a cloud below which voxels begin finer, and by how much: else too few are left
FEW_POINTS, _FINER_OF_FEW = 300, 0.5
# Blocks of a surface's box, and along its edge: half of those allowed; and the edge of one, in voxels
_MOST_BLOCKS, _MOST_ALONG, _BLOCK = 2**29, 2**16, 8 * UNIT
# Voxels that a cloud gets which is smaller than another, and how much smaller it then is
_LEAST_OF_EACH, _SIZES_DIFFER = 1000, 2.0
# Most neighbours of a voxel's plane, and of its descriptor's support
NORMAL_NEIGHBORS, FEATURE_NEIGHBORS = 30, 100
# Spacings of the surfaces for the last refinement, in voxels: the first at which both clouds have planes
FINE = (1 / 3, 2 / 3, 4 / 3, 8 / 3, 16 / 3)


@dataclass(frozen=True)
class DenseFront:
    """Options of the dense front: every voxel is a keypoint, described by FPFH.

    Clouds to be matched need the same radii, in voxels.

    Attributes
    ----------
    normal_radius : float
        Radius of the planes that normals are fitted to, of at most 30 neighbours.
    support : float
        Radius of the descriptor's support, of at most 100 neighbours.
    frame_radius : float
        Radius of the support of SHOT's frames.
    """

    normal_radius: float = 2.0
    support: float = 5.0
    frame_radius: float = 8.0

    def __post_init__(self) -> None:
        for name in ("normal_radius", "support", "frame_radius"):
            as_length(name, getattr(self, name))


@dataclass(frozen=True, eq=False)
class PreparedScan:
    """A scan prepared for registration by `prepare`.

    Attributes
    ----------
    scan : Scan
        The whole cloud.
    front : DenseFront
        Radii, in voxels.
    voxel : float
        Edge length of the voxels, in the unit of the points.
    viewpoint : (float, float, float) or None
        Position of the scanner, if known.
    voxels : Voxels
        The downsampled cloud.
    normals : (M,3) array of float64
        Of the voxels: outwards for a model, towards the viewpoint if those of both scans are known, else to
        the side of SHOT's z axis; NaN for none.
    surface : Surface
        The surface for verification, of unit 0.4 voxel.
    by_frames : bool
        Whether normals are to the side of SHOT's z axis.
    threads : int or None
        Number of threads.
    """

    scan: Scan
    front: DenseFront
    voxel: float
    viewpoint: Viewpoint | None
    voxels: Voxels
    normals: FloatArray
    surface: Surface
    by_frames: bool
    threads: int | None
    _frames: FloatArray | None = None
    _fine_surfaces: dict[float, FineSurface | None] = field(default_factory=dict)
    _cells: dict[float, IndexArray] = field(default_factory=dict)
    _thinned: dict[float, FloatArray] = field(default_factory=dict)

    def __reduce__(self) -> tuple[Callable[..., PreparedScan], tuple[Any, ...]]:
        """Pickle the expensive results; surfaces are built again."""
        parts = self.scan, self.front, self.voxel, self.viewpoint, self.voxels, self.normals
        return assemble, (*parts, vars(self).get("described"), self.by_frames, self.threads)

    @cached_property
    def described(self) -> DescribedCloud:
        """Frames and FPFH of the voxels that have them, computed on first use.

        `DescribedCloud.indices` are rows of `voxels`.
        """
        shared = Preparation(self.voxel, self.front, self.threads)
        thinned = features.Cloud(self.voxels.points, name=self.scan.name)
        frames = shared.find_frames(thinned) if self._frames is None else self._frames
        values = shared.describe_by_fpfh(thinned, self.normals)
        rows = np.flatnonzero(np.isfinite(values).all(axis=1) & values.any(axis=1))
        unit, points = UNIT * self.voxel, self.voxels.points[rows]
        return DescribedCloud(rows, points, frames[rows], values[rows], unit, self.scan.centroid)

    def fine_surface(self, share: float) -> FineSurface | None:
        """Return the cloud at the spacing of a fraction of the voxel; None if the cloud is too sparse.

        :meta private:
        """
        if share not in self._fine_surfaces:
            try:
                surface = FineSurface(self.scan.cloud, share * self.voxel, threads=self.threads)
            except InputError:
                surface = None
            self._fine_surfaces[share] = surface
        return self._fine_surfaces[share]

    def thinned(self, share: float) -> FloatArray:
        """Return the mean point of each cell with a fraction of the voxel as edge, (n,3).

        :meta private:
        """
        if share not in self._thinned:
            size = share * self.voxel
            self._thinned[share] = thin(self.scan.cloud, size, threads=self.threads).points
        return self._thinned[share]

    @cached_property
    def turned_by_frames(self) -> PreparedScan:
        """The same scan with normals to the side of SHOT's z axis, for a partner without viewpoint.

        :meta private:
        """
        if self.by_frames:
            return self
        shared = Preparation(self.voxel, self.front, self.threads)
        return shared.prepare(self.scan, self.viewpoint, ignore_progress, by_frames=True)

    @cached_property
    def shows_layers(self) -> bool:
        """Whether points occlude each other from the viewpoint; in a single scan none do.

        :meta private:
        """
        return self.viewpoint is not None and shows_layers(self.scan, self.viewpoint, self.voxel)

    @cached_property
    def planes(self) -> Planes:
        """Planes of the voxels, the largest first.

        :meta private:
        """
        return find_planes(self.voxels.points, self.voxel)

    def cells(self, surface: FineSurface) -> IndexArray:
        """Return the cell of 4 voxels of each sample of a fine surface; -1 for samples by a plane.

        :meta private:
        """
        if surface.spacing not in self._cells:
            points = sample_points(surface)
            self._cells[surface.spacing] = number_cells(
                points, self.planes, self.voxels.points, self.voxel, self.scan.axes
            )
        return self._cells[surface.spacing]

    def resized(self, factor: float, begin: Callable[[str], Any] = ignore_progress) -> PreparedScan:
        """Prepare the same scan with voxels of another size, a factor of the current one.

        :meta private:
        """
        finer = Preparation(factor * self.voxel, self.front, self.threads)
        return finer.prepare(self.scan, self.viewpoint, begin, by_frames=self.by_frames)

    def __len__(self) -> int:
        """Return the number of voxels."""
        return len(self.voxels)

    def __repr__(self) -> str:
        return f"PreparedScan(points={len(self.scan.cloud)}, voxels={len(self)}, voxel={self.voxel:.4g})"


def assemble(
    scan: Scan,
    front: DenseFront,
    voxel: float,
    viewpoint: Viewpoint | None,
    voxels: Voxels,
    normals: FloatArray,
    described: DescribedCloud | None,
    by_frames: bool,  # noqa: FBT001 - pickle calls it by position
    threads: int | None,
    frames: FloatArray | None = None,
) -> PreparedScan:
    """Build a scan with its surface, and with its descriptors if they are known."""
    surface = Surface(
        voxels.points,
        normals,
        unit=UNIT * voxel,
        viewpoint=viewpoint,
        oriented=not by_frames,
        threads=threads,
    )
    made = PreparedScan(scan, front, voxel, viewpoint, voxels, normals, surface, by_frames, threads, frames)
    if described is not None:
        vars(made)["described"] = described
    return made


def fine_surfaces(
    source: PreparedScan, target: PreparedScan, shares: Sequence[float] = FINE
) -> tuple[FineSurface, FineSurface]:
    """Return the fine surfaces of both scans, at the first spacing that suits the sparser one."""
    for share in shares:
        both = source.fine_surface(share), target.fine_surface(share)
        if both[0] is not None and both[1] is not None:
            return both[0], both[1]
    raise InputError(
        "voxel",
        f"{source.voxel:.4g}, at which source or target has too few points next to each other for the "
        "last refinement",
        "give a larger `voxel`",
    )


@report_refused_memory()
@explain_wrong_calls
def prepare(
    cloud: Cloud | AnyCloud,
    *,
    voxel: float | None = None,
    viewpoint: ArrayLike | None = None,
    view_direction: ArrayLike | None = None,
    normals: Normals = "pca",
    front: DenseFront | None = None,
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> PreparedScan:
    """Prepare a scan for registration with any number of others.

    Further parameters are as for `register`.

    Parameters
    ----------
    cloud : PointCloud, Cloud, path or (N,3) array_like of float
        Whole cloud.
    voxel : float, optional
        Edge length of the voxels, in the unit of the points; by default about 5,000 are left
        (`cgroup.features.choose_voxel`). Clouds to be registered need the same.
    normals : {"pca", "mesh", "given"}
        Source of the outside of a whole model: none, its faces (which are then also sampled), or
        `PointCloud.normals`. A model needs it if the scan has a viewpoint. The planes themselves are always
        fitted to the voxels.
    front : DenseFront, optional
        Radii of normals, frames and descriptors, in voxels.

    Returns
    -------
    PreparedScan
        Voxels, normals and surface; descriptors are computed when they are first needed.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.registration import prepare, register
    >>> pair = standin_pair(pixels=60)
    >>> target = prepare(pair.target, voxel=6.0)
    >>> len(target) > 100, register(pair.source, target).ok
    (True, True)
    """
    as_choice("normals", normals, NORMALS)
    viewpoint = as_viewpoint(viewpoint, view_direction)
    if normals != "pca" and viewpoint is not None:
        raise InputError(
            "viewpoint, normals", f"both, but {normals!r} normals are those of whole models", "give one"
        )
    if normals == "pca":
        scan = as_surface("cloud", cloud)
        viewpoint = scan.stored_viewpoint if viewpoint is None else viewpoint
        scan = fill_between_rings(without_strays(scan))
    else:
        scan = as_model("cloud", cloud, normals)
    radii = DenseFront() if front is None else as_instance("front", front, DenseFront)
    shared = Preparation(_choose_voxel([scan], voxel, threads), radii, threads)
    by_frames = viewpoint is None and normals == "pca"
    return shared.prepare(scan, viewpoint, as_stage_function(progress), by_frames=by_frames)


class Given(NamedTuple):
    """An input scan, prepared or not, and its viewpoint."""

    name: str
    scan: PreparedScan | Scan
    viewpoint: ArrayLike | None

    @property
    def is_ready(self) -> bool:
        """Whether it was prepared before."""
        return isinstance(self.scan, PreparedScan)

    @property
    def whole(self) -> Scan:
        """The cloud before downsampling."""
        return self.scan.scan if isinstance(self.scan, PreparedScan) else self.scan

    @property
    def by_frames(self) -> bool:
        """Whether its normals are, or will be, to the side of SHOT's z axis."""
        return self.scan.by_frames if isinstance(self.scan, PreparedScan) else self.viewpoint is None


def as_given(
    name: str,
    cloud: PreparedScan | Scan | Cloud | AnyCloud,
    viewpoint: ArrayLike | None = None,
    *,
    or_stored: bool = False,
) -> Given:
    """Check a scan, prepared or not; without a given viewpoint, that of its file may be used."""
    if isinstance(cloud, PreparedScan):
        return Given(name, cloud, viewpoint)
    scan = as_surface(name, cloud)
    place = scan.stored_viewpoint if viewpoint is None and or_stored else viewpoint
    return Given(name, fill_between_rings(without_strays(scan)), place)


class Preparation(NamedTuple):
    """Preparation of all scans of a call, with the same voxel and radii."""

    voxel: float
    front: DenseFront
    threads: int | None

    def finish(
        self,
        given: Given,
        begin: Callable[[str], Any],
        *,
        by_frames: bool | None = None,
        with_descriptors: bool = True,
    ) -> PreparedScan:
        """Prepare a scan, unless it is prepared; with normals by SHOT's frames if a partner needs them."""
        turned, role = given.by_frames if by_frames is None else by_frames, f"{given.name} "
        if isinstance(given.scan, PreparedScan):
            ready = given.scan.turned_by_frames if turned else given.scan
        else:
            ready = self.prepare(given.scan, given.viewpoint, begin, by_frames=turned, role=role)
        if with_descriptors and "described" not in vars(ready):
            begin(f"{role}descriptors")
            _ = ready.described
        return ready

    def prepare(
        self,
        scan: Scan,
        viewpoint: ArrayLike | None,
        begin: Callable[[str], Any],
        *,
        by_frames: bool,
        role: str = "",
    ) -> PreparedScan:
        """Prepare a scan, with normals oriented by frames or by the viewpoint, or with its own."""
        scan = scan.sampled(self.voxel)
        eye = None if viewpoint is None else scan.viewpoint(viewpoint)
        voxels = self.thin(scan, begin, with_normals=not by_frames and eye is None, role=role)
        _check_most_voxels(scan, self.voxel, len(voxels))
        thinned = features.Cloud(voxels.points, name=scan.name)
        normals, frames = self.orient(scan, voxels, thinned, eye, begin, by_frames=by_frames, role=role)
        begin(f"{role}surface")
        parts = scan, self.front, self.voxel, eye, voxels, normals, None
        return assemble(*parts, by_frames, self.threads, frames)

    def thin(
        self, scan: Scan, begin: Callable[[str], Any], *, with_normals: bool = False, role: str = ""
    ) -> Voxels:
        """Downsample a scan to voxels, with its own normals if requested."""
        begin(f"{role}voxels")
        given = scan.normals if with_normals else None
        voxels = thin(scan.cloud, self.voxel, normals=given, threads=self.threads)
        _check_least_voxels(scan, self.voxel, len(voxels))
        return voxels

    def describe(
        self,
        scan: Scan,
        voxels: Voxels,
        eye: Viewpoint | None,
        begin: Callable[[str], Any],
        *,
        by_frames: bool,
        role: str = "",
    ) -> tuple[FloatArray, FloatArray, NDArray[np.float32]]:
        """Return normals, frames and FPFH of voxels: (M,3), (M,3,3), (M,33)."""
        thinned = features.Cloud(voxels.points, name=scan.name)
        normals, frames = self.orient(scan, voxels, thinned, eye, begin, by_frames=by_frames, role=role)
        begin(f"{role}descriptors")
        frames = self.find_frames(thinned) if frames is None else frames
        return normals, frames, self.describe_by_fpfh(thinned, normals)

    def orient(
        self,
        scan: Scan,
        voxels: Voxels,
        thinned: Cloud,
        eye: Viewpoint | None,
        begin: Callable[[str], Any],
        *,
        by_frames: bool,
        role: str,
    ) -> tuple[FloatArray, FloatArray | None]:
        """Return normals (M,3) of voxels, and frames (M,3,3) if these orient the normals."""
        begin(f"{role}normals")
        normals = features.normals(
            thinned,
            radius=self.front.normal_radius * self.voxel,
            neighbors=NORMAL_NEIGHBORS,
            viewpoint=scan.centroid if eye is None else eye,
            threads=self.threads,
        )
        _check_normals(scan, self.voxel, normals)
        frames = None
        outwards = voxels.normals
        if outwards is None and by_frames:
            begin(f"{role}frames")
            frames = self.find_frames(thinned)
            outwards = frames[:, 2]
        if outwards is not None:
            normals *= _signs(normals, outwards)[:, None]
        return normals, frames

    def find_frames(self, thinned: Cloud) -> FloatArray:
        """Return SHOT's frames of voxels, (M,3,3)."""
        radius = self.front.frame_radius * self.voxel
        return features.shot_lrf(thinned, np.arange(len(thinned)), radius=radius, threads=self.threads)

    def describe_by_fpfh(self, thinned: Cloud, normals: FloatArray) -> NDArray[np.float32]:
        """Return FPFH of voxels, (M,33)."""
        radius = self.front.support * self.voxel
        return features.fpfh(
            thinned, normals, radius=radius, max_neighbors=FEATURE_NEIGHBORS, threads=self.threads
        )


def agree(
    given: Sequence[Given], voxel: float | None, front: DenseFront | None, threads: int | None
) -> Preparation:
    """Return the common voxel and radii of all scans: of prepared scans, given, or chosen."""
    for one in given:
        if isinstance(one.scan, PreparedScan):
            _refuse_late_options(one.name, one.scan, one.viewpoint, front)
    check_sizes([one.whole for one in given])
    prepared = [one.scan for one in given if isinstance(one.scan, PreparedScan)]
    if prepared:
        return Preparation(_shared_voxel(prepared, voxel), prepared[0].front, threads)
    size = _choose_voxel([one.whole for one in given], voxel, threads)
    return Preparation(size, DenseFront() if front is None else front, threads)


def _refuse_late_options(
    name: str, scan: PreparedScan, viewpoint: ArrayLike | None, front: DenseFront | None
) -> None:
    """Raise `InputError` for options that belong to the preparation of a scan."""
    if viewpoint is not None and scan.scan.viewpoint(viewpoint) != scan.viewpoint:
        remedy = f"{name} is prepared, with viewpoint={scan.viewpoint}; prepare it anew"
        raise InputError(viewpoint_name(name), remedy=remedy)
    if front is not None and front != scan.front:
        raise InputError("front", f"{front}, but {name} is prepared, with {scan.front}", "prepare it anew")


def _shared_voxel(prepared: Sequence[PreparedScan], voxel: float | None) -> float:
    first = prepared[0]
    alike = all(scan.voxel == first.voxel and scan.front == first.front for scan in prepared)
    if alike and (voxel is None or as_length("voxel", voxel) == first.voxel):
        return first.voxel
    sizes = " and ".join(dict.fromkeys(f"{scan.voxel:.4g}" for scan in prepared))
    asked = "" if voxel is None else f", voxel={voxel}"
    raise InputError(
        "scans", remedy=f"prepared with voxels of {sizes}{asked}; prepare them with the same voxel and front"
    )


def _choose_voxel(scans: Sequence[Scan], voxel: float | None, threads: int | None) -> float:
    """Return the given voxel, or one that suits all scans, including the sparsest and the widest."""
    if voxel is not None:
        return as_length("voxel", voxel)
    few = min(len(scan.cloud) for scan in scans) < FEW_POINTS
    return suit_all(scans, _choose_by_number(scans, threads) * (_FINER_OF_FEW if few else 1.0), threads)


def suit_all(scans: Sequence[Scan], size: float, threads: int | None) -> float:
    """Return a voxel, or a larger one at which each cloud is a surface."""
    size = max(size, *(_least_voxel(scan) for scan in scans))
    for scan in sorted(scans, key=lambda scan: len(scan.cloud)):
        if len(scan.cloud) >= _SPARSE:
            break
        coarser = size
        while coarser < scan.diagonal / _LEAST_ACROSS and not _is_surface(scan, coarser, threads):
            coarser *= _COARSER
        if coarser < scan.diagonal / _LEAST_ACROSS:
            size = coarser
    return size


def _is_surface(scan: Scan, voxel: float, threads: int | None) -> bool:
    """Return whether most voxels of a cloud have enough neighbours for a plane fit."""
    voxels = thin(scan.cloud, voxel, threads=threads).points
    radius = DenseFront.normal_radius * voxel
    normals = features.normals(voxels, radius=radius, neighbors=NORMAL_NEIGHBORS, threads=threads)
    return float(np.isfinite(normals[:, 0]).mean()) >= _USUAL_PLANES


def _least_voxel(scan: Scan) -> float:
    """Return the voxel at which the bounding box of a scan has the maximum number of blocks of a surface."""
    points = scan.cloud.points
    sides = in_double(points.max(axis=0)) - in_double(points.min(axis=0))
    voxel = float(sides.max()) / _BLOCK / _MOST_ALONG
    while np.prod(np.floor(sides / (_BLOCK * voxel)) + 3) > _MOST_BLOCKS:
        voxel *= _COARSER
    return voxel


def _choose_by_number(scans: Sequence[Scan], threads: int | None) -> float:
    """Return the usual voxel of all scans, or a smaller one for the smallest scan."""

    def leave(count: int, *scans: Scan) -> float:
        return choose_thinning(*(scan.cloud for scan in scans), voxels=count, threads=threads)

    usual = leave(VOXELS, *scans)
    small, large = (choose(scans, key=lambda scan: scan.diagonal) for choose in (min, max))
    if large.diagonal < _SIZES_DIFFER * small.diagonal:
        return usual
    needed = leave(_LEAST_OF_EACH, small)
    for most in (MOST_VOXELS // 2, MOST_VOXELS):
        size = min(usual, max(needed, leave(most, large)))
        if len(thin(small.cloud, size, threads=threads)) >= LEAST_VOXELS:
            return size
    if len(thin(small.cloud, needed, threads=threads)) < LEAST_VOXELS:
        return size  # too few for any partner
    raise InputError(
        f"{small.name}, {large.name}",
        remedy=(
            f"{small.diagonal:.4g} and {large.diagonal:.4g} across, no voxel suits both; give "
            "the same unit, or cut the larger down to where the smaller may lie"
        ),
    )


def _check_least_voxels(scan: Scan, voxel: float, count: int) -> None:
    if count < FEW_VOXELS:
        finer = (
            ""
            if len(scan.cloud) < 1.5 * FEW_VOXELS
            else ", a smaller `voxel`, or both clouds in the same unit"
        )
        left = f"{_say_filled(scan, voxel, count)}; {FEW_VOXELS} are needed"
        raise InputError(scan.name, remedy=f"{left}: give more points{finer}")


def _check_most_voxels(scan: Scan, voxel: float, count: int) -> None:
    if count > MOST_VOXELS:
        left = f"{_say_filled(scan, voxel, count)}; {MOST_VOXELS} are allowed"
        raise InputError(scan.name, remedy=f"{left}: give a larger `voxel`")


def _say_filled(scan: Scan, voxel: float, count: int) -> str:
    voxels = "1 voxel" if count == 1 else f"{count} voxels"
    return f"{len(scan.cloud)} points, {scan.diagonal:.4g} across, fill {voxels} of size {voxel:.4g}"


def _check_normals(scan: Scan, voxel: float, normals: FloatArray) -> None:
    """Raise if a cloud is not a surface at the size of its voxels."""
    planes = int(np.isfinite(normals).all(axis=1).sum())
    if planes < max(LEAST_PLANES * len(normals), LEAST_PLANAR_VOXELS):
        raise InputError(
            scan.name,
            remedy=(
                f"{planes} of its {len(normals)} voxels of {voxel:.4g} have neighbours that fix a plane; the "
                "points lie too far apart for such voxels, or on a line: give a larger `voxel`, or a cloud "
                "of a surface"
            ),
        )


def _signs(normals: FloatArray, towards: FloatArray) -> FloatArray:
    return np.where(np.einsum("ij,ij->i", normals, towards) < 0, -1.0, 1.0)
