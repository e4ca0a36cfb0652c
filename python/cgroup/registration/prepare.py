"""Prepare scans: voxels of one size, with normals on one side, descriptors and a surface."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from numpy.typing import ArrayLike

from cgroup import _core
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_choice, as_instance, as_length, run_options
from cgroup._runtime.memory import report_refused_memory
from cgroup._runtime.progress import as_stage_function
from cgroup._runtime.workers import cached_property
from cgroup.errors import InputError
from cgroup.features import Cloud, DescribedCloud, Viewpoint
from cgroup.features.cloud import core_cloud
from cgroup.features.voxels import thin
from cgroup.fronts.scan import (
    NORMALS,
    Normals,
    Scan,
    as_model,
    as_surface,
    as_viewpoint,
    check_sizes,
    fill_between_rings,
    shows_layers,
    viewpoint_name,
    without_outliers,
)
from cgroup.types import AnyCloud, FloatArray
from cgroup.verification import FineSurface, Surface

UNIT = 0.4  # unit of the surfaces and of the matches, in voxels
VOXELS = 5000  # voxels that a cloud is thinned to, about
LEAST_VOXELS = 100  # voxels below which unrelated clouds fit each other too well by chance
MOST_VOXELS = 100_000  # voxels beyond which matching each with all others takes more than some 20 seconds
FEW_VOXELS = 20  # voxels below which a cloud is no surface
NORMAL_NEIGHBORS = 30  # most neighbours of a voxel's plane
PREPARED = 1  # row of the prepared voxel among those of a search
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


USUAL = DenseFront()


@dataclass(frozen=True, eq=False)
class PreparedScan:
    """A scan prepared for registration by `prepare`.

    It has levels from coarse to fine voxels, each computed when it is first needed: voxels, normals,
    descriptors and surfaces. `len` is the number of voxels.

    Attributes
    ----------
    scan : Scan
        The whole cloud.
    front : DenseFront
        Radii, in voxels.
    voxel : float
        Edge length of the finest voxels that a search of normal effort uses, in the unit of the points.
    viewpoint : (float, float, float) or None
        Position of the scanner, if known.
    by_frames : bool
        Whether normals are to the side of SHOT's z axis.
    threads : int or None
        Number of threads.
    core : _core.Prepared
        The levels.
    """

    scan: Scan
    front: DenseFront
    voxel: float
    viewpoint: Viewpoint | None
    by_frames: bool
    threads: int | None
    core: _core.Prepared
    _fine_surfaces: dict[float, FineSurface | None] = field(default_factory=dict)
    _thinned: dict[float, FloatArray] = field(default_factory=dict)

    def __reduce__(self) -> tuple[Callable[..., PreparedScan], tuple[Any, ...]]:
        """Pickle the cloud; the levels are computed again."""
        return assemble, (self.scan, self.front, self.voxel, self.viewpoint, self.by_frames, self.threads)

    @cached_property
    def level(self) -> _core.Level:
        """The finest level of a search of normal effort.

        :meta private:
        """
        level, refusal = self.core.level(PREPARED, run_options(self.threads))
        if level is None:
            raise refused(self.scan, self.voxel, refusal)
        return level

    def begin(self) -> PreparedScan:
        """Compute the level that a search begins with; raise if there is none.

        :meta private:
        """
        refusal = self.core.begin(run_options(self.threads))
        if refusal is not None:
            raise refused(self.scan, self.voxel, refusal)
        return self

    @cached_property
    def points(self) -> FloatArray:
        """Mean point of each voxel, (M,3)."""
        return self.level.points

    @cached_property
    def normals(self) -> FloatArray:
        """Normals of the voxels, (M,3), NaN for none.

        Outwards for a model, towards the viewpoint if those of both scans are known, else to the side of
        SHOT's z axis.
        """
        return self.level.normals

    @cached_property
    def surface(self) -> Surface:
        """The surface of the voxels, of unit 0.4 voxel."""
        return Surface.of_core(self.level.surface, UNIT * self.voxel)

    @cached_property
    def described(self) -> DescribedCloud:
        """Frames and FPFH of the voxels that have them.

        `DescribedCloud.indices` are rows of the voxels.
        """
        rows, frames, values = self.level.described(run_options(self.threads))
        return DescribedCloud(rows, self.points[rows], frames, values, UNIT * self.voxel, self.scan.centroid)

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
        return assemble(self.scan, self.front, self.voxel, self.viewpoint, True, self.threads)  # noqa: FBT003 - as pickle

    @cached_property
    def shows_layers(self) -> bool:
        """Whether points occlude each other from the viewpoint; in a single scan none do.

        :meta private:
        """
        return self.viewpoint is not None and shows_layers(self.scan, self.viewpoint, self.voxel)

    def __len__(self) -> int:
        """Return the number of voxels."""
        return len(self.level)

    def __repr__(self) -> str:
        return f"PreparedScan(points={len(self.scan.cloud)}, voxel={self.voxel:.4g})"


def assemble(
    scan: Scan,
    front: DenseFront,
    voxel: float,
    viewpoint: Viewpoint | None,
    by_frames: bool,  # noqa: FBT001 - pickle calls it by position
    threads: int | None,
    most: int = MOST_VOXELS,
) -> PreparedScan:
    """Prepare a scan; no level is computed yet."""
    radii = front.normal_radius, front.support, front.frame_radius
    core = _core.Prepared(scan.core, voxel, radii, viewpoint, by_frames, most)
    return PreparedScan(scan, front, voxel, viewpoint, by_frames, threads, core)


def refused(scan: Scan, voxel: float, refusal: tuple[str, int, int] | None) -> InputError:
    """Return the error for a scan without a level."""
    kind, count, total = refusal or ("few", 0, 0)
    if kind == "not planar":
        return InputError(
            scan.name,
            remedy=(
                f"{count} of its {total} voxels of {voxel:.4g} have neighbours that fix a plane; the "
                "points lie too far apart for such voxels, or on a line: give a larger `voxel`, or a cloud "
                "of a surface"
            ),
        )
    voxels = "1 voxel" if count == 1 else f"{count} voxels"
    left = f"{len(scan.cloud)} points, {scan.diagonal:.4g} across, fill {voxels} of size {voxel:.4g}"
    if kind == "many":
        return InputError(scan.name, remedy=f"{left}; {MOST_VOXELS} are allowed: give a larger `voxel`")
    finer = ", a smaller `voxel`, or both clouds in the same unit"
    finer = "" if len(scan.cloud) < 1.5 * FEW_VOXELS else finer
    return InputError(scan.name, remedy=f"{left}; {FEW_VOXELS} are needed: give more points{finer}")


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
        With the level that a search begins with; finer ones are computed when they are first needed.

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
        scan = fill_between_rings(without_outliers(as_surface("cloud", cloud)))
        viewpoint = scan.stored_viewpoint if viewpoint is None else viewpoint
    else:
        scan = as_model("cloud", cloud, normals)
    radii = USUAL if front is None else as_instance("front", front, DenseFront)
    shared = Preparation(_choose_voxel([scan], voxel, threads), radii, threads)
    begin = as_stage_function(progress)
    begin("levels")
    made = shared.prepare(scan, viewpoint, by_frames=viewpoint is None and normals == "pca")
    _ = made.level  # raises if it is not a surface
    return made.begin()


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
    scan = fill_between_rings(without_outliers(as_surface(name, cloud)))
    return Given(name, scan, scan.stored_viewpoint if viewpoint is None and or_stored else viewpoint)


class Preparation(NamedTuple):
    """Preparation of all scans of a call, with the same voxel and radii."""

    voxel: float
    front: DenseFront
    threads: int | None

    def finish(self, given: Given, *, by_frames: bool | None = None) -> PreparedScan:
        """Prepare a scan, unless it is prepared; with normals by SHOT's frames if a partner needs them."""
        turned = given.by_frames if by_frames is None else by_frames
        if isinstance(given.scan, PreparedScan):
            return given.scan.turned_by_frames if turned else given.scan
        return self.prepare(given.scan, given.viewpoint, by_frames=turned)

    def prepare(
        self, scan: Scan, viewpoint: ArrayLike | None, *, by_frames: bool, most: int = MOST_VOXELS
    ) -> PreparedScan:
        """Prepare a scan, with normals oriented by frames or by the viewpoint, or with its own."""
        scan = scan.sampled(self.voxel)
        eye = None if viewpoint is None else scan.viewpoint(viewpoint)
        return assemble(scan, self.front, self.voxel, eye, by_frames, self.threads, most)


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
    return Preparation(size, USUAL if front is None else front, threads)


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
    size, unlike = _core.suit_voxel([core_cloud(scan.cloud) for scan in scans], run_options(threads))
    if size is not None:
        return size
    small, large = (scans[row] for row in unlike or (0, 0))
    raise InputError(
        f"{small.name}, {large.name}",
        remedy=(
            f"{small.diagonal:.4g} and {large.diagonal:.4g} across, no voxel suits both; give "
            "the same unit, or cut the larger down to where the smaller may lie"
        ),
    )
