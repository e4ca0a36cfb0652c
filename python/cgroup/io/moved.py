"""Move original files: every attribute of their points is kept, at full resolution."""

from __future__ import annotations

import json
import os
import shutil
import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias
from urllib.parse import quote, unquote
from xml.dom import minidom

import numpy as np
from numpy.typing import ArrayLike

from cgroup import _core
from cgroup._checks.values import as_length, as_path
from cgroup.errors import InputError
from cgroup.io import _e57 as e57
from cgroup.io import _moved_tables as tables
from cgroup.io._motion import NORMAL, Motion
from cgroup.io.attributes import TEXTS
from cgroup.io.files import check_outputs, faults_of, load_json, open_input, write_stream
from cgroup.io.las import check_laspy, move_las
from cgroup.rigid import check_rigid
from cgroup.rigid.transforms import quaternions, scaling
from cgroup.types import FloatArray

_JSON_CHUNK = 0x4E4F534A  # of GLB
_Moves: TypeAlias = Callable[[Motion, BinaryIO, BinaryIO], None]


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
    motion = Motion(check_rigid(pose, "pose") @ scaling(factor), factor, out.stem)
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
    """Raise `InputError` for a file of an unknown format, or without the library that it needs."""
    check_laspy([path])
    if path.stem == "points3D" and path.suffix.lower() in (".bin", ".txt"):
        raise InputError(f"{path}: a part of a COLMAP model; move all of it by io.read_colmap")
    if path.suffix.lower() not in _MOVERS:
        raise InputError(
            f"{path}: {path.suffix!r} files are not moved; known are {' '.join(sorted(_MOVERS))}"
        )


def _move_e57(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Move the poses of scans and pictures; the points stay in the frames of their scans."""
    if motion.scale != 1.0:
        raise InputError("scale", motion.scale, "the poses of E57 have none; convert the file first")
    pages = e57.checked_pages(np.memmap(source, np.uint8, "r"))
    text = e57.description(pages)
    e57.parse_xml(text)  # refuses entities
    tree = minidom.parseString(text)  # noqa: S318
    if getattr(tree.documentElement, "prefix", None):
        raise InputError("its elements have a prefix; write it anew, as by io.merge_files")
    groups = [*tree.getElementsByTagName("data3D"), *tree.getElementsByTagName("images2D")]
    for scan in (one for group in groups for one in group.childNodes if one.nodeType == one.ELEMENT_NODE):
        _move_pose(motion, scan)
    content = tree.toxml(encoding="UTF-8")
    sealed = _core.seal_pages(content)
    head = bytearray(pages[0, : e57.USED].tobytes())
    struct.pack_into("<QQQ", head, 16, pages.size + len(sealed), pages.size, len(content))
    out.writelines((_core.seal_pages(bytes(head)), pages[1:].data, sealed))


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
        _copy_beside(document, Path(source.name).parent, Path(out.name).parent, motion.stem)
        out.write(_add_roots(motion, document))
        return
    magic, version, length, size, kind = struct.unpack("<4sIIII", head)
    if (version, kind) != (2, _JSON_CHUNK):
        raise InputError("no GLB of version 2")
    text = _add_roots(motion, load_json(source.read(size)))
    text += b" " * (-len(text) % 4)
    out.write(struct.pack("<4sIIII", magic, version, length - size + len(text), len(text), kind) + text)
    shutil.copyfileobj(source, out)


def _copy_beside(document: Any, folder: Path, to: Path, stem: str) -> None:  # noqa: ANN401 - of JSON
    """Copy buffers and pictures in other files of a folder; their names begin with that of the document."""
    parts = [one for key in ("buffers", "images") for one in document.get(key, [])]
    parts = [one for one in parts if not one.get("uri", "data:").startswith("data:")]
    for part in parts if folder.resolve() != to.resolve() else ():
        name = unquote(part["uri"])
        if name != Path(name).name or set(name) & set("/\\:"):
            raise InputError(f"its file {name!r} is not beside it; put it there, or write GLB")
        part["uri"] = quote(f"{stem}_{name}")
        with open_input(folder / name) as file:
            write_stream(to / f"{stem}_{name}", partial(shutil.copyfileobj, file))


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


_MOVERS: dict[str, _Moves] = {
    **dict.fromkeys(TEXTS, tables.move_text),
    ".xyzn": partial(tables.move_text, more=NORMAL),
    ".obj": tables.move_obj,
    ".ptx": tables.move_ptx,
    ".ply": tables.move_ply,
    ".pcd": tables.move_pcd,
    ".stl": tables.move_stl,
    ".bin": tables.move_bin,
    ".las": move_las,
    ".laz": partial(move_las, is_packed=True),
    ".e57": _move_e57,
    ".glb": _move_gltf,
    ".gltf": _move_gltf,
}
