"""Read and write point clouds, keypoints and descriptors.

The core parses all formats of clouds but E57 and NumPy's own. A parser makes arrays of bytes; it may raise
anything.
"""

from __future__ import annotations

import glob
import os
from collections.abc import Callable, Iterable
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias
from urllib.parse import unquote

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup import _core
from cgroup._checks.arrays import as_place, as_reals, as_rows, contiguous
from cgroup._checks.foreign import cloud_parts
from cgroup._checks.quoting import escape
from cgroup._checks.values import as_choice, as_instance, as_path, run_options
from cgroup.errors import InputError
from cgroup.features import DescribedCloud
from cgroup.io._e57 import parse_e57, scan_of, write_e57
from cgroup.io.attributes import TEXTS
from cgroup.io.colmap import parse_points
from cgroup.io.files import naming, parse_file, read_content, write_file, write_stream, written_path
from cgroup.io.numpy_files import load_npy, load_npz_points, npz_bytes, read_arrays, single_number
from cgroup.io.result_folders import Results
from cgroup.types import AnyCloud, BoolArray, FloatArray, PointCloud
from cgroup.types.point_cloud import as_cloud

_DESCRIBED_FIELDS = tuple(field.name for field in fields(DescribedCloud))

Real: TypeAlias = Literal["float64", "float32"]
REALS: tuple[Real, ...] = ("float64", "float32")

# Suffixes of clouds that poses, matches and notes have as well: a folder's are not taken
_OTHERS_TOO = {".csv", ".npy", ".npz", ".txt"}
_CLOUD_COLOR, _KEYPOINT_COLOR = (190, 190, 190), (213, 94, 0)


def read_cloud(path: str | os.PathLike[str]) -> PointCloud:
    r"""Read a point cloud or mesh.

    PLY, PCD, OBJ, STL, OFF, PTS, PTX, E57, LAS, LAZ, glTF, GLB, legacy VTK, text, KITTI's ``.bin``, NPY,
    NPZ, COLMAP's ``points3D``; https://cgroup-project.github.io/cgroup/files.html lists what is read of each.
    `read_depth` reads depth images. Points with a NaN or infinite coordinate, those without a return, and
    splats of an opacity below 0.1 are left out and counted in `PointCloud.dropped`. Text that can be read in
    two ways is refused. Sizes that a file declares are checked against its length before memory is allocated.

    Parameters
    ----------
    path : path-like
        The suffix determines the format.

    Returns
    -------
    PointCloud
        Points; normals, faces, colours, intensities and the scanner's position if the file has them.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.io import read_cloud
    >>> _ = Path("scan.xyz").write_text("0 0 0\n1 0 0\nnan nan nan\n")
    >>> cloud = read_cloud("scan.xyz")
    >>> cloud.points.tolist(), cloud.dropped
    ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], 1)
    """
    path = as_path("path", path)
    suffix = path.suffix.lower()
    # The buffers of a glTF file may be next to it.
    reader = partial(_parse_gltf, path.parent) if suffix == ".gltf" else PARSERS.get(suffix)
    if path.stem == "points3D" and suffix in (".bin", ".txt"):
        reader = partial(parse_points, suffix)
    if reader is None:
        if path.is_dir():
            raise InputError(f"{path}: is a directory, not a file")
        known = " ".join(sorted(PARSERS))
        hint = "; `read_depth` reads depth images" if suffix == ".png" else ""
        raise InputError(f"{path}: unknown point cloud format {path.suffix!r}; known are {known}{hint}")
    return _finite_cloud(path, parse_file(path, reader))


def write_cloud(path: str | os.PathLike[str], cloud: AnyCloud, *, dtype: Real = "float64") -> None:
    """Write a point cloud as binary PLY, PCD or E57.

    Parameters
    ----------
    path : path-like
        Must end in ``.ply``, ``.pcd`` or ``.e57``.
    cloud : PointCloud or (N,3) array_like of float
        Or a cloud of another library. Normals, colours and intensities are written if present; faces in PLY
        only, and the viewpoint in PCD and E57 (as the position of the scanner), as the other formats have
        none.
    dtype : {"float64", "float32"}
        Of coordinates and normals; E57 is written in float64 only. Double precision keeps them to the last
        bit; PCL's point types and many viewers need single precision. That is refused if points would move
        by more than a millionth of the cloud's size: far from the origin, as in UTM, it hasn't enough digits.

    Examples
    --------
    >>> from cgroup.io import read_cloud, write_cloud
    >>> write_cloud("scan.ply", [[0, 0, 0], [0, 0.1, 1e6]])
    >>> read_cloud("scan.ply").points.tolist()
    [[0.0, 0.0, 0.0], [0.0, 0.1, 1000000.0]]
    """
    path = written_path(path, "point clouds", ".ply", ".pcd", ".e57")
    cloud, suffix = as_cloud("cloud", cloud), path.suffix.lower()
    as_choice("dtype", dtype, REALS[:1] if suffix == ".e57" else REALS)
    if suffix == ".e57":
        write_stream(path, partial(write_e57, scans=[scan_of(path.stem, cloud)]))
        return
    columns = (cloud.points, cloud.normals, cloud.faces, cloud.colors, cloud.intensities)
    parts = map(contiguous, columns, (np.float64, np.float64, np.int64, np.uint8, np.float32))
    place = None if cloud.viewpoint is None else as_place("cloud.viewpoint", cloud.viewpoint)
    content = _core.encode_cloud(
        suffix[1:], *parts, viewpoint=place, is_single=dtype == "float32", run_options=run_options(threads=1)
    )
    write_file(path, content)


def write_keypoints(path: str | os.PathLike[str], cloud: AnyCloud, indices: ArrayLike) -> None:
    """Write the keypoints of a cloud.

    Parameters
    ----------
    path : path-like
        ``.npz`` with arrays ``indices`` and ``points``, or ``.ply`` or ``.pcd``: grey, with keypoints in
        vermilion.
    cloud : PointCloud or (N,3) array_like of float
        The whole cloud.
    indices : (m,) array_like of int
        Rows of the cloud.
    """
    path, rows = as_path("path", path), as_rows("indices", indices)
    cloud = as_cloud("cloud", cloud)
    if rows.max(initial=-1) >= len(cloud):
        raise InputError("indices", f"row {rows.max()}, but the cloud has {len(cloud)} points")
    if path.suffix.lower() == ".npz":
        write_file(path, npz_bytes(indices=rows, points=cloud.points[rows]))
        return
    colors = np.full((len(cloud), 3), _CLOUD_COLOR, dtype=np.uint8)
    colors[rows] = _KEYPOINT_COLOR
    write_cloud(path, replace(cloud, colors=colors))


def write_descriptors(path: str | os.PathLike[str], described: DescribedCloud) -> None:
    """Write described keypoints.

    Parameters
    ----------
    path : path-like
        Must end in ``.npz``; the arrays are named as the fields of `DescribedCloud`.
    described : DescribedCloud
        Described keypoints.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.io import read_descriptors, write_descriptors
    >>> from cgroup.registration import describe
    >>> described = describe(standin_pair(pixels=60).source, descriptor="rcs")
    >>> write_descriptors("stone.npz", described)
    >>> read_descriptors("stone.npz").descriptors.shape == described.descriptors.shape
    True
    """
    path = written_path(path, "descriptors", ".npz")
    as_instance("described", described, DescribedCloud)
    write_file(path, npz_bytes(**{name: getattr(described, name) for name in _DESCRIBED_FIELDS}))


def read_descriptors(path: str | os.PathLike[str]) -> DescribedCloud:
    """Read described keypoints, as written by `write_descriptors`.

    Parameters
    ----------
    path : path-like
        NPZ.

    Returns
    -------
    DescribedCloud
        Identical to the written keypoints.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.io import read_descriptors, write_descriptors
    >>> from cgroup.registration import describe
    >>> scan = standin_pair(pixels=60).source
    >>> write_descriptors("scan.npz", describe(scan, descriptor="rcs"))
    >>> read_descriptors("scan.npz").descriptors.shape[1]
    72
    """
    path = as_path("path", path)
    arrays = read_arrays(path, _DESCRIBED_FIELDS)
    count = len(np.atleast_1d(arrays["indices"]))
    shapes = {"points": (count, 3), "lrf": (count, 3, 3), "descriptors": (count, None), "centroid": (3,)}
    with naming(path):
        indices = as_rows("indices", arrays["indices"])
        tables = {name: _table(name, arrays[name], shape) for name, shape in shapes.items()}
    return DescribedCloud(indices, resolution=single_number(path, arrays["resolution"]), **tables)


def _table(name: str, value: NDArray[Any], shape: tuple[int | None, ...]) -> Any:  # noqa: ANN401 - as written
    """Return numbers of a shape, in which None is any length."""
    array = as_reals(name, value)
    if array.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True)):
        wanted = ",".join("d" if n is None else str(n) for n in shape)
        raise InputError(name, f"shape {array.shape}, not ({wanted})", "its arrays differ in length")
    return array


def _finite_cloud(path: Path, cloud: PointCloud) -> PointCloud:
    """Remove points that are not finite, and their triangles."""
    points = cloud.points
    if len(points) == 0:
        raise InputError(f"{path}: holds no points")
    keep: BoolArray = np.asarray(np.isfinite(points).all(axis=1))
    dropped = len(points) - int(np.count_nonzero(keep))
    if dropped == len(points):
        raise InputError(f"{path}: none of its {dropped} points is finite")
    if cloud.viewpoint is not None and not np.isfinite(cloud.viewpoint).all():
        cloud = replace(cloud, viewpoint=None)
    return cloud if dropped == 0 else replace(cloud.select(keep), dropped=dropped)


def _parse_in_core(suffix: str, content: bytes) -> PointCloud:
    parts = _core.parse_cloud(content, suffix, run_options(threads=1))
    return PointCloud(*parts[:4], viewpoint=parts[4], intensities=parts[5])


def _parse_gltf(folder: Path, content: bytes) -> PointCloud:
    """Return the cloud of a scene whose buffers may be files in the folder."""
    options = run_options(threads=1)
    files = {uri: read_content(_beside(folder, unquote(uri))) for uri in _core.gltf_files(content, options)}
    return PointCloud(*_core.parse_gltf(content, files, options)[:4])


def _beside(folder: Path, name: str) -> Path:
    """Return the path of a buffer in the folder; raise for a path outside it."""
    is_plain = name.endswith(".bin") and name == Path(name).name and not set(name) & set("/\\:")
    if not is_plain or (folder / name).resolve().parent != folder.resolve():
        raise InputError(f"its buffer {name!r} is no .bin file beside it; put it there, or write GLB")
    return folder / name


def _content_of(array: NDArray[Any]) -> PointCloud:
    """Return the points of an array, or the points and normals of records."""
    parts = cloud_parts("array", array.reshape(-1)) if array.dtype.names else None
    if parts is None:
        return PointCloud(_points(array))
    return PointCloud(_points(parts.points), None if parts.normals is None else _points(parts.normals))


def _points(array: NDArray[Any]) -> FloatArray:
    if array.dtype.kind not in "biuf":
        raise InputError(f"points are {array.dtype}; numbers belong there")
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"points have shape {array.shape} instead of (N, 3)")
    return np.asarray(array, dtype=np.float64)


_IN_CORE = (*TEXTS, ".bin", ".gltf", ".las", ".obj", ".off", ".pcd", ".ply", ".ptx", ".stl", ".vtk")
PARSERS: dict[str, Callable[[bytes], PointCloud]] = {
    **{suffix: partial(_parse_in_core, suffix[1:]) for suffix in _IN_CORE},
    ".asc": partial(_parse_in_core, "txt"),
    ".e57": parse_e57,
    ".glb": partial(_parse_in_core, "gltf"),
    ".laz": partial(_parse_in_core, "las"),
    ".npy": lambda content: _content_of(load_npy(content, records=True)),
    ".npz": lambda content: _content_of(load_npz_points(content)),
}
"""By the suffix of a file."""


def find_clouds(name: str, paths: Iterable[str | os.PathLike[str]]) -> list[Path]:
    """Return the files of paths, sorted by name: the clouds of a folder, and the matches of a pattern."""
    return [file for path in paths for file in _files_of(name, as_path(name, path))]


def _files_of(name: str, path: Path) -> list[Path]:
    text = str(path)
    if os.path.isdir(path):  # noqa: PTH112 - a path that the system refuses is no folder
        suffixes = PARSERS.keys() - _OTHERS_TOO
        found = [file for file in _listed(path) if file.suffix.lower() in suffixes]
        own = Results(path, "").unchanged(found)
        files = [file for file in found if file not in own]
        got = f"a folder without clouds{' but results of cgroup' * bool(own)}"
        remedy = (
            f"files whose names end in {' '.join(sorted(suffixes))} are taken; name others by a pattern, "
            f"as {escape(text)}/*.txt"
        )
    elif glob.has_magic(text) and not os.path.lexists(path):
        files = [file for file in map(Path, glob.glob(text, recursive=True)) if file.is_file()]  # noqa: PTH207 - absolute ones
        got, remedy = "a pattern that no file matches", "check the folder and the suffix"
    else:
        return [path]
    if not files:
        raise InputError(f"{name}: {escape(text)}", got, remedy)
    return sorted(files)


def _listed(folder: Path) -> list[Path]:
    try:
        return [file for file in folder.iterdir() if file.is_file() and not file.name.startswith(".")]
    except OSError as error:
        raise InputError(f"{folder}: can't be read ({error.strerror or error})") from error
