"""Move original files: every attribute of their points is kept, at full resolution."""

from __future__ import annotations

import copy
import json
import os
import shutil
import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias
from urllib.parse import unquote
from xml.dom import minidom

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.values import as_length, as_path
from cgroup.errors import InputError
from cgroup.io import _e57 as e57
from cgroup.io import _moved_tables as tables
from cgroup.io._gltf import JSON_CHUNK
from cgroup.io._motion import MOST_LOST, NORMAL, XYZ, Motion
from cgroup.io.attributes import TEXTS
from cgroup.io.files import check_outputs, faults_of, load_json, open_input, write_stream
from cgroup.rigid import apply, check_rigid
from cgroup.rigid.transforms import quaternions, scaling
from cgroup.types import FloatArray

_Moves: TypeAlias = Callable[[Motion, BinaryIO, BinaryIO], None]

_LAS_HEAD = 375
_POINTS = 500_000  # of LAS that are moved at a time
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
        Output of the same format, not the input; an existing file is replaced when the new one is complete.
    scale : float
        Applied before the pose.

    Returns
    -------
    list of str
        One note for each attribute that could not be kept or moved, with the reason.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.io import transform_file
    >>> _ = Path("scan.csv").write_text("x,y,z,time\n1,2,3,0.125\n")
    >>> transform_file(
    ...     "scan.csv", [[1, 0, 0, 10.5], [0, 1, 0, 20], [0, 0, 1, 30]], "moved.csv"
    ... )
    []
    >>> Path("moved.csv").read_text()
    'x,y,z,time\n11.5,22.0,33.0,0.125\n'
    """
    path, out = as_path("path", path), as_path("out", out)
    check_movable(path)
    factor, kind = as_length("scale", scale), out.suffix.lower()
    motion = Motion(check_rigid(pose, "pose") @ scaling(factor), factor)
    if kind != path.suffix.lower() and {kind, path.suffix.lower()} != {".las", ".laz"}:
        raise InputError("out", str(out), f"the format stays: give a name that ends in {path.suffix}")
    check_outputs([out], [path])

    def write(file: BinaryIO) -> None:
        with faults_of(path, "las"):
            _MOVERS[kind](motion, source, file)

    with open_input(path) as source:
        write_stream(out, write)
    return [*dict.fromkeys(motion.notes)]


def check_movable(path: Path) -> None:
    """Raise `InputError` for a file of an unknown format."""
    if path.suffix.lower() not in _MOVERS:
        raise InputError(
            f"{path}: {path.suffix!r} files are not moved; known are {' '.join(sorted(_MOVERS))}"
        )


def _move_las(motion: Motion, source: BinaryIO, out: BinaryIO, *, is_packed: bool = False) -> None:
    import laspy  # noqa: PLC0415 - slow to load, optional

    head, size = source.read(_LAS_HEAD).ljust(_LAS_HEAD, b"\0"), source.seek(0, os.SEEK_END)
    vlrs, more = struct.unpack_from("<I139xI", head, 100)
    records = vlrs + (more if head[25] > 3 else 0)
    if head[:4] != b"LASF" or 54 * records > size:
        raise InputError(f"{records} records in {size} bytes")
    source.seek(0)
    with laspy.open(source, closefd=False) as reader:
        header, evlrs = copy.deepcopy(reader.header), reader.evlrs
        header.evlrs = None
        for kept in (header.vlrs, evlrs or []):
            for record in [record for record in kept if record.user_id == "copc"]:
                kept.remove(record)
                motion.notes.append("the index of COPC: not kept; write it again, as with untwine")
        if header.point_format.has_waveform_packet:
            motion.notes.append("waveforms: not copied; points keep their addresses in the original file")
        if header.point_count:
            header.scales, header.offsets = _choose_grid(motion, np.array([header.mins, header.maxs]), header)
        given = {name.lower(): name for name in header.point_format.dimension_names if name not in "XYZ"}
        given |= zip(XYZ, XYZ, strict=True)
        names = motion.names(given)
        with laspy.LasWriter(out, header, do_compress=is_packed, closefd=False) as writer:
            for points in reader.chunk_iterator(_POINTS):
                moved = motion.move({name: np.array(points[given[name]]) for name in names})
                points.scales, points.offsets = header.scales, header.offsets
                try:
                    for name, values in moved.items():
                        points[given[name]][:] = values
                except OverflowError as error:
                    reason = "its points are outside the box that its header declares; repair the header"
                    raise InputError(reason) from error
                writer.write_points(points)
            if evlrs:
                writer.write_evlrs(evlrs)


def _choose_grid(motion: Motion, box: FloatArray, header: Any) -> tuple[FloatArray, FloatArray]:  # noqa: ANN401
    """Return scales and offsets: as fine as before, and at most a millionth of the extent."""
    moved = apply(motion.matrix, np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3))
    low, high = moved.min(axis=0), moved.max(axis=0)
    extent = motion.scale * float(np.linalg.norm(box[1] - box[0]))
    before = grid = float(np.min(header.scales)) * motion.scale
    while 0.0 < extent < 0.5 * grid / MOST_LOST:
        grid /= 10
    while (high - low).max() / 2 + 1 > _MOST * grid:
        grid *= 10
    if grid > before:
        motion.notes.append(f"coordinates: rounded to {grid:g}, as 32 bits hold no finer ones of this extent")
    return np.full(3, grid), np.floor((low + high) / 2)


def _move_e57(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Move the poses of scans and pictures; the points stay in the frames of their scans."""
    if motion.scale != 1.0:
        raise InputError("scale", motion.scale, "the poses of E57 have none; convert the file first")
    pages = e57.checked_pages(np.memmap(source, np.uint8, "r"))
    text = e57.description(pages)
    e57.parse_xml(text)  # refuses entities
    tree = minidom.parseString(text)  # noqa: S318
    groups = [*tree.getElementsByTagName("data3D"), *tree.getElementsByTagName("images2D")]
    for scan in (one for group in groups for one in group.childNodes if one.nodeType == one.ELEMENT_NODE):
        _move_pose(motion, scan)
    content = tree.toxml(encoding="UTF-8")
    sealed = e57.seal_pages(content)
    head = bytearray(pages[0, : e57.USED].tobytes())
    struct.pack_into("<QQQ", head, 16, pages.size + len(sealed), pages.size, len(content))
    out.writelines((e57.seal_pages(bytes(head)), pages[1:].data, sealed))


def _move_pose(motion: Motion, scan: Any) -> None:  # noqa: ANN401 - of minidom
    pose = np.eye(4)
    for child in [child for child in scan.childNodes if child.nodeName == "pose"]:
        pose = e57.pose_of(e57.parse_xml(child.toxml().encode()))
        scan.removeChild(child)
    moved: FloatArray = motion.matrix @ pose
    turned = np.roll(quaternions(moved[:3, :3][None])[0], 1)  # w x y z
    text = ""
    for name, axes, numbers in (("rotation", "wxyz", turned), ("translation", "xyz", moved[:3, 3])):
        leaves = zip(axes, numbers.tolist(), strict=True)
        inner = "".join(f'<{axis} type="Float">{number!r}</{axis}>' for axis, number in leaves)
        text += f'<{name} type="Structure">{inner}</{name}>'
    written = minidom.parseString(f'<pose type="Structure">{text}</pose>')  # noqa: S318
    scan.appendChild(written.documentElement)


def _move_gltf(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    head = source.read(20)
    if not head.startswith(b"glTF"):
        document = load_json(head + source.read())
        _copy_beside(document, Path(source.name).parent, Path(out.name).parent)
        out.write(_add_roots(motion, document))
        return
    magic, version, length, size, kind = struct.unpack("<4sIIII", head)
    if (version, kind) != (2, JSON_CHUNK):
        raise InputError("no GLB of version 2")
    text = _add_roots(motion, load_json(source.read(size)))
    text += b" " * (-len(text) % 4)
    out.write(struct.pack("<4sIIII", magic, version, length - size + len(text), len(text), kind) + text)
    shutil.copyfileobj(source, out)


def _copy_beside(document: Any, folder: Path, to: Path) -> None:  # noqa: ANN401 - of JSON
    """Copy buffers and pictures in other files of a folder."""
    uris = [one.get("uri", "data:") for key in ("buffers", "images") for one in document.get(key, [])]
    for name in (unquote(uri) for uri in uris if not uri.startswith("data:")):
        if folder.resolve() == to.resolve():
            continue
        if name != Path(name).name or set(name) & set("/\\:"):
            raise InputError(f"its file {name!r} is not beside it; put it there, or write GLB")
        with open_input(folder / name) as file:
            write_stream(to / name, partial(shutil.copyfileobj, file))


def _add_roots(motion: Motion, document: Any) -> bytes:  # noqa: ANN401 - of JSON
    """Return the JSON of a document with a node above each root node that has the matrix."""
    if str(document["asset"]["version"]).split(".")[0] != "2":
        raise InputError(f"version {document['asset']['version']}; version 2 is moved")
    nodes = document.setdefault("nodes", [])
    roots = {*range(len(nodes))} - {child for node in nodes for child in node.get("children", [])}
    above = {root: len(nodes) + k for k, root in enumerate(sorted(roots))}
    for scene in (scene for scene in document.get("scenes", []) if "nodes" in scene):
        scene["nodes"] = [above[root] for root in scene["nodes"]]
    matrix = motion.matrix.T.ravel().tolist()
    nodes += [{"name": "pose", "matrix": matrix, "children": [root]} for root in above]
    return json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()


_MOVERS: dict[str, _Moves] = dict.fromkeys(TEXTS, tables.move_text)
_MOVERS |= {".xyzn": partial(tables.move_text, more=NORMAL), ".obj": tables.move_obj, ".ptx": tables.move_ptx}
_MOVERS |= {
    ".ply": tables.move_ply,
    ".pcd": tables.move_pcd,
    ".stl": tables.move_stl,
    ".bin": tables.move_bin,
}
_MOVERS |= {".las": _move_las, ".laz": partial(_move_las, is_packed=True), ".e57": _move_e57}
_MOVERS |= {".glb": _move_gltf, ".gltf": _move_gltf}
