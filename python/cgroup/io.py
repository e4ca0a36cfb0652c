"""Files: point clouds, rigid transforms, correspondences.

Point clouds are parsed by trimesh (PLY, OBJ, STL, OFF) and pypcd4 (PCD); both come with the extra
``cgroup[scans]``. Whatever is wrong with a file ends in one `InputError` that names the file.
"""

from __future__ import annotations

import io
import warnings
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from cgroup._cloud_formats import PARSERS, CloudContent, load_npy, load_numbers
from cgroup.errors import InputError
from cgroup.features import DescribedCloud
from cgroup.types import OPTIONAL_FIELDS, Correspondences

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from cgroup.types import BoolArray, FloatArray, IndexArray

Result = TypeVar("Result")

RIGID_TOLERANCE = 1e-3
"""Largest deviation of R^T R from the identity in a transform file; such files carry few digits."""

_CORRESPONDENCE_COLUMNS = 6

_DESCRIBED_FIELDS = tuple(field.name for field in fields(DescribedCloud))

_CLOUD_COLOR = (190, 190, 190)
_KEYPOINT_COLOR = (213, 94, 0)


@dataclass(frozen=True, eq=False)
class PointCloud:
    """A scan or a model, as read from a file.

    Attributes
    ----------
    points : (N,3) array of float64
        Coordinates in the file's unit, all finite.
    normals : (N,3) array of float64, optional
        Normals as stored in the file.
    faces : (M,3) array of int, optional
        Triangles as rows of `points`.
    colors : (N,3) array of uint8, optional
        Red, green, blue.
    dropped : int
        Points of the file that were left out because a coordinate was NaN or infinite.
    """

    points: FloatArray
    normals: FloatArray | None = None
    faces: IndexArray | None = None
    colors: NDArray[np.uint8] | None = None
    dropped: int = 0

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.points)

    def transformed(self, transform: ArrayLike) -> PointCloud:
        """Move the cloud by a rigid transform.

        Parameters
        ----------
        transform : (4,4) array_like of float
            Applied to column vectors: p' = R p + t.

        Returns
        -------
        PointCloud
            Moved points and turned normals; faces and colours as they were.
        """
        matrix = check_rigid(transform)
        rotation, translation = matrix[:3, :3], matrix[:3, 3]
        normals = None if self.normals is None else self.normals @ rotation.T
        points = self.points @ rotation.T + translation
        return PointCloud(points, normals, self.faces, self.colors, self.dropped)


def read_cloud(path: str | os.PathLike[str]) -> PointCloud:
    """Read a point cloud or mesh.

    PLY and PCD (ASCII and binary, also compressed), OBJ, STL, OFF, NPY with an (N, 3) array, and
    text (``.xyz``, ``.txt``) with x y z in its first three columns. Points with a NaN or infinite
    coordinate, which range scanners write where they saw nothing, are left out and counted in
    `PointCloud.dropped`. STL and OBJ repeat the corners of their triangles: points of exactly
    equal coordinates are made one. Other formats are taken as they are, in the file's order.

    Parameters
    ----------
    path : path-like
        The suffix says the format.

    Returns
    -------
    PointCloud
        Points, and normals, faces and colours where the file has them.

    Raises
    ------
    InputError
        If the file is missing, unreadable, cut off, of an unknown format, or has no finite point.
    """
    path = Path(path)
    reader = PARSERS.get(path.suffix.lower())
    if reader is None:
        known = " ".join(sorted(PARSERS))
        message = f"{path}: unknown point cloud format {path.suffix!r}; known are {known}"
        raise InputError(message)
    return _finite_cloud(path, _parsed(path, reader))


def write_cloud(path: str | os.PathLike[str], cloud: PointCloud) -> None:
    """Write a point cloud as binary PLY, coordinates in double precision.

    Parameters
    ----------
    path : path-like
        Must end in ``.ply``.
    cloud : PointCloud
        Normals, faces and colours are written where there are any.

    Raises
    ------
    InputError
        If the suffix is another one, or the file can't be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".ply":
        message = f"{path}: point clouds are written as PLY; use a name that ends in .ply"
        raise InputError(message)
    columns: list[tuple[str, str, str, NDArray[Any]]] = [
        (name, "<f8", "double", cloud.points[:, i]) for i, name in enumerate("xyz")
    ]
    if cloud.normals is not None:
        names = ("nx", "ny", "nz")
        columns += [(n, "<f4", "float", cloud.normals[:, i]) for i, n in enumerate(names)]
    if cloud.colors is not None:
        names = ("red", "green", "blue")
        columns += [(n, "u1", "uchar", cloud.colors[:, i]) for i, n in enumerate(names)]
    vertices = np.empty(len(cloud), dtype=[(name, kind) for name, kind, _, _ in columns])
    for name, _, _, values in columns:
        vertices[name] = values
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(cloud)}"]
    header += [f"property {word} {name}" for name, _, word, _ in columns]
    triangles = b""
    if cloud.faces is not None:
        faces = np.empty(len(cloud.faces), dtype=[("count", "u1"), ("corners", "<i4", (3,))])
        faces["count"], faces["corners"] = 3, cloud.faces
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
        triangles = faces.tobytes()
    text = "\n".join([*header, "end_header", ""])
    write_file(path, text.encode() + vertices.tobytes() + triangles)


def check_rigid(transform: ArrayLike, name: str = "transform") -> FloatArray:
    """Accept a 4x4 rigid transform of column vectors.

    Parameters
    ----------
    transform : (4,4) array_like of float
        Rotation and translation.
    name : str
        What to call it in an error.

    Returns
    -------
    (4,4) array of float64
        The same numbers as float64.

    Raises
    ------
    InputError
        If the shape differs, a number isn't finite, the last row isn't 0 0 0 1, or the upper left
        3x3 block isn't a rotation to within `RIGID_TOLERANCE`.
    """
    matrix = np.asarray(transform, dtype=np.float64)
    if matrix.shape != (4, 4):
        message = f"{name}: got shape {matrix.shape}; a rigid transform is a 4x4 matrix"
        raise InputError(message)
    if not np.isfinite(matrix).all():
        message = f"{name}: holds a number that isn't finite"
        raise InputError(message)
    if not np.allclose(matrix[3], (0, 0, 0, 1), atol=1e-9):
        hint = "; transpose it" if np.allclose(matrix[:, 3], (0, 0, 0, 1), atol=1e-9) else ""
        message = f"{name}: last row is {matrix[3]}, not 0 0 0 1{hint}"
        raise InputError(message)
    rotation = matrix[:3, :3]
    deviation = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if deviation > RIGID_TOLERANCE or np.linalg.det(rotation) < 0:
        kind = "a reflection" if deviation <= RIGID_TOLERANCE else "scaled or sheared"
        message = f"{name}: its upper left 3x3 block is {kind}, not a rotation"
        raise InputError(message)
    return matrix


def read_transform(path: str | os.PathLike[str]) -> FloatArray:
    """Read a 4x4 rigid transform of column vectors.

    Parameters
    ----------
    path : path-like
        ``.npy``, or text of any suffix (``.txt``, ``.xf``): four rows of four numbers.

    Returns
    -------
    (4,4) array of float64
        The transform.

    Raises
    ------
    InputError
        If the file is missing or unreadable, or isn't a rigid transform.
    """
    path = Path(path)
    reader = load_npy if path.suffix.lower() == ".npy" else load_numbers
    return check_rigid(_parsed(path, reader), str(path))


def write_transform(path: str | os.PathLike[str], transform: ArrayLike) -> None:
    """Write a 4x4 rigid transform, exact to the last bit.

    Parameters
    ----------
    path : path-like
        ``.npy``, or text of any other suffix.
    transform : (4,4) array_like of float
        Rotation and translation.

    Raises
    ------
    InputError
        If it isn't rigid, or the file can't be written.
    """
    path = Path(path)
    matrix = check_rigid(transform)
    if path.suffix.lower() == ".npy":
        write_file(path, _npy_bytes(matrix))
    else:
        rows = (" ".join(repr(float(number)) for number in row) for row in matrix)
        write_file(path, ("\n".join(rows) + "\n").encode())


def read_correspondences(path: str | os.PathLike[str]) -> Correspondences:
    """Read correspondences that were computed elsewhere, or written by `write_correspondences`.

    Parameters
    ----------
    path : path-like
        ``.npz`` with arrays named as the fields of `Correspondences` (``source`` and ``target``
        are needed), or text with six columns: x y z of the source, x y z of the target.

    Returns
    -------
    Correspondences
        One row per match, in the file's order.

    Raises
    ------
    InputError
        If the file is missing or unreadable, or its content can't be correspondences.
    """
    path = Path(path)
    if path.suffix.lower() == ".npz":
        arrays = _arrays(path, "source", "target")
    else:
        table = _parsed(path, load_numbers)
        if table.shape[1] != _CORRESPONDENCE_COLUMNS:
            message = (
                f"{path}: has {table.shape[1]} columns; correspondences have six: "
                "x y z of the source, x y z of the target"
            )
            raise InputError(message)
        arrays = {"source": table[:, :3], "target": table[:, 3:]}
    optional: dict[str, Any] = {name: arrays[name] for name in OPTIONAL_FIELDS if name in arrays}
    if "resolution" in optional:
        optional["resolution"] = _number(path, optional["resolution"])
    try:
        return Correspondences(arrays["source"], arrays["target"], **optional)
    except InputError as error:
        message = f"{path}: {error}"
        raise InputError(message) from error


def write_correspondences(path: str | os.PathLike[str], correspondences: Correspondences) -> None:
    """Write correspondences with every field they have.

    Parameters
    ----------
    path : path-like
        Must end in ``.npz``.
    correspondences : Correspondences
        What to write.

    Raises
    ------
    InputError
        If the suffix is another one, or the file can't be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        message = f"{path}: correspondences are written as NPZ; use a name that ends in .npz"
        raise InputError(message)
    names = ("source", "target", *OPTIONAL_FIELDS)
    values = {name: getattr(correspondences, name) for name in names}
    write_file(path, _npz_bytes(**{name: value for name, value in values.items() if value is not None}))


def write_keypoints(path: str | os.PathLike[str], cloud: PointCloud, indices: ArrayLike) -> None:
    """Write the keypoints of a cloud.

    Parameters
    ----------
    path : path-like
        ``.npz`` with the arrays ``indices`` and ``points``, or ``.ply``: the whole cloud in grey, its
        keypoints in vermilion.
    cloud : PointCloud
        The whole cloud.
    indices : (m,) array_like of int
        Rows of the cloud.

    Raises
    ------
    InputError
        If the suffix is another one, or the file can't be written.
    """
    path, rows = Path(path), np.asarray(indices, dtype=np.int64)
    if path.suffix.lower() == ".npz":
        write_file(path, _npz_bytes(indices=rows, points=cloud.points[rows]))
        return
    colors = np.full((len(cloud), 3), _CLOUD_COLOR, dtype=np.uint8)
    colors[rows] = _KEYPOINT_COLOR
    write_cloud(path, PointCloud(cloud.points, cloud.normals, cloud.faces, colors))


def write_descriptors(path: str | os.PathLike[str], described: DescribedCloud) -> None:
    """Write described keypoints.

    Parameters
    ----------
    path : path-like
        Must end in ``.npz``; the arrays are named as the fields of `DescribedCloud`.
    described : DescribedCloud
        What to write.

    Raises
    ------
    InputError
        If the suffix is another one, or the file can't be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        message = f"{path}: descriptors are written as NPZ; use a name that ends in .npz"
        raise InputError(message)
    write_file(path, _npz_bytes(**{name: getattr(described, name) for name in _DESCRIBED_FIELDS}))


def read_descriptors(path: str | os.PathLike[str]) -> DescribedCloud:
    """Read described keypoints, as written by `write_descriptors`.

    Parameters
    ----------
    path : path-like
        NPZ.

    Returns
    -------
    DescribedCloud
        Exactly what was written.

    Raises
    ------
    InputError
        If the file is missing or unreadable, or lacks an array.
    """
    path = Path(path)
    arrays = _arrays(path, *_DESCRIBED_FIELDS)
    rows = {name: len(arrays[name]) for name in _DESCRIBED_FIELDS[:4]}
    if len(set(rows.values())) > 1:
        message = f"{path}: its arrays differ in length: {rows}"
        raise InputError(message)
    indices, points, lrf, descriptors, resolution, centroid = (arrays[name] for name in _DESCRIBED_FIELDS)
    return DescribedCloud(indices, points, lrf, descriptors, _number(path, resolution), centroid)


def write_mask(path: str | os.PathLike[str], mask: ArrayLike) -> None:
    """Write which correspondences belong to a group.

    Parameters
    ----------
    path : path-like
        ``.npy`` (bool), or text of any other suffix: one 0 or 1 per line.
    mask : (n,) array_like of bool
        Aligned with the correspondences.

    Raises
    ------
    InputError
        If the file can't be written.
    """
    path = Path(path)
    values = np.asarray(mask, dtype=bool)
    if path.suffix.lower() == ".npy":
        write_file(path, _npy_bytes(values))
    else:
        write_file(path, "".join(f"{int(value)}\n" for value in values).encode())


# --- files and parsers -----------------------------------------------------------------------


def write_file(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file, or raise `InputError` with the system's reason."""
    try:
        Path(path).write_bytes(content)
    except OSError as error:
        message = f"{path}: can't be written ({error.strerror or error})"
        raise InputError(message) from error


def _content(path: Path) -> bytes:
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        message = f"{path}: no such file"
    except IsADirectoryError:
        message = f"{path}: is a directory, not a file"
    except OSError as error:
        message = f"{path}: can't be read ({error.strerror or error})"
    else:
        if content:
            return content
        message = f"{path}: the file is empty"
    raise InputError(message) from None


def _parsed(path: Path, parse: Callable[[bytes], Result]) -> Result:
    """Parse the file; whatever a parser stumbles over becomes one error that names the file."""
    content = _content(path)
    try:
        with warnings.catch_warnings():
            # NumPy only warns where a line of numbers goes on with something else.
            warnings.filterwarnings("error", message="string or file could not be read")
            return parse(content)
    except ModuleNotFoundError as error:
        message = f"{path}: reading it needs {error.name}; pip install 'cgroup[scans]'"
        raise InputError(message) from error
    except MemoryError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        kind = path.suffix.lstrip(".").upper() or "text"
        message = f"{path}: not a readable {kind} file, or cut off ({reason})"
        raise InputError(message) from error


def _arrays(path: Path, *needed: str) -> dict[str, NDArray[Any]]:
    """Read an NPZ file that has to hold the arrays needed."""
    arrays = _parsed(path, _load_npz)
    missing = [name for name in needed if name not in arrays]
    if missing:
        found = ", ".join(sorted(arrays)) or "nothing"
        message = f"{path}: has no array {missing[0]!r}; it holds {found}"
        raise InputError(message)
    return arrays


def _finite_cloud(path: Path, content: CloudContent) -> PointCloud:
    """Leave out points that aren't finite, and the triangles that touch them."""
    points, normals, faces, colors = content
    if len(points) == 0:
        message = f"{path}: holds no points"
        raise InputError(message)
    keep: BoolArray = np.asarray(np.isfinite(points).all(axis=1))
    dropped = len(points) - int(np.count_nonzero(keep))
    if dropped == len(points):
        message = f"{path}: none of its {dropped} points is finite"
        raise InputError(message)
    if dropped == 0:
        return PointCloud(points, normals, faces, colors)
    if faces is not None:
        faces = (np.cumsum(keep) - 1)[faces[keep[faces].all(axis=1)]]
    normals = None if normals is None else normals[keep]
    colors = None if colors is None else colors[keep]
    return PointCloud(points[keep], normals, faces, colors, dropped)


def _number(path: Path, value: ArrayLike) -> float:
    array = np.asarray(value, dtype=np.float64)
    if array.size != 1:
        message = f"{path}: resolution has shape {array.shape}; it is a single number"
        raise InputError(message)
    return float(array.reshape(()))


def _npy_bytes(array: NDArray[Any]) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()


def _npz_bytes(**arrays: ArrayLike) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def _load_npz(content: bytes) -> dict[str, NDArray[Any]]:
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return dict(archive)
