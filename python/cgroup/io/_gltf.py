"""glTF 2.0 and GLB: triangles and points of a scene, in its frame."""

import base64
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from cgroup.errors import InputError
from cgroup.io.files import check_growth, read_content
from cgroup.rigid import apply
from cgroup.rigid.transforms import turn
from cgroup.types import FloatArray, IndexArray
from cgroup.types.point_cloud import PointCloud, join_clouds

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
JSON_CHUNK, _BINARY = 0x4E4F534A, 0x004E4942
_TRIANGLES, _STRIP, _FAN = 4, 5, 6


def parse_gltf(content: bytes, folder: Path | None = None) -> PointCloud:
    """Return the cloud of the scene; its buffers may be files in the folder."""
    text, binary = _chunks(content) if content[:4] == b"glTF" else (content, b"")
    document: Any = json.loads(text)
    if str(document["asset"]["version"]).split(".")[0] != "2":
        raise InputError(f"version {document['asset']['version']}; version 2 is read")
    with np.errstate(all="ignore"):  # numbers of files may be any
        return _Scene(document, binary, folder, len(content)).read()


def _chunks(content: bytes) -> tuple[bytes, bytes]:
    version, length = struct.unpack_from("<II", content, 4)
    if version != 2 or length > len(content):
        raise InputError(f"version {version}, {len(content)} of {length} bytes")
    chunks, place = {JSON_CHUNK: b"", _BINARY: b""}, 12
    while place < length:
        size, kind = struct.unpack_from("<II", content, place)
        if size > length - place - 8:
            raise InputError(f"a chunk of {size} bytes at byte {place} of {length}")
        chunks[kind] = chunks.get(kind) or content[place + 8 : place + 8 + size]
        place += 8 + size
    return chunks[JSON_CHUNK], chunks[_BINARY]


class _Scene:
    def __init__(self, document: Any, binary: bytes, folder: Path | None, size: int) -> None:  # noqa: ANN401
        self._document, self._binary, self._folder = document, binary, folder
        self._buffers: dict[int, bytes] = {}
        self._size, self._grown = size, 0

    def read(self) -> PointCloud:
        """Return the primitives of all nodes, moved into the scene's frame."""
        parts: list[PointCloud] = []
        seen: set[int] = set()
        waiting = [(node, np.eye(4)) for node in self._roots()]
        while waiting:
            row, parent = waiting.pop()
            node = self._item("nodes", row)
            if row in seen:
                raise InputError(f"node {row} has two parents, or is its own")
            seen.add(row)
            matrix = np.einsum("ij,jk->ik", parent, _local(node))
            waiting.extend((child, matrix) for child in reversed(node.get("children", [])))
            if "mesh" in node:
                shared: dict[tuple[Any, ...], list[Any]] = {}  # of primitives that have the same points
                for primitive in self._item("meshes", node["mesh"])["primitives"]:
                    shared.setdefault(_attributes(primitive), []).append(primitive)
                parts.extend(self._part(same, primitives, matrix) for same, primitives in shared.items())
        return join_clouds(parts)

    def _roots(self) -> list[int]:
        """Return the root nodes of the scene; without a scene, the nodes without a parent."""
        if self._document.get("scenes"):
            return list(reversed(self._item("scenes", self._document.get("scene", 0)).get("nodes", [])))
        nodes = self._document.get("nodes", [])
        children = {child for node in nodes for child in node.get("children", [])}
        return [row for row in reversed(range(len(nodes))) if row not in children]

    def _item(self, kind: str, row: Any) -> Any:  # noqa: ANN401 - whatever stands in the file
        items = self._document.get(kind, [])
        if type(row) is not int or not 0 <= row < len(items):
            raise InputError(f"{kind} has no entry {row!r}, only {len(items)}")
        return items[row]

    def _part(self, attributes: tuple[Any, ...], primitives: list[Any], matrix: FloatArray) -> PointCloud:
        """Return the points and triangles of all primitives that have some."""
        position, normal, color = attributes
        points = self._accessor(position, "VEC3")
        normals = None if normal is None else self._accessor(normal, "VEC3")
        colors = None if color is None else self._accessor(color, "VEC3", "VEC4")
        if any(len(values) != len(points) for values in (normals, colors) if values is not None):
            raise InputError(f"{len(points)} points, but other numbers of normals or colours")
        meshes = [self._faces(primitive, len(points)) for primitive in primitives]
        triangles = [mesh for mesh in meshes if mesh is not None]
        faces = np.concatenate(triangles) if triangles else None
        across = np.linalg.det(matrix[:3, :3])
        if faces is not None and across < 0:
            faces = faces[:, ::-1]
        if normals is not None:
            # The cofactors are the inverse's transpose, up to a factor that normalization removes.
            x, y, z = matrix[:3, :3].T
            cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)
            normals = np.einsum("ij,nj->ni", np.copysign(1, across) * cofactors, normals)
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        if colors is not None:
            colors = np.rint(255 * np.clip(np.nan_to_num(colors[:, :3]), 0, 1)).astype(np.uint8)
        moved = points if (matrix == np.eye(4)).all() else apply(matrix, points)
        return PointCloud(moved, normals, faces, colors)

    def _faces(self, primitive: Any, count: int) -> IndexArray | None:  # noqa: ANN401
        """Return triangles as rows of the points, for primitives that are triangles."""
        mode = primitive.get("mode", _TRIANGLES)
        if mode not in {_TRIANGLES, _STRIP, _FAN}:
            return None
        corners = np.arange(count)
        if "indices" in primitive:
            numbers = self._accessor(primitive["indices"], "SCALAR")[:, 0]
            wrong = numbers[~((numbers >= 0) & (numbers < count) & (numbers % 1 == 0))]
            if len(wrong):
                raise InputError(f"a triangle names point {wrong[0]:.15g} of {count}")
            corners = numbers.astype(np.int64)
        self._grow(24 * len(corners))
        if mode == _TRIANGLES:
            return corners[: len(corners) // 3 * 3].reshape(-1, 3)
        rows = np.arange(max(len(corners) - 2, 0))
        if mode == _FAN:
            return np.stack([corners[rows + 1], corners[rows + 2], corners[0 * rows]], axis=1)
        return np.stack([corners[rows], corners[rows + 1 + rows % 2], corners[rows + 2 - rows % 2]], axis=1)

    def _accessor(self, row: Any, *kinds: str) -> FloatArray:  # noqa: ANN401
        entry = self._item("accessors", row)
        count, kind = _count(entry["count"]), entry["type"]
        if kind not in kinds:
            raise InputError(f"accessor {row} has {kind}; {' or '.join(kinds)} belongs there")
        width = _WIDTHS[kind]
        self._grow(8 * count * width)
        values = np.zeros((count, width))
        if "bufferView" in entry:
            values[:] = self._rows(entry, entry["componentType"], count, width)
        if "sparse" in entry:
            sparse = entry["sparse"]
            some = _count(sparse["count"])
            rows = self._rows(sparse["indices"], sparse["indices"]["componentType"], some, 1)[:, 0]
            if rows.dtype.kind != "u" or rows.max(initial=0) >= count:
                raise InputError(f"accessor {row} has no row {rows.max(initial=0)}")
            values[rows] = self._rows(sparse["values"], entry["componentType"], some, width)
        if entry.get("normalized") and entry["componentType"] in _COMPONENTS:
            component = np.dtype(_COMPONENTS[entry["componentType"]])
            if component.kind != "f":
                values = np.maximum(values / np.iinfo(component).max, -1)
        return values

    def _grow(self, more: int) -> None:
        """Count bytes of the result: accessors can be reused, and zeros need no buffer."""
        self._grown += more
        check_growth("its points", self._grown, self._size)

    def _rows(self, entry: Any, component: Any, count: int, width: int) -> NDArray[Any]:  # noqa: ANN401
        """Return rows of numbers from a part of a buffer."""
        if component not in _COMPONENTS:
            raise InputError(f"numbers of component type {component!r}")
        view = self._item("bufferViews", entry["bufferView"])
        if "EXT_meshopt_compression" in view.get("extensions", {}):
            raise InputError("its buffers are compressed by meshopt; write it without")
        whole = self._buffer(view["buffer"])
        start, length = _count(view.get("byteOffset", 0)), _count(view["byteLength"])
        content = memoryview(whole)[start : start + length]
        dtype, offset = np.dtype(_COMPONENTS[component]), _count(entry.get("byteOffset", 0))
        step = _count(view.get("byteStride", 0)) or width * dtype.itemsize
        needed = offset + step * (count - 1) + width * dtype.itemsize if count else 0
        if len(content) < length or needed > length:
            raise InputError(f"{count} rows from byte {offset} on in {len(content)} of {length} bytes")
        return np.ndarray((count, width), dtype, content, offset if count else 0, (step, dtype.itemsize))

    def _buffer(self, row: Any) -> bytes:  # noqa: ANN401
        """Return a buffer: in the file, in its text, or in a separate file."""
        entry = self._item("buffers", row)
        if row not in self._buffers:
            uri, length = entry.get("uri"), _count(entry["byteLength"])
            if uri is None:
                content = self._binary
            elif uri.startswith("data:"):
                content = base64.b64decode(uri.partition(";base64,")[2])
            else:
                content = self._beside(unquote(uri))
            if len(content) < length:
                raise InputError(f"buffer {row} has {len(content)} of {length} bytes")
            self._buffers[row] = content
            self._size += len(content)
        return self._buffers[row]

    def _beside(self, name: str) -> bytes:
        """Read a file in the folder; raise for a path outside it."""
        folder = self._folder
        is_plain = name.endswith(".bin") and name == Path(name).name and not set(name) & set("/\\:")
        if folder is None or not is_plain or (folder / name).resolve().parent != folder.resolve():
            raise InputError(f"its buffer {name!r} is no .bin file beside it; put it there, or write GLB")
        return read_content(folder / name)


def _attributes(primitive: Any) -> tuple[Any, ...]:  # noqa: ANN401
    """Return the accessors of points, normals and colours; None for a missing one."""
    if "KHR_draco_mesh_compression" in primitive.get("extensions", {}):
        raise InputError("its meshes are compressed by Draco; write it without")
    attributes = primitive["attributes"]
    return attributes["POSITION"], attributes.get("NORMAL"), attributes.get("COLOR_0")


def _count(value: Any) -> int:  # noqa: ANN401 - whatever stands in the file
    if type(value) is not int or value < 0:
        raise InputError(f"{value!r}, where a whole number from 0 on belongs")
    return value


def _local(node: Any) -> FloatArray:  # noqa: ANN401
    """Return the matrix of a node: the stored one, or that of translation, rotation and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = np.array(node.get("rotation", [0, 0, 0, 1]), dtype=np.float64)
    matrix[:3, :3] = turn(x, y, z, w) * np.array(node.get("scale", [1, 1, 1]), dtype=np.float64).reshape(3)
    matrix[:3, 3] = np.array(node.get("translation", [0, 0, 0]), dtype=np.float64).reshape(3)
    return matrix
