"""Move original files: every attribute of their points is kept, at full resolution."""

from __future__ import annotations

import copy
import os
import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.values import as_path
from cgroup.errors import InputError
from cgroup.io import _moved_documents as documents
from cgroup.io import _moved_tables as tables
from cgroup.io import _moved_texts as texts
from cgroup.io._motion import MOST_LOST, Motion, Mover
from cgroup.io.files import check_outputs, faults_of, open_input, write_stream
from cgroup.rigid import apply
from cgroup.types import FloatArray

_Moves: TypeAlias = Callable[[Motion, BinaryIO, BinaryIO], None]

_LAS_HEAD = 375
_POINTS = 500_000  # of LAS that are moved at a time
_WITH_WAVES = {4, 5, 9, 10}  # point formats of LAS
_MOST = 2**31 - 2  # of a coordinate of LAS in units of its scale


def transform_file(
    path: str | os.PathLike[str], pose: ArrayLike, out: str | os.PathLike[str], *, scale: float = 1.0
) -> list[str]:
    r"""Write a file of points or triangles moved by a pose, with all their attributes.

    Positions are moved; normals, and the rotations, sizes and spherical harmonics of Gaussian splats too. All
    other attributes stay the same to the bit. Files are processed by chunks, except glTF and compressed PCD.
    https://cgroup-project.github.io/cgroup/howto/apply-a-pose.html lists what is moved.

    Parameters
    ----------
    path : path-like
        LAS, LAZ (extra ``cgroup[las]``), PLY, PCD, E57, PTX, OBJ, STL, glTF, GLB, KITTI's
        ``.bin``, or text: ``.xyz``, ``.asc``, ``.txt``, ``.csv``, ``.pts``, ``.xyzn``, ``.xyzrgb``.
    pose : (4,4) or (3,4) array_like of float
        Rigid transform of column vectors, p' = R (scale p) + t.
    out : path-like
        Output of the same format; an existing file is replaced when the new one is complete. It must not be
        the input.
    scale : float
        Applied before the pose.

    Returns
    -------
    list of str
        One note for each attribute that could not be kept or moved, with the reason.

    Raises
    ------
    InputError
        The file is damaged or of another format, or the format cannot represent the result.

    Examples
    --------
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from cgroup.io import transform_file
    >>> _ = Path("scan.csv").write_text("x,y,z,time\n1,2,3,0.125\n")
    >>> pose = np.eye(4)
    >>> pose[:3, 3] = 432_100.5, 5_123_400.25, 300
    >>> transform_file("scan.csv", pose, "moved.csv")
    []
    >>> Path("moved.csv").read_text()
    'x,y,z,time\n432101.5,5123402.25,303.0,0.125\n'
    """
    path, out = as_path("path", path), as_path("out", out)
    move = find_mover(path)
    motion = Motion.of(pose, scale)
    suffixes = {path.suffix.lower(), out.suffix.lower()}
    if len(suffixes) > 1 and suffixes != {".las", ".laz"}:
        raise InputError("out", str(out), f"the format stays: give a name that ends in {path.suffix}")
    check_outputs([out], [path])
    if path.suffix.lower() in (".las", ".laz"):
        move = partial(_move_las, is_packed=out.suffix.lower() == ".laz")

    def write(file: BinaryIO) -> None:
        with faults_of(path, "las"):
            move(motion, source, file)

    with open_input(path) as source:
        write_stream(out, write)
    if path.suffix.lower() == ".gltf":
        with faults_of(path):
            documents.copy_beside(path, out)
    return motion.notes


def find_mover(path: Path) -> _Moves:
    """Return the function that moves files of a format; raise `InputError` for an unknown one."""
    if path.suffix.lower() not in MOVERS:
        known = " ".join(sorted(MOVERS))
        raise InputError(f"{path}: files of the format {path.suffix!r} are not moved; known are {known}")
    return MOVERS[path.suffix.lower()]


def _move_las(motion: Motion, source: BinaryIO, out: BinaryIO, *, is_packed: bool = False) -> None:
    import laspy  # noqa: PLC0415 - slow to load, optional

    head, size = source.read(_LAS_HEAD).ljust(_LAS_HEAD, b"\0"), source.seek(0, os.SEEK_END)
    records = struct.unpack_from("<I", head, 100)[0] + (
        struct.unpack_from("<I", head, 243)[0] if head[25] > 3 else 0
    )
    if head[:4] != b"LASF" or 54 * records > size:
        raise InputError(f"{records} records in {size} bytes")
    source.seek(0)
    with laspy.open(source, closefd=False) as reader:
        header = copy.deepcopy(reader.header)
        header.evlrs, evlrs = None, reader.evlrs
        for kept in (header.vlrs, evlrs or []):
            _drop_index(motion, kept)
        if header.point_format.id in _WITH_WAVES:
            motion.note("waveforms: not copied; points keep their addresses in the original file")
        names = {name.lower(): name for name in header.point_format.dimension_names if name not in "XYZ"}
        mover = Mover(motion, names)
        if header.point_count:
            header.scales, header.offsets = _choose_grid(motion, np.array([header.mins, header.maxs]), header)
        with laspy.LasWriter(out, header, do_compress=is_packed, closefd=False) as writer:
            for points in reader.chunk_iterator(_POINTS):
                _move_points(motion, points, header)
                columns = {name: np.array(points[names[name]]) for name in mover.names}
                mover.move(columns)
                for name, values in columns.items():
                    points[names[name]] = values
                writer.write_points(points)
            if evlrs:
                writer.write_evlrs(evlrs)


def _drop_index(motion: Motion, records: Any) -> None:  # noqa: ANN401 - of laspy
    """Remove records of COPC, which refer to places in the file."""
    for at in reversed([at for at, one in enumerate(records) if one.user_id == "copc"]):
        records.pop(at)
        motion.note("the index of COPC: not kept; write it again, as with untwine")


def _choose_grid(motion: Motion, box: FloatArray, header: Any) -> tuple[FloatArray, FloatArray]:  # noqa: ANN401
    """Return scales and offsets: as fine as before, and at most a millionth of the extent."""
    low, high = motion.box(*box)
    extent = motion.scale * float(np.linalg.norm(box[1] - box[0]))
    before = grid = float(np.min(header.scales)) * motion.scale
    while 0.0 < extent < 0.5 * grid / MOST_LOST:
        grid /= 10
    while (high - low).max() / 2 + 1 > _MOST * grid:
        grid *= 10
    if grid > before:
        motion.note(f"coordinates: rounded to {grid:g}, as 32 bits hold no finer ones of this extent")
    return np.full(3, grid), np.floor((low + high) / 2)


def _move_points(motion: Motion, points: Any, header: Any) -> None:  # noqa: ANN401 - of laspy
    """Move the coordinates of records into the grid of a new header."""
    array = points.array
    stored = np.stack([array[axis] for axis in "XYZ"], axis=1)
    moved = apply(motion.matrix, stored * points.scales + points.offsets)
    steps = np.rint((moved - header.offsets) / header.scales)
    if np.abs(steps).max(initial=0) > _MOST + 1:
        raise InputError("its points are outside the box that its header declares; repair the header")
    for axis, values in zip("XYZ", steps.T, strict=True):
        array[axis] = values
    points.scales, points.offsets = header.scales, header.offsets


_TEXTS = dict.fromkeys((".xyz", ".asc", ".txt", ".csv", ".pts", ".xyzrgb"), texts.move_table)
MOVERS: dict[str, _Moves] = _TEXTS | {
    ".xyzn": partial(texts.move_table, more=texts.NORMAL),
    ".las": _move_las,
    ".laz": _move_las,
    ".ply": tables.move_ply,
    ".pcd": tables.move_pcd,
    ".stl": tables.move_stl,
    ".bin": tables.move_bin,
    ".obj": texts.move_obj,
    ".ptx": texts.move_ptx,
    ".e57": documents.move_e57,
    ".glb": documents.move_glb,
    ".gltf": documents.move_gltf,
}
"""By the suffix of a file."""
