"""E57 (ASTM E2807): pages with checksums, a description in XML, and points as streams of bits in packets."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, BinaryIO, TypeAlias
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from cgroup import _core
from cgroup._checks.arrays import as_place, contiguous
from cgroup._checks.values import run_options
from cgroup.errors import InputError
from cgroup.io.files import check_growth
from cgroup.io.transforms import from_quaternions
from cgroup.rigid import apply
from cgroup.rigid.transforms import quaternions
from cgroup.types import FloatArray
from cgroup.types.point_cloud import PointCloud, join_clouds

PAGE, USED = 1024, 1020  # bytes of a page, and of these before its checksum
_PAGES = 4096  # whose checksums are computed at a time
_LONGEST_XML = 16 << 20

# Name, pose (4,4), number of points, and blocks: points, normals, colours, intensities; None if absent
Scan: TypeAlias = tuple[str, FloatArray, int, Iterable[Sequence[Any]]]
_KINDS = (np.float64, np.float64, np.uint8, np.float32)

_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_NORMAL = ("normalX", "normalY", "normalZ")  # of the extension for surface normals
_COLOR = ("colorRed", "colorGreen", "colorBlue")
_INVALID = {_CARTESIAN: "cartesianInvalidState", _SPHERICAL: "sphericalInvalidState"}
_INTENSITY, _UNKNOWN = "intensity", "isIntensityInvalid"
_TAKEN = {*_CARTESIAN, *_SPHERICAL, *_NORMAL, *_COLOR, *_INVALID.values(), _INTENSITY, _UNKNOWN}


def parse_e57(content: bytes) -> PointCloud:
    """Return the points of all scans in the frame of the file."""
    with np.errstate(all="ignore"):  # numbers of files may be any
        pages = checked_pages(content)
        data, root = pages[:, :USED].tobytes(), parse_xml(description(pages))
        scans = [_StoredScan(data, entry) for entry in _children(root, "data3D")]
        scans = [scan for scan in scans if scan.count]
        check_growth("its points", 8 * sum(scan.count * len(scan.taken) for scan in scans), len(content))
        if sum(scan.length for scan in scans) > len(data):
            raise InputError("its scans overlap in the file")
        return join_clouds([scan.read() for scan in scans])


def unread_fields(file: BinaryIO) -> list[str]:
    """Return the names of the fields that `parse_e57` does not read; none for a damaged file."""
    try:
        content = np.memmap(file, np.uint8, "r")
        root = parse_xml(description(content[: len(content) // PAGE * PAGE].reshape(-1, PAGE)))
    except (ValueError, struct.error, ET.ParseError):
        return []
    scans = [_child(entry, "points") for entry in _children(root, "data3D")]
    names = [_name(leaf) for points in scans if points is not None for leaf in _children(points, "prototype")]
    return [name for name in dict.fromkeys(names) if name not in _TAKEN]


def checked_pages(content: Any) -> NDArray[np.uint8]:  # noqa: ANN401 - bytes, or a file in memory
    """Return the pages (n,1024) of a file; raise for a wrong checksum."""
    if bytes(content[:8]) != b"ASTM-E57":
        raise InputError("doesn't begin with ASTM-E57")
    major, _, length, page = struct.unpack_from("<IIQ16xQ", content, 8)
    if (major, page) != (1, PAGE):
        raise InputError(
            f"version {major} with pages of {page} bytes; version 1 with pages of {PAGE} is read"
        )
    if length > len(content) or length % PAGE:
        raise InputError(f"{len(content)} of {length} bytes")
    pages = np.frombuffer(content, np.uint8, length).reshape(-1, PAGE)
    for first in range(0, len(pages), _PAGES):
        wrong = _core.wrong_page(pages[first : first + _PAGES])
        if wrong is not None:
            raise InputError(
                f"page {first + wrong} does not match its checksum: the file is damaged, copy it again"
            )
    return pages


def logical(address: int) -> int:
    """Return the offset of a byte of the file within the content of the pages."""
    return address // PAGE * USED + min(address % PAGE, USED)


def description(pages: NDArray[np.uint8]) -> bytes:
    """Return the XML of a file."""
    address, length = struct.unpack_from("<24xQQ", pages.data)
    part = pages[address // PAGE : address // PAGE + min(length, _LONGEST_XML) // USED + 2, :USED].tobytes()
    text = part[address % PAGE :][:length]
    if len(text) < length or length > _LONGEST_XML:
        raise InputError(f"a description of {length} bytes")
    return text


def parse_xml(text: bytes) -> Element:
    if b"<!DOCTYPE" in text:  # entities could expand to any size
        raise InputError("its description has a document type, which E57 has not")
    return ET.fromstring(text.decode())  # noqa: S314 - of bounded size, and without entities


def _name(entry: Element) -> str:
    return entry.tag.rpartition("}")[2]


def _child(entry: Element | None, name: str) -> Element | None:
    return next((child for child in (() if entry is None else entry) if _name(child) == name), None)


def _children(entry: Element, name: str) -> list[Element]:
    child = _child(entry, name)
    return [] if child is None else list(child)


def _number(entry: Element | None, name: str) -> float:
    """Return the number in a child element; 0 if it is empty."""
    child = _child(entry, name)
    return float((child.text if child is not None else None) or 0)


class _StoredScan:
    def __init__(self, data: bytes, entry: Element) -> None:
        points = _child(entry, "points")
        if points is None:
            raise InputError("a scan without points")
        self._data, self._entry, self._leaves = data, entry, _children(points, "prototype")
        names = [_name(leaf) for leaf in self._leaves]
        again = next((name for name, times in Counter(names).items() if times > 1), None)
        if again is not None:
            raise InputError(f"a scan with several fields {again}")
        self.taken = [name for name in names if name in _TAKEN]
        self.count = int(points.get("recordCount", ""))
        if self.count == 0:  # nothing need be where its records would be
            return
        self._start = logical(int(points.get("fileOffset", "")))
        if self.count < 0 or self._start < 0:
            raise InputError(f"{self.count} points from byte {self._start} on")
        kind, self.length, first = struct.unpack_from("<B7xQQ", data, self._start)
        self._packets = logical(first)
        if kind != 1 or self._start + self.length > len(data):
            raise InputError(f"points of {self.length} bytes from byte {self._start} on")

    def read(self) -> PointCloud:
        """Return the points that are valid, and NaN for the others."""
        names = next((names for names in _INVALID if {*names} <= {*self.taken}), None)
        if names is None:
            raise InputError(f"a scan of {', '.join(map(_name, self._leaves))}; no points")
        fields = [self._field(leaf) if _name(leaf) in _TAKEN else None for leaf in self._leaves]
        section, options = (self._packets, self._start + self.length), run_options(threads=1)
        unpacked = _core.unpack_e57(self._data, section, fields, self.count, options)
        columns = dict(zip(self.taken, unpacked, strict=True))
        points = np.stack([columns[name] for name in names], axis=1)
        if names == _SPHERICAL:
            distance, azimuth, elevation = points.T
            across = distance * np.cos(elevation)
            directions = (across * np.cos(azimuth), across * np.sin(azimuth), distance * np.sin(elevation))
            points = np.stack(directions, axis=1)
        invalid = columns.get(_INVALID[names])
        if invalid is not None:
            points[invalid != 0] = np.nan
        normals, place = _stack(columns, _NORMAL), None
        pose = _child(self._entry, "pose")
        if pose is not None:
            matrix = pose_of(pose)
            points = apply(matrix, points)
            normals = None if normals is None else normals @ matrix[:3, :3].T
            # Where a writer knows no place, it is the origin.
            place = matrix[:3, 3] if matrix[:3, 3].any() else None
        strengths = columns.get(_INTENSITY)
        if strengths is not None:
            strengths = np.where(columns.get(_UNKNOWN, 0) == 0, strengths, np.nan).astype(np.float32)
        return PointCloud(points, normals, None, _stack(columns, _COLOR), 0, place, strengths)

    def _field(self, leaf: Element) -> tuple[str, int, int, int, float, float, tuple[float, float] | None]:
        """Return how the core unpacks a field; colours by the limits of the scan or the field."""
        name, kind, limits = _name(leaf), leaf.get("type", ""), None
        if name in _COLOR:
            declared = _child(self._entry, "colorLimits")
            if declared is None:
                limits = float(leaf.get("minimum", 0)), float(leaf.get("maximum", 255))
            else:
                limits = _number(declared, f"{name}Minimum"), _number(declared, f"{name}Maximum")
        if kind == "Float":
            return name, 4 if leaf.get("precision") == "single" else 8, 0, 0, 1.0, 0.0, limits
        if kind not in {"Integer", "ScaledInteger"}:
            return name, 0, 0, 0, 1.0, 0.0, limits
        least, most = int(leaf.get("minimum", -(2**63))), int(leaf.get("maximum", 2**63 - 1))
        if not -(2**63) <= least <= most < 2**63:
            raise InputError(f"{name}: from {least} to {most}")
        if kind == "Integer":
            return name, 0, least, most, 1.0, 0.0, limits
        return name, 0, least, most, float(leaf.get("scale", 1)), float(leaf.get("offset", 0)), limits


def _stack(columns: dict[str, NDArray[Any]], names: tuple[str, ...]) -> NDArray[Any] | None:
    return np.stack([columns[name] for name in names], axis=1) if columns.keys() >= set(names) else None


def pose_of(pose: Element) -> FloatArray:
    """Return the matrix that moves a scan into the frame of the file."""
    place, turn = (_child(pose, name) for name in ("translation", "rotation"))
    x, y, z = (_number(place, axis) for axis in "xyz")
    rotation = [0.0, 0.0, 0.0, 1.0] if turn is None else [_number(turn, axis) for axis in "xyzw"]
    return from_quaternions("pose", np.array([[x, y, z, *rotation]]))[0]


def scan_of(name: str, cloud: PointCloud, pose: FloatArray | None = None) -> Scan:
    """Return a cloud moved by a pose (4,4); a viewpoint is the origin of its frame, unless it is far away."""
    moved, points = np.eye(4) if pose is None else pose.copy(), cloud.points
    if cloud.viewpoint is not None:
        place = np.array(as_place("cloud.viewpoint", cloud.viewpoint))
        near, most = points - place, np.abs(points).max(initial=0.0)
        if np.abs(near + place - points).max(initial=0.0) <= 2.0**-30 * most:
            moved[:3, 3], points = apply(moved, place[None])[0], near
    return name, moved, len(points), [(points, cloud.normals, cloud.colors, cloud.intensities)]


def write_e57(out: BinaryIO, scans: Iterable[Scan]) -> None:
    writer = _core.E57Writer()
    for name, pose, count, blocks in scans:
        turn = np.roll(quaternions(pose[None, :3, :3])[0], 1)  # w x y z
        writer.begin(name.encode("utf-8", "replace").decode(), (pose[:3, 3].tolist(), turn.tolist()), count)
        out.writelines(writer.add(*map(contiguous, block, _KINDS)) for block in blocks)
    rest, first = writer.finish()
    out.write(rest)
    out.seek(0)
    out.write(first)
