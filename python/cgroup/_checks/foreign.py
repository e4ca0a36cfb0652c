"""Recognize paths of files, and clouds and arrays of other libraries by duck typing without imports.

Each reader looks for the attributes of one kind of object and returns its parts unchanged; the caller checks
them like any other array. NumPy gets an object that no reader knows.
"""

import os
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from cgroup._checks.calls import call_hook
from cgroup._checks.quoting import escape
from cgroup.errors import InputError

ACCEPTED = (
    "give (n,3) real numbers: an array, a tensor, a data frame with columns x, y, z, a cloud or mesh of "
    "Open3D, small_gicp, trimesh, PyVista, laspy or ROS, or the path of a file"
)


class CloudParts(NamedTuple):
    """Unchecked parts of a foreign cloud: (n,3) points, normals, triangles as rows of the points."""

    points: Any
    normals: Any = None
    faces: Any = None
    colors: Any = None
    viewpoint: Any = None
    intensities: Any = None


def cloud_parts(name: str, value: Any) -> CloudParts | None:  # noqa: ANN401 - whatever is passed
    """Return the parts of another library's cloud, or of a file; None for arrays, lists and other objects."""
    if isinstance(value, np.ndarray):
        fields = value.dtype.names
        return None if fields is None else _parts_of_columns(name, fields, value.__getitem__)
    if isinstance(value, list | tuple | bytes | int | float | type):
        return None
    if isinstance(value, str | os.PathLike):
        try:
            cloud = call_hook("cloud", value)
        except InputError as error:
            raise InputError(name, remedy=escape(str(error))) from error
        return CloudParts(*(getattr(cloud, name) for name in CloudParts._fields))
    for read in _READERS:
        try:
            parts = read(name, value)
        except (InputError, MemoryError):
            raise
        except Exception:  # noqa: BLE001, S112 - attributes may raise anything; NumPy is tried last
            continue
        if parts is not None:
            return parts
    return None


def as_host_array(name: str, value: Any) -> Any:  # noqa: ANN401 - whatever is passed
    """Return the array of a tensor in main memory; anything else unchanged."""
    if not (callable(getattr(value, "cpu", None)) and callable(getattr(value, "numpy", None))):
        only_dlpack = hasattr(value, "__dlpack__") and not hasattr(value, "__array__")
        return np.from_dlpack(value) if only_dlpack else value
    device = str(getattr(value, "device", "cpu"))
    if "cpu" not in device.casefold():
        got = f"a {type(value).__name__} on {device}"
        raise InputError(name, got, "copy it to the computer's memory: .cpu()")
    for step in ("detach", "resolve_conj", "resolve_neg"):
        value = getattr(value, step, lambda same=value: same)()
    # NumPy has no such numbers; single precision holds them all.
    return (value.float() if "bfloat16" in str(getattr(value, "dtype", "")) else value).numpy()


def _parts_of_columns(name: str, columns: Iterable[Any], column: Callable[[Any], Any]) -> CloudParts:
    """Return the points, and the normals and intensities if any, from named columns."""
    keys = list(columns)
    named: dict[str, list[Any]] = {}
    for key in keys:
        named.setdefault(str(key).strip(" /#").casefold(), []).append(key)

    def find(wanted: tuple[str, str, str]) -> Any:  # noqa: ANN401 - of a library's own kind
        if not all(each in named for each in wanted):
            return None
        for each in wanted:
            if len(named[each]) > 1:
                raise InputError(name, f"several columns called {each!r}", "keep one of them")
        return _stack([column(named[each][0]) for each in wanted])

    points = find(("x", "y", "z"))
    if points is None and len(keys) == 3:
        points = _stack([column(key) for key in keys])
    if points is None:
        shown = ", ".join(str(key) for key in keys[:8]) + (", ..." if len(keys) > 8 else "")
        raise InputError(name, f"columns {shown}", "call three of them x, y and z, or give these three alone")
    normals = find(("nx", "ny", "nz"))
    normals = find(("normal_x", "normal_y", "normal_z")) if normals is None else normals
    strengths = [column(each) for name in ("intensity", "scalar_intensity") for each in named.get(name, ())]
    given = _stack(strengths[:1]) if strengths else None
    return CloudParts(points, normals, intensities=_intensities(given, len(points)))


def _intensities(values: Any, count: int) -> Any:  # noqa: ANN401
    """Return intensities (N,) of float32; None if the values are not one real number per point."""
    given = np.asarray(as_host_array("intensities", values))
    if given.dtype.kind not in "biuf" or given.size != count:
        return None
    with np.errstate(over="ignore"):
        return given.reshape(-1).astype(np.float32)


def _stack(columns: list[Any]) -> Any:  # noqa: ANN401 - checked by the caller
    arrays = [each.to_numpy() if hasattr(each, "to_numpy") else np.asarray(each) for each in columns]
    return np.stack(arrays, axis=1)


def _read_table(name: str, value: Any) -> CloudParts | None:  # noqa: ANN401
    """pandas, polars, pyarrow."""
    if not (hasattr(value, "__getitem__") and hasattr(value, "__len__")):
        return None
    columns = getattr(value, "column_names", None)
    columns = getattr(value, "columns", None) if columns is None else columns
    if columns is None:
        return None
    return _parts_of_columns(name, columns, value.__getitem__)


def _read_tensor_cloud(_name: str, value: Any) -> CloudParts | None:  # noqa: ANN401
    """Open3D's clouds and meshes of tensors."""
    for table, triangles in (("point", ""), ("vertex", "triangle")):
        points: Any = getattr(value, table, ())
        if not callable(points) and "positions" in points:
            corners: Any = getattr(value, triangles) if triangles else ()
            normals, colors = _entry(points, "normals"), _entry(points, "colors")
            strengths = _intensities(_entry(points, "intensities"), len(points["positions"]))
            indices = _entry(corners, "indices")
            return CloudParts(points["positions"], normals, indices, colors, intensities=strengths)
    return None


def _entry(table: Any, key: str) -> Any:  # noqa: ANN401
    """Return an entry of Open3D's tensor map, which has no `get`; None if the entry is missing."""
    return table[key] if key in table else None  # noqa: SIM401


def _read_homogeneous(_name: str, value: Any) -> CloudParts | None:  # noqa: ANN401
    """small_gicp: a method that returns (n,4), the last column 1."""
    # Its normals are not read: until they are estimated, they are uninitialized memory.
    if not (callable(getattr(value, "points", None)) and callable(getattr(value, "normals", None))):
        return None
    return CloudParts(np.asarray(value.points())[:, :3])


def _read_message(name: str, value: Any) -> CloudParts | None:  # noqa: ANN401
    """PointCloud2 of ROS: records of `point_step` bytes, rows of `row_step`."""
    if not all(hasattr(value, each) for each in ("fields", "point_step", "row_step", "is_bigendian", "data")):
        return None
    order = ">" if value.is_bigendian else "<"
    fields = [each for each in value.fields if each.count <= 1]
    places = {str(each.name).casefold(): (order + _ROS_TYPES[each.datatype], each.offset) for each in fields}
    kinds, offsets = zip(*places.values(), strict=True)
    layout = np.dtype(
        {"names": list(places), "formats": kinds, "offsets": offsets, "itemsize": value.point_step}
    )
    shape, strides = (value.height, value.width), (value.row_step, value.point_step)
    points = np.ndarray(shape, layout, memoryview(bytes(value.data)), strides=strides).reshape(-1)
    return _parts_of_columns(name, places, points.__getitem__)


_ROS_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


def _read_attributes(_name: str, value: Any) -> CloudParts | None:  # noqa: ANN401
    """Open3D, trimesh, PyVista, meshio, laspy: arrays by name."""
    for where in ("xyz", "vertices", "points"):
        points = getattr(value, where, None)
        if points is not None and not callable(points):
            colors = getattr(value, "colors", getattr(value, "vertex_colors", None))
            strengths = _intensities(getattr(value, "intensity", None), len(points))
            normals, faces = _stored_normals(value), _triangles(value)
            return CloudParts(points, normals, faces, colors, intensities=strengths)
    return None


def _stored_normals(value: Any) -> Any:  # noqa: ANN401
    """Return the stored normals of points; normals of meshes are computed from the faces instead."""
    stored = getattr(value, "normals", None)
    if stored is None and "Normals" in (getattr(value, "point_data", None) or ()):
        stored = value.point_data["Normals"]
    return None if stored is None or callable(stored) or len(stored) == 0 else stored


def _triangles(value: Any) -> Any:  # noqa: ANN401
    for name in ("faces", "triangles", "regular_faces"):
        try:
            faces = np.asarray(getattr(value, name))
        except Exception:  # noqa: BLE001, S112 - a mesh of other polygons raises its own error
            continue
        if faces.ndim == 2 and faces.shape[1] == 3 and faces.dtype.kind in "iu" and len(faces):
            return faces
    return None


_READERS = (_read_table, _read_tensor_cloud, _read_homogeneous, _read_message, _read_attributes)
