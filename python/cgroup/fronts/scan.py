"""Checked and indexed clouds for registration, with their normals and faces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from cgroup import _core, features
from cgroup._checks.arrays import as_direction, as_faces, as_place, in_double, real_normals, real_points
from cgroup._checks.values import as_length, run_options
from cgroup._runtime.workers import cached_property
from cgroup.errors import InputError
from cgroup.features import Cloud, Viewpoint, sample_mesh
from cgroup.features.cloud import core_cloud
from cgroup.features.meshes import longest_edges
from cgroup.types import AnyCloud, FloatArray, IndexArray, PointCloud, RealArray
from cgroup.types.point_cloud import find_cloud

Normals: TypeAlias = Literal["pca", "mesh", "given"]
NORMALS: tuple[Normals, ...] = ("pca", "mesh", "given")

NEEDED_FOR = {"mesh": "faces", "given": "normals"}
NORMAL_NEIGHBORS = 20  # neighbours of a plane that is fitted to a whole cloud
# Clouds that differ more than this are taken to be in different units; no voxel suits both
MAX_SIZE_RATIO = 100.0
MAX_RANGE = 1000.0  # distance of the viewpoint in diagonals of the cloud, beyond which it can't be meant
FAR_AWAY = 50.0  # distance of a viewpoint of which the direction is known alone, in diagonals of the cloud
# Spacing of single precision, as a share of that of the points, beyond which their digits are lost
MOST_ROUNDED = 0.1
_LEAST_ROUNDED = 1e-6  # of the cloud's diagonal
# Length of a large face in mean spacings; share of the area in them, or vertices, that need samples
_LARGE, _LARGE_SHARE, _FEW_VERTICES = 4.0, 0.2, 2000
_MESH_SPACING = 0.5  # voxels between points on a large face


class ViewDirection(NamedTuple):
    """Viewing direction of a scanner, instead of its position."""

    x: float
    y: float
    z: float


def as_viewpoint(
    viewpoint: ArrayLike | None, view_direction: ArrayLike | None
) -> ArrayLike | ViewDirection | None:
    """Return the given position or direction of a scanner."""
    if view_direction is None:
        return viewpoint
    if viewpoint is not None:
        remedy = "give one: the scanner's place, or its direction"
        raise InputError("viewpoint, view_direction", remedy=remedy)
    return ViewDirection(*as_direction("view_direction", view_direction, "(0, 0, -1)").tolist())


def viewpoint_name(scan: str) -> str:
    """Return the name of the viewpoint parameter of a scan."""
    return f"{scan}_viewpoint" if scan in {"source", "target"} else "viewpoint"


def usable_normals(normals: Normals, *clouds: PointCloud) -> Normals:
    """Return `normals`, or "pca" if no cloud has the needed faces or normals."""
    if normals == "pca" or any(getattr(cloud, NEEDED_FOR[normals]) is not None for cloud in clouds):
        return normals
    return "pca"


@dataclass(frozen=True, eq=False)
class Scan:
    """A checked cloud, with the normals and faces of its file."""

    cloud: Cloud  # more than 20 points, all finite
    normals: FloatArray | None  # (N,3), as stored with the points
    faces: IndexArray | None  # (F,3), triangles as rows of the points
    name: str  # name in error messages
    given: RealArray  # (n,3), the points before outliers were removed and gaps were filled in
    outliers: int = 0  # number of removed outliers
    # (M,), first row of each distinct point among the `given`; None if no two coincide
    rows: IndexArray | None = None
    places: IndexArray | None = None  # (n,), distinct point of each of the `given`, likewise
    mesh: PointCloud | None = None  # the sampled mesh
    # spacing of single precision at points far from the origin, if the coordinates are such numbers and
    # the spacing is close to that of the points; else 0
    rounding: float = 0.0
    stored_viewpoint: list[float] | None = None  # position of the scanner from the file, if it is plausible

    @cached_property
    def centroid(self) -> FloatArray:
        """Mean of the points."""
        return core_cloud(self.cloud).center()

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the arrays; those of the compiled core are made again."""
        return {name: value for name, value in vars(self).items() if name != "core"}

    @cached_property
    def core(self) -> _core.Scan:
        """The cloud for the compiled core."""
        return _core.Scan(core_cloud(self.cloud), self.normals)

    @cached_property
    def axes(self) -> FloatArray:
        """Rotation into the cloud's own axes, (3,3)."""
        return core_cloud(self.cloud).own_axes()

    @cached_property
    def diagonal(self) -> float:
        """Diagonal of the box around the cloud along its own axes."""
        return core_cloud(self.cloud).own_diagonal()

    @property
    def repeats(self) -> int:
        """Number of removed points that repeat others."""
        return 0 if self.rows is None else len(self.given) - len(self.rows)

    def sampled(self, voxel: float) -> Scan:
        """Return the scan with the faces of its mesh, if any, sampled for a voxel."""
        if self.mesh is None:
            return self
        finer = as_scan(self.name, sample_mesh(self.mesh, spacing=_MESH_SPACING * voxel), distinct=True)
        if len(finer.cloud) <= len(self.cloud):
            return self
        return replace(self, cloud=finer.cloud, normals=finer.normals)

    def has(self, normals: Normals) -> bool:
        """Whether the cloud has the faces or normals that a choice needs."""
        return normals == "pca" or getattr(self, NEEDED_FOR[normals]) is not None

    def resolution(self, threads: int | None) -> float:
        """Return the unit pr of the cloud."""
        resolution = features.resolution(self.cloud, threads=threads)
        if resolution <= 0:
            raise InputError(self.name, remedy="all its points coincide with others")
        return resolution

    def unit(self, given: float | None, threads: int | None) -> float:
        """Return the unit pr: the one given, or that of the cloud."""
        if given is None:
            return self.resolution(threads)
        if as_length("resolution", given) > self.diagonal:
            large = f"{given}, but the whole cloud is {self.diagonal:.3g} across"
            raise InputError("resolution", large, "give it in the cloud's unit")
        return given

    def is_far(self, viewpoint: Viewpoint | None) -> bool:
        """Whether a viewpoint represents a direction."""
        away = 0.0 if viewpoint is None else float(np.linalg.norm(np.array(viewpoint) - self.centroid))
        return away > 0.9 * FAR_AWAY * self.diagonal

    def viewpoint(self, place: ArrayLike) -> Viewpoint:
        """Return the plausible position of the scanner, far away for a direction."""
        if isinstance(place, ViewDirection):
            x, y, z = (self.centroid - FAR_AWAY * self.diagonal * np.array(place)).tolist()
            return x, y, z
        name = viewpoint_name(self.name)
        x, y, z = as_place(name, place)
        away = self.distance([x, y, z])
        if away > MAX_RANGE * self.diagonal:
            far = f"({x:.4g}, {y:.4g}, {z:.4g}), {away:.3g} from a cloud that is {self.diagonal:.3g} across"
            raise InputError(name, far, "give the scanner's place in the cloud's frame and unit")
        return x, y, z

    def distance(self, place: list[float]) -> float:
        """Return the distance of a position from the cloud."""
        with np.errstate(over="ignore"):  # to infinity, which is too far
            return float(np.linalg.norm(np.array(place) - self.centroid))


def shows_layers(scan: Scan, viewpoint: Viewpoint, voxel: float) -> bool:
    """Return whether points occlude each other: the viewpoint is wrong, or the cloud is not a single scan.

    In a single scan, points of similar direction have nearly the same depth, except at edges.
    """
    return _core.shows_layers(core_cloud(scan.cloud), run_options(1), viewpoint, voxel)


def as_point_cloud(name: str, cloud: Cloud | AnyCloud) -> Cloud | AnyCloud:
    """Return a cloud of another library as `PointCloud`, others unchanged."""
    found = None if isinstance(cloud, Cloud) else find_cloud(name, cloud)
    return cloud if found is None else found


def as_scan(name: str, cloud: Scan | Cloud | AnyCloud, *, distinct: bool = False) -> Scan:
    """Check and index a cloud, unless it is indexed; with `distinct` each point counts once."""
    if isinstance(cloud, Scan):
        return replace(cloud, name=name)
    normals, faces = None, None
    cloud = as_point_cloud(name, cloud)
    if isinstance(cloud, PointCloud):
        points = real_points(name, cloud.points)
        normals, faces = _surface_of(name, cloud, len(points))
    else:
        points = cloud.points if isinstance(cloud, Cloud) else real_points(name, cloud)
    first, places = (_core.distinct_points(points) if distinct else None) or (None, None)
    rows = points if first is None else points[first]
    normals = normals if normals is None or first is None else normals[first]
    faces = faces if faces is None or places is None else places[faces]
    if len(rows) == 1 < len(points) and np.isfinite(rows).all():
        raise InputError(name, remedy="all its points coincide; give a cloud of a surface")
    ready = cloud if isinstance(cloud, Cloud) and first is None else Cloud(rows, name=name)
    if len(rows) <= NORMAL_NEIGHBORS:
        counted = "points" if first is None else "distinct points"
        raise InputError(name, f"{len(rows)} {counted}", f"descriptors need more than {NORMAL_NEIGHBORS}")
    rounding = _find_rounding(ready)
    scan = Scan(ready, normals, faces, name, points, rows=first, places=places, rounding=rounding)
    if not isinstance(cloud, PointCloud) or cloud.viewpoint is None:
        return scan
    place = as_place(f"{name}.viewpoint", cloud.viewpoint)
    is_plausible = scan.distance(place) <= MAX_RANGE * scan.diagonal
    return replace(scan, stored_viewpoint=place) if is_plausible else scan


def as_surface(name: str, cloud: Scan | Cloud | AnyCloud) -> Scan:
    """Check and index a cloud; sample a mesh whose vertices alone do not cover its surface."""
    cloud = cloud if isinstance(cloud, Scan) else as_point_cloud(name, cloud)
    if not isinstance(cloud, PointCloud) or cloud.faces is None or not _needs_samples(name, cloud):
        return as_scan(name, cloud, distinct=True)
    return _sampled(name, cloud)


def _sampled(name: str, mesh: PointCloud) -> Scan:
    points = real_points(name, mesh.points)
    _surface_of(name, mesh, len(points))
    scan = as_scan(name, replace(sample_mesh(mesh), viewpoint=mesh.viewpoint), distinct=True)
    return replace(scan, given=points, rows=None, places=None, mesh=mesh)


def _needs_samples(name: str, mesh: PointCloud) -> bool:
    """Return whether a mesh has few vertices, or vertices that miss much of its area."""
    points = in_double(real_points(name, mesh.points))
    faces = _surface_of(name, mesh, len(points))[1]
    if faces is None or len(faces) == 0:
        return False
    corners = points[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(across, axis=1) / 2
    used = np.zeros(len(points), dtype=bool)
    used[faces[areas > 0]] = True
    count = int(used.sum())
    if 2 * count < len(points) or count == 0:  # a cloud with some faces
        return False
    large = longest_edges(corners) > _LARGE * np.sqrt(areas.sum() / count)
    return count < _FEW_VERTICES or bool(areas[large].sum() > _LARGE_SHARE * areas.sum())


def _find_rounding(cloud: Cloud) -> float:
    """Return the spacing of single precision if it is too large for that of the points; else 0."""
    core = core_cloud(cloud)
    with np.errstate(over="ignore", invalid="ignore"):  # coordinates beyond single precision
        farthest = float(np.abs(core.center()).max()) + cloud.diagonal
        if not np.spacing(np.float32(farthest)) > _LEAST_ROUNDED * cloud.diagonal:
            return 0.0
        spacing = float(np.spacing(np.float32(max(cloud.points.max(), -cloud.points.min()))))
        if not spacing > _LEAST_ROUNDED * cloud.diagonal:
            return 0.0
        if (cloud.points.astype(np.float32) != cloud.points).any():
            return 0.0
    return spacing if spacing > MOST_ROUNDED * features.resolution(cloud) else 0.0


def without_outliers(scan: Scan) -> Scan:
    """Remove outliers: single points far from all others, unless they are many."""
    outliers = _core.find_outliers(core_cloud(scan.cloud), run_options(1))
    if len(outliers) == 0 or scan.faces is not None:
        return scan
    kept = np.delete(np.arange(len(scan.cloud)), outliers)
    normals = None if scan.normals is None else scan.normals[kept]
    cloud = Cloud(in_double(scan.cloud.points)[kept], name=scan.name)
    return replace(scan, cloud=cloud, normals=normals, outliers=len(outliers))


def fill_between_rings(scan: Scan) -> Scan:
    """Fill in the surface between the rings of a scanner with few beams; return other clouds unchanged."""
    if scan.faces is not None or scan.normals is not None:
        return scan
    filled = _core.fill_between_rings(core_cloud(scan.cloud), scan.cloud.points, run_options(1))
    if filled is None:
        return scan
    points, scanner = filled
    return replace(
        scan, cloud=Cloud(points, name=scan.name), stored_viewpoint=scan.stored_viewpoint or scanner
    )


def mirror_image(
    scan: Scan, viewpoint: Viewpoint | None, axis: FloatArray | None = None
) -> tuple[Scan, Viewpoint | None]:
    """Return the mirror image of a scan and of its viewpoint: no pose aligns it, but by chance.

    The plane of the mirror contains the axis, z by default, so that up stays up.
    """
    up = np.array([0.0, 0.0, 1.0]) if axis is None else axis
    across = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    mirror = np.eye(3) - 2 * np.outer(across, across) / (across @ across)
    points, mesh = in_double(scan.cloud.points) @ mirror, scan.mesh
    mirrored = replace(
        scan,
        cloud=Cloud(points, name=scan.name),
        given=points,
        normals=None if scan.normals is None else scan.normals @ mirror,
        mesh=None if mesh is None else replace(mesh, points=mesh.points @ mirror, normals=None),
    )
    if viewpoint is None:
        return mirrored, None
    x, y, z = (mirror @ viewpoint).tolist()
    return mirrored, (x, y, z)


def _surface_of(name: str, cloud: PointCloud, count: int) -> tuple[FloatArray | None, IndexArray | None]:
    normals = None if cloud.normals is None else in_double(real_normals(f"{name}.normals", cloud.normals))
    faces = None if cloud.faces is None else as_faces(f"{name}.faces", cloud.faces)
    if normals is not None and len(normals) != count:
        counts = f"{len(normals)} for {count} points"
        raise InputError(f"{name}.normals", counts, "give one per point, NaN for none")
    if faces is not None and faces.max(initial=-1) >= count:
        raise InputError(f"{name}.faces", f"row {faces.max()}, but there are {count} points")
    return normals, faces


def check_sizes(scans: Sequence[Scan]) -> None:
    """Raise for clouds in different units."""
    sizes = [scan.diagonal for scan in scans]
    if max(sizes) > MAX_SIZE_RATIO * min(sizes):
        one, other = (scans[row] for row in sorted([sizes.index(min(sizes)), sizes.index(max(sizes))]))
        across = f"{one.diagonal:.3g} and {other.diagonal:.3g} across"
        remedy = f"{across}; scale them to the same unit, or drop points far from all others"
        raise InputError(f"{one.name}, {other.name}", remedy=remedy)


def as_model(name: str, cloud: Cloud | AnyCloud, normals: Normals) -> Scan:
    """Check a complete model with normals or faces that define its outside."""
    cloud = as_point_cloud(name, cloud)
    if not isinstance(cloud, PointCloud) or getattr(cloud, NEEDED_FOR[normals]) is None:
        lacking = f"no {NEEDED_FOR[normals]}, which show the outside of a model"
        raise InputError(name, lacking, "give a `PointCloud` with them, or another library's cloud or mesh")
    return as_scan(name, cloud, distinct=True) if normals == "given" else _sampled(name, cloud)
