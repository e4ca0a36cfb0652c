"""Files: point clouds, rigid transforms, correspondences.

Point clouds are parsed by trimesh (PLY, OBJ, STL, OFF) and pypcd4 (PCD); both come with the extra
``cgroup[scans]``. Whatever is wrong with a file ends in one
`InputError` that names the file.
"""

from __future__ import annotations

import io
import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from cgroup.errors import InputError
from cgroup.types import Correspondences

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from cgroup.types import FloatArray, IndexArray

Result = TypeVar("Result")

RIGID_TOLERANCE = 1e-3
"""Largest deviation of R^T R from the identity in a transform file; such files carry few digits."""

_CORRESPONDENCE_COLUMNS = 6
_OPTIONAL_FIELDS = (
    "similarity",
    "ratio",
    "source_lrf",
    "target_lrf",
    "resolution",
    "source_centroid",
)


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
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        known = " ".join(sorted(_READERS))
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
    reader = _load_npy if path.suffix.lower() == ".npy" else _load_numbers
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
        fields = _parsed(path, _load_npz)
        missing = [name for name in ("source", "target") if name not in fields]
        if missing:
            found = ", ".join(sorted(fields)) or "nothing"
            message = f"{path}: has no array {missing[0]!r}; it holds {found}"
            raise InputError(message)
    else:
        table = _parsed(path, _load_numbers)
        if table.shape[1] != _CORRESPONDENCE_COLUMNS:
            message = (
                f"{path}: has {table.shape[1]} columns; correspondences have six: "
                "x y z of the source, x y z of the target"
            )
            raise InputError(message)
        fields = {"source": table[:, :3], "target": table[:, 3:]}
    optional = {name: fields[name] for name in _OPTIONAL_FIELDS if name in fields}
    if "resolution" in optional:
        optional["resolution"] = _number(path, optional["resolution"])
    try:
        return Correspondences(fields["source"], fields["target"], **optional)
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
    names = ("source", "target", *_OPTIONAL_FIELDS)
    values = {name: getattr(correspondences, name) for name in names}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **{k: v for k, v in values.items() if v is not None})
    write_file(path, buffer.getvalue())


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


def _finite_cloud(path: Path, cloud: PointCloud) -> PointCloud:
    """Leave out points that aren't finite, and the triangles that touch them."""
    if len(cloud) == 0:
        message = f"{path}: holds no points"
        raise InputError(message)
    keep = np.isfinite(cloud.points).all(axis=1)
    dropped = len(keep) - int(keep.sum())
    if dropped == len(keep):
        message = f"{path}: none of its {len(keep)} points is finite"
        raise InputError(message)
    if dropped == 0:
        return cloud
    faces = cloud.faces
    if faces is not None:
        faces = (np.cumsum(keep) - 1)[faces[keep[faces].all(axis=1)]]
    return PointCloud(
        cloud.points[keep],
        None if cloud.normals is None else cloud.normals[keep],
        faces,
        None if cloud.colors is None else cloud.colors[keep],
        dropped,
    )


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


def _load_npy(content: bytes) -> NDArray[Any]:
    return np.load(io.BytesIO(content), allow_pickle=False)


def _load_npz(content: bytes) -> dict[str, NDArray[Any]]:
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return dict(archive)


def _load_numbers(content: bytes) -> FloatArray:
    """Rows of numbers, separated by white space, commas or semicolons; # and // start comments."""
    text = re.sub("[,;]", " ", content.decode())
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*input contained no data")
        return np.loadtxt(io.StringIO(text), dtype=np.float64, comments=("#", "//"), ndmin=2)


def _points(array: ArrayLike) -> FloatArray:
    points = np.asarray(array, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        message = f"points have shape {points.shape} instead of (N, 3)"
        raise ValueError(message)
    return points


def _read_text(content: bytes) -> PointCloud:
    return PointCloud(_points(_load_numbers(content)[:, :3]))


def _read_npy(content: bytes) -> PointCloud:
    return PointCloud(_points(_load_npy(content)))


def _read_ply(content: bytes) -> PointCloud:
    from trimesh.exchange.ply import load_ply  # noqa: PLC0415 - slow to load

    loaded = load_ply(io.BytesIO(content), fix_texture=False, skip_materials=True)
    elements = loaded["metadata"]["_ply_raw"]
    for name in ("vertex", "face"):
        declared = elements.get(name, {}).get("length", 0)
        found = _rows(elements[name].get("data")) if declared else 0
        if found != declared:
            message = f"{name} {found} of {declared} is the last"
            raise ValueError(message)
    return _from_trimesh(loaded)


def _rows(data: Any) -> int:  # noqa: ANN401 - an array, or one per column
    columns = list(data.values()) if isinstance(data, dict) else [data]
    return min((len(column) for column in columns if column is not None), default=0)


def _read_off(content: bytes) -> PointCloud:
    from trimesh.exchange.off import load_off  # noqa: PLC0415 - slow to load

    return _from_trimesh(load_off(io.BytesIO(content)))


def _read_obj(content: bytes) -> PointCloud:
    from trimesh.exchange.obj import load_obj  # noqa: PLC0415 - slow to load

    loaded = load_obj(io.BytesIO(content), skip_materials=True, group_material=False, maintain_order=True)
    parts = [_from_trimesh(part) for part in loaded.get("geometry", {"": loaded}).values()]
    if not parts:
        return PointCloud(np.empty((0, 3)))
    starts = np.cumsum([0, *(len(part) for part in parts)])
    faces = [p.faces + i for p, i in zip(parts, starts, strict=False) if p.faces is not None]
    points = np.concatenate([part.points for part in parts])
    return _without_repeats(PointCloud(points, faces=np.concatenate(faces) if faces else None))


def _read_stl(content: bytes) -> PointCloud:
    from trimesh.exchange.stl import load_stl  # noqa: PLC0415 - slow to load

    if b"facet normal" in content[:1000] and b"endsolid" not in content[-1000:]:
        message = "no endsolid at its end"
        raise ValueError(message)
    return _without_repeats(_from_trimesh(load_stl(io.BytesIO(content))))


def _from_trimesh(loaded: dict[str, Any]) -> PointCloud:
    """Take over what a trimesh loader found."""
    points = _points(loaded.get("vertices", np.empty((0, 3))))
    normals, faces, colors = (loaded.get(k) for k in ("vertex_normals", "faces", "vertex_colors"))
    if faces is not None and len(faces):
        faces = np.asarray(faces, dtype=np.int64)
        if faces.min() < 0 or faces.max() >= len(points):
            message = f"a face names point {faces.max()}, there are {len(points)}"
            raise ValueError(message)
    return PointCloud(
        points,
        None if normals is None else _points(normals),
        None if faces is None or len(faces) == 0 else faces,
        None if colors is None else np.asarray(colors)[:, :3].astype(np.uint8),
    )


def _without_repeats(cloud: PointCloud) -> PointCloud:
    """Points of equal coordinates made one, in order of first appearance."""
    _, first, inverse = np.unique(cloud.points, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    keep = first[order]
    return PointCloud(
        cloud.points[keep],
        None,
        None if cloud.faces is None else rank[inverse.reshape(-1)][cloud.faces],
        None if cloud.colors is None else cloud.colors[keep],
    )


def _read_pcd(content: bytes) -> PointCloud:
    import pypcd4  # noqa: PLC0415 - slow to load

    loaded = pypcd4.PointCloud.from_fileobj(io.BytesIO(_modern_pcd(content)))  # pyright: ignore[reportArgumentType]
    data = loaded.pc_data
    if len(data) != loaded.points:
        message = f"{len(data)} of {loaded.points} points"
        raise ValueError(message)

    def columns(*names: str) -> FloatArray | None:
        if not set(names) <= set(loaded.fields):
            return None
        return np.stack([np.asarray(data[name], dtype=np.float64) for name in names], axis=1)

    points = columns("x", "y", "z")
    if points is None:
        message = f"its fields are {' '.join(loaded.fields)}, not x y z"
        raise ValueError(message)
    packed = next((name for name in ("rgb", "rgba") if name in loaded.fields), None)
    colors = None if packed is None else _unpacked(np.ascontiguousarray(data[packed]))
    return PointCloud(points, columns("normal_x", "normal_y", "normal_z"), None, colors)


def _modern_pcd(content: bytes) -> bytes:
    """Rewrite the file as PCD 0.7 with every header line there: PCL still reads 0.5 and 0.6."""
    match = re.search(rb"^DATA[ \t]+(\w+)[ \t]*\r?\n", content, re.MULTILINE)
    if match is None:
        message = "its header has no DATA line"
        raise ValueError(message)
    lines = content[: match.start()].decode().splitlines()
    words = [line.split() for line in lines if line.strip() and not line.startswith("#")]
    header = {key.upper(): values for key, *values in words}
    fields = header.get("FIELDS", header.get("COLUMNS", []))
    header |= {"VERSION": ["0.7"], "FIELDS": fields}
    header.setdefault("COUNT", ["1"] * len(fields))
    header.setdefault("HEIGHT", ["1"])
    header.setdefault("POINTS", [str(int(header["WIDTH"][0]) * int(header["HEIGHT"][0]))])
    order = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "POINTS")
    text = "".join(f"{key} {' '.join(header[key])}\n" for key in order)
    body = content[match.end() :]
    if match[1].lower() == b"ascii":  # pypcd4 takes exactly one blank between two numbers
        body = b"\n".join(b" ".join(line.split()) for line in body.splitlines())
    return text.encode() + b"DATA " + match[1].lower() + b"\n" + body


def _unpacked(packed: NDArray[Any]) -> NDArray[np.uint8]:
    """PCL packs 0x00RRGGBB into four bytes, often called a float."""
    bits = packed.view(np.uint32) if packed.dtype.itemsize == 4 else packed.astype(np.uint32)
    return np.stack([bits >> 16 & 255, bits >> 8 & 255, bits & 255], axis=1).astype(np.uint8)


_READERS: dict[str, Callable[[bytes], PointCloud]] = {
    ".npy": _read_npy,
    ".obj": _read_obj,
    ".off": _read_off,
    ".pcd": _read_pcd,
    ".ply": _read_ply,
    ".stl": _read_stl,
    ".txt": _read_text,
    ".xyz": _read_text,
}
