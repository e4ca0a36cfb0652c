"""Clouds as trimesh and pypcd4 read them: what the package's own readers are held against."""

import io
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pypcd4
from numpy.typing import ArrayLike, NDArray
from trimesh.exchange.obj import load_obj
from trimesh.exchange.off import load_off
from trimesh.exchange.ply import load_ply
from trimesh.exchange.stl import load_stl

from cgroup.types import FloatArray, PointCloud


def _points(array: ArrayLike) -> FloatArray:
    points = np.asarray(array, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        message = f"points have shape {points.shape} instead of (N, 3)"
        raise ValueError(message)
    return points


def _numbers(content: bytes) -> FloatArray:
    text = re.sub("[,;]", " ", content.decode())
    return np.loadtxt(io.StringIO(text), dtype=np.float64, comments=("#", "//"), ndmin=2)


def parse_text(content: bytes) -> PointCloud:
    """Read x y z from the first three columns."""
    return PointCloud(_points(_numbers(content)[:, :3]))


def parse_ply(content: bytes) -> PointCloud:
    """Read vertices, their normals and colours, and faces."""
    loaded = load_ply(io.BytesIO(content), fix_texture=False, skip_materials=True)
    elements = loaded["metadata"]["_ply_raw"]
    for name in ("vertex", "face"):
        declared = elements.get(name, {}).get("length", 0)
        found = _rows(elements[name].get("data")) if declared else 0
        if found != declared:
            message = f"{name} {found} of {declared} is the last"
            raise ValueError(message)
    return _from_trimesh(loaded)


def _rows(data: Any) -> int:
    columns = list(data.values()) if isinstance(data, dict) else [data]
    return min((len(column) for column in columns if column is not None), default=0)


def parse_off(content: bytes) -> PointCloud:
    """Read vertices and faces."""
    return _from_trimesh(load_off(io.BytesIO(content)))


def parse_obj(content: bytes) -> PointCloud:
    """Read vertices and faces of all parts."""
    loaded = load_obj(io.BytesIO(content), skip_materials=True, group_material=False, maintain_order=True)
    parts = [_from_trimesh(part) for part in loaded.get("geometry", {"": loaded}).values()]
    points = np.concatenate([np.empty((0, 3)), *(part.points for part in parts)])
    starts = np.cumsum([0, *(len(part.points) for part in parts)])[:-1]
    faces = [part.faces + i for part, i in zip(parts, starts, strict=True) if part.faces is not None]
    return _without_repeats(PointCloud(points, faces=np.concatenate(faces) if faces else None))


def parse_stl(content: bytes) -> PointCloud:
    """Read triangles, corners of equal coordinates made one."""
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


def parse_pcd(content: bytes) -> PointCloud:
    """Read points, their normals and colours."""
    loaded = pypcd4.PointCloud.from_fileobj(io.BytesIO(_modern_pcd(content)))
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
    colors = None if packed is None else _unpack_colors(np.ascontiguousarray(data[packed]))
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


def _unpack_colors(packed: NDArray[Any]) -> NDArray[np.uint8]:
    """PCL packs 0x00RRGGBB into four bytes, often called a float."""
    bits = packed.view(np.uint32) if packed.dtype.itemsize == 4 else packed.astype(np.uint32)
    return np.stack([bits >> 16 & 255, bits >> 8 & 255, bits & 255], axis=1).astype(np.uint8)


PARSERS: dict[str, Callable[[bytes], PointCloud]] = {
    ".obj": parse_obj,
    ".off": parse_off,
    ".pcd": parse_pcd,
    ".ply": parse_ply,
    ".stl": parse_stl,
    ".xyz": parse_text,
}
