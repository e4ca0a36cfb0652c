"""Move files by their descriptions: poses of the scans of E57, and a root node of glTF."""

from __future__ import annotations

import json
import shutil
import struct
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import unquote
from xml.dom import minidom

import numpy as np

from cgroup.errors import InputError
from cgroup.io import _e57 as e57
from cgroup.io._gltf import JSON_CHUNK
from cgroup.io._motion import XYZ, Motion
from cgroup.io.files import load_json, open_input, write_stream
from cgroup.rigid.transforms import quaternions
from cgroup.types import FloatArray


def move_e57(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Move the poses of scans and pictures; the points stay in the frames of their scans."""
    if motion.scale != 1.0:
        raise InputError("scale", motion.scale, "the poses of E57 have none; convert the file first")
    head = source.read(e57.PAGE)
    length, address, size = e57.check_head(head, source.seek(0, 2))
    source.seek(address // e57.PAGE * e57.PAGE)
    text = e57.used_bytes(source.read((size // e57.USED + 2) * e57.PAGE))[address % e57.PAGE :][:size]
    tree = minidom.parseString(e57.refuse_types(text))  # noqa: S318 - without entities
    for group in (
        child for child in _elements(tree.documentElement) if child.localName in ("data3D", "images2D")
    ):
        for scan in _elements(group):
            _move_pose(motion, scan, tree)
    content = tree.toxml(encoding="UTF-8")
    is_last = e57.logical(address) + size > e57.logical(length) - e57.USED
    start = e57.logical(address) if is_last else e57.logical(length)
    pages, used = divmod(start, e57.USED)
    source.seek(0)
    _copy_pages(source, out, pages)
    tail = e57.used_bytes(source.read(e57.PAGE))[:used] + content
    tail += bytes(-len(tail) % e57.USED)
    out.write(e57.seal_pages(tail))
    whole, place = out.tell(), pages * e57.PAGE + used
    out.seek(0)
    first = bytearray(e57.used_bytes(out.read(e57.PAGE)))
    struct.pack_into("<QQQ", first, 16, whole, place, len(content))
    out.seek(0)
    out.write(e57.seal_pages(bytes(first)))


def _copy_pages(source: BinaryIO, out: BinaryIO, count: int) -> None:
    for first in range(0, count, e57.PAGES):
        content = source.read(min(e57.PAGES, count - first) * e57.PAGE)
        e57.check_pages(content, first)
        out.write(content)


def _elements(parent: Any) -> list[Any]:  # noqa: ANN401 - of minidom
    return [child for child in parent.childNodes if child.nodeType == child.ELEMENT_NODE]


def _move_pose(motion: Motion, scan: Any, tree: minidom.Document) -> None:  # noqa: ANN401 - of minidom
    before = [child for child in _elements(scan) if child.localName == "pose"]
    pose = np.eye(4)
    for child in before:
        pose = e57.pose_of(e57.parse_xml(child.toxml().encode()))
        scan.removeChild(child)
    moved: FloatArray = motion.matrix @ pose
    x, y, z, w = quaternions(moved[:3, :3][None])[0].tolist()
    parts = {"rotation": dict(zip("wxyz", (w, x, y, z), strict=True))}
    parts["translation"] = dict(zip(XYZ, moved[:3, 3].tolist(), strict=True))
    written = scan.appendChild(_structure(tree, "pose"))
    for name, numbers in parts.items():
        part = written.appendChild(_structure(tree, name))
        for axis, number in numbers.items():
            leaf = part.appendChild(tree.createElement(axis))
            leaf.setAttribute("type", "Float")
            leaf.appendChild(tree.createTextNode(repr(number)))


def _structure(tree: minidom.Document, name: str) -> minidom.Element:
    element = tree.createElement(name)
    element.setAttribute("type", "Structure")
    return element


def move_glb(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Add a root node to the scenes of a GLB file."""
    magic, version, length, size, kind = struct.unpack("<4sIIII", source.read(20))
    if (magic, version, kind) != (b"glTF", 2, JSON_CHUNK):
        raise InputError("no GLB of version 2")
    document = load_json(source.read(size))
    text = _add_root(motion, document)
    text += b" " * (-len(text) % 4)
    out.write(struct.pack("<4sIIII", magic, version, length - size + len(text), len(text), kind) + text)
    shutil.copyfileobj(source, out)


def move_gltf(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Add a root node to the scenes of a glTF file; `copy_beside` copies its other files."""
    out.write(_add_root(motion, load_json(source.read())))


def copy_beside(path: Path, out: Path) -> None:
    """Copy buffers and pictures of a glTF file to the folder of the new one."""
    with open_input(path) as file:
        document: Any = load_json(file.read())
    for entry in (*document.get("buffers", []), *document.get("images", [])):
        uri = entry.get("uri", "data:")
        name = unquote(uri)
        if uri.startswith("data:") or path.parent.resolve() == out.parent.resolve():
            continue
        if name != Path(name).name or set(name) & set("/\\:"):
            raise InputError(f"{path}: its file {name!r} is not beside it; put it there, or write GLB")
        with open_input(path.parent / name) as file:
            write_stream(out.parent / name, lambda target, file=file: shutil.copyfileobj(file, target))


def _add_root(motion: Motion, document: Any) -> bytes:  # noqa: ANN401 - of JSON
    """Return the JSON of a document with a root node that has the matrix."""
    if str(document["asset"]["version"]).split(".")[0] != "2":
        raise InputError(f"version {document['asset']['version']}; version 2 is moved")
    nodes, scenes = document.setdefault("nodes", []), document.get("scenes", [])
    if not scenes:
        children = {child for node in nodes for child in node.get("children", [])}
        scenes = [{"nodes": [row for row in range(len(nodes)) if row not in children]}]
    roots = [tuple(scene.get("nodes", [])) for scene in scenes]
    wrappers: dict[tuple[int, ...], int] = {}
    for scene, children in zip(scenes, roots, strict=True):
        if not children:
            continue
        if children not in wrappers:
            wrappers[children] = len(nodes)
            nodes.append(
                {"name": "pose", "matrix": motion.matrix.T.ravel().tolist(), "children": [*children]}
            )
        scene["nodes"] = [wrappers[children]]
    rows = [row for children in wrappers for row in children]
    if len({*rows}) < len(rows):
        raise InputError("scenes that share some of their nodes; write one scene per file")
    return json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()
