"""A cloud as the pipeline takes it: checked and indexed once, with the normals or faces it came with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from cgroup import features
from cgroup._checks.arrays import as_faces, as_points, real_points
from cgroup._checks.values import as_length
from cgroup.errors import InputError
from cgroup.features import Cloud
from cgroup.types import PointCloud, find_cloud

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.types import FloatArray, IndexArray

Normals: TypeAlias = Literal["pca", "mesh", "given"]
NORMALS: tuple[Normals, ...] = ("pca", "mesh", "given")

NORMAL_NEIGHBORS = 20

NEEDED_FOR = {"mesh": "faces", "given": "normals"}


def usable_normals(normals: Normals, *clouds: PointCloud) -> Normals:
    """Return `normals`, or "pca" where no cloud has what they need."""
    if normals == "pca" or any(getattr(cloud, NEEDED_FOR[normals]) is not None for cloud in clouds):
        return normals
    return "pca"


@dataclass(frozen=True, eq=False)
class Scan:
    """A cloud that is ready, and what its file says of the surface.

    Attributes
    ----------
    cloud : Cloud
        More than 20 points, all finite.
    normals : (N,3) array of float64 or None
        As stored with the points.
    faces : (F,3) array of int or None
        Triangles as rows of the points.
    name : str
        What error messages call it.
    """

    cloud: Cloud
    normals: FloatArray | None
    faces: IndexArray | None
    name: str

    def has(self, normals: Normals) -> bool:
        """Whether the cloud has what such normals need."""
        return normals == "pca" or getattr(self, NEEDED_FOR[normals]) is not None

    def resolution(self, threads: int | None) -> float:
        """Return the unit pr of the cloud."""
        resolution = features.resolution(self.cloud, threads=threads)
        if resolution <= 0:
            message = f"{self.name}: all its points coincide with others"
            raise InputError(message)
        return resolution

    def unit(self, given: float | None, threads: int | None) -> float:
        """Return the unit pr: the one given, or that of the cloud."""
        if given is None:
            return self.resolution(threads)
        if as_length("resolution", given) > self.cloud.diagonal:
            message = (
                f"resolution: got {given}, but the whole cloud is {self.cloud.diagonal:.3g} across; "
                "give it in the cloud's unit"
            )
            raise InputError(message)
        return given


def as_point_cloud(name: str, cloud: PointCloud | Cloud | ArrayLike) -> PointCloud | Cloud | ArrayLike:
    """Return a cloud of another library as `PointCloud`, with its normals and faces; others as they are."""
    found = None if isinstance(cloud, Cloud) else find_cloud(name, cloud)
    return cloud if found is None else found


def as_scan(name: str, cloud: PointCloud | Cloud | ArrayLike) -> Scan:
    """Check a cloud, and make it ready."""
    normals, faces = None, None
    cloud = as_point_cloud(name, cloud)
    if isinstance(cloud, PointCloud):
        normals, faces = _surface_of(name, cloud)
        cloud = cloud.points
    points = cloud.points if isinstance(cloud, Cloud) else real_points(name, cloud)
    if len(points) <= NORMAL_NEIGHBORS:
        message = f"{name}: got {len(points)} points; descriptors need more than {NORMAL_NEIGHBORS}"
        raise InputError(message)
    ready = cloud if isinstance(cloud, Cloud) else Cloud(points, name=name)
    if ready.diagonal == 0:
        message = f"{name}: all its points coincide; give a cloud of a surface"
        raise InputError(message)
    return Scan(ready, normals, faces, name)


def _surface_of(name: str, cloud: PointCloud) -> tuple[FloatArray | None, IndexArray | None]:
    """Check the normals and faces of a cloud."""
    normals = None if cloud.normals is None else as_points(f"{name}.normals", cloud.normals)
    faces = None if cloud.faces is None else as_faces(f"{name}.faces", cloud.faces)
    count = len(real_points(name, cloud.points))
    if normals is not None and len(normals) != count:
        message = f"{name}.normals: got {len(normals)} for {count} points; give one per point, NaN for none"
        raise InputError(message)
    if faces is not None and faces.max(initial=-1) >= count:
        message = f"{name}.faces: got row {faces.max()}, but there are {count} points"
        raise InputError(message)
    return normals, faces
