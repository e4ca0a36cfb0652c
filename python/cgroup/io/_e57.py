"""E57 (ASTM E2807): pages with checksums, a description in XML, and points as streams of bits in packets."""

from __future__ import annotations

import struct
from collections import Counter
from typing import Any, BinaryIO, NamedTuple
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from cgroup.errors import InputError
from cgroup.io.files import check_growth
from cgroup.io.transforms import from_quaternions
from cgroup.rigid import apply
from cgroup.types import FloatArray
from cgroup.types.point_cloud import PointCloud, join_clouds

PAGE, USED = 1024, 1020  # bytes of a page, and of these before its checksum
_PAGES = 4096  # whose checksums are computed at a time
_RECORDS = 1 << 20  # unpacked at a time
_LONGEST_XML = 16 << 20
_DATA_PACKET = 1

_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_NORMAL = ("normalX", "normalY", "normalZ")  # of the extension for surface normals
_COLOR = ("colorRed", "colorGreen", "colorBlue")
_INVALID = ("cartesianInvalidState", "sphericalInvalidState")
_TAKEN = {*_CARTESIAN, *_SPHERICAL, *_NORMAL, *_COLOR, *_INVALID}


class _Field(NamedTuple):
    entry: Element
    kind: str
    bits: int
    least: int

    def unpack(self, stream: bytes, count: int) -> FloatArray:
        """Return the numbers of all records."""
        if 8 * len(stream) < count * self.bits:
            raise InputError(
                f"{_name(self.entry)}: {len(stream)} bytes for {count} points of {self.bits} bits"
            )
        if self.kind == "Float":
            return np.frombuffer(stream, f"<f{self.bits // 8}", count).astype(np.float64)
        plain = np.frombuffer(stream + bytes(9), np.uint8)
        values = np.empty(count)
        for first in range(0, count, _RECORDS):
            part = slice(first, min(first + _RECORDS, count))
            values[part] = _integers(plain, part, self.bits, self.least)
        if self.kind == "ScaledInteger":
            values = values * float(self.entry.get("scale", 1)) + float(self.entry.get("offset", 0))
        return values


def parse_e57(content: bytes) -> PointCloud:
    """Return the points of all scans in the frame of the file."""
    with np.errstate(all="ignore"):  # numbers of files may be any
        pages = checked_pages(content)
        data, root = pages[:, :USED].tobytes(), parse_xml(description(pages))
        scans = [_Scan(data, entry) for entry in _children(root, "data3D")]
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
        block = pages[first : first + _PAGES]
        wrong = np.flatnonzero(_checksums(block[:, :USED]) != block[:, USED:].copy().view(">u4")[:, 0])
        if len(wrong):
            raise InputError(
                f"page {first + wrong[0]} does not match its checksum: the file is damaged, copy it again"
            )
    return pages


def seal_pages(content: bytes) -> bytes:
    """Return content as pages with their checksums."""
    pages = np.frombuffer(content + bytes(-len(content) % USED), np.uint8).reshape(-1, USED)
    return np.concatenate([pages, _checksums(pages).astype(">u4")[:, None].view(np.uint8)], axis=1).tobytes()


def _checksums(pages: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """CRC-32C of each row."""
    sums = np.full(len(pages), 0xFFFFFFFF, np.uint32)
    for column in np.ascontiguousarray(pages.T):
        sums = _CRC[(sums ^ column) & 255] ^ (sums >> np.uint32(8))
    return ~sums


def _crc_table() -> NDArray[np.uint32]:
    table = np.arange(256, dtype=np.uint32)
    for _ in range(8):
        table = np.where(table & 1, (table >> 1) ^ np.uint32(0x82F63B78), table >> 1)
    return table


_CRC = _crc_table()


def logical(address: int) -> int:
    """Return the offset of a byte of the file within the content of the pages."""
    return address // PAGE * USED + min(address % PAGE, USED)


def description(pages: NDArray[np.uint8]) -> bytes:
    """Return the XML of a file."""
    address, length = struct.unpack_from("<24xQQ", pages)
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


class _Scan:
    def __init__(self, data: bytes, entry: Element) -> None:
        points = _child(entry, "points")
        if points is None:
            raise InputError("a scan without points")
        self._data, self._entry = data, entry
        self._fields = [_field(leaf) for leaf in _children(points, "prototype")]
        names = [_name(field.entry) for field in self._fields]
        again = next((name for name, times in Counter(names).items() if times > 1), None)
        if again is not None:
            raise InputError(f"a scan with several fields {again}")
        self.taken = {row: name for row, name in enumerate(names) if name in _TAKEN}
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
        columns = self._columns()
        points, names = _stack(columns, _CARTESIAN), "cartesian"
        if points is None:
            polar, names = _stack(columns, _SPHERICAL), "spherical"
            if polar is None:
                raise InputError(
                    f"a scan of {', '.join(_name(field.entry) for field in self._fields)}; no points"
                )
            distance, azimuth, elevation = polar.T
            across = distance * np.cos(elevation)
            directions = (across * np.cos(azimuth), across * np.sin(azimuth), distance * np.sin(elevation))
            points = np.stack(directions, axis=1)
        invalid = columns.get(f"{names}InvalidState")
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
        return PointCloud(points, normals, colors=self._colors(columns), viewpoint=place)

    def _columns(self) -> dict[str, FloatArray]:
        """Return the numbers of the used fields, by name."""
        streams = {row: bytearray() for row in self.taken}
        place, end = self._packets, self._start + self.length
        while place < end:
            kind, last = struct.unpack_from("<BxH", self._data, place)
            packet = memoryview(self._data)[place : min(place + last + 1, end)]
            if len(packet) <= last or len(packet) % 4:
                raise InputError(f"a packet of {last + 1} bytes")
            place += len(packet)
            if kind == _DATA_PACKET:
                _add(streams, packet, len(self._fields))
        return {
            name: self._fields[row].unpack(bytes(streams[row]), self.count)
            for row, name in self.taken.items()
        }

    def _colors(self, columns: dict[str, FloatArray]) -> NDArray[np.uint8] | None:
        """Return colours as bytes, by the declared limits of the scan or the fields."""
        colors = _stack(columns, _COLOR)
        if colors is None:
            return None
        limits = _child(self._entry, "colorLimits")
        ranges: list[tuple[float, float]] = []
        for name in _COLOR:
            field = next(field for field in self._fields if _name(field.entry) == name)
            if limits is not None:
                ranges.append((_number(limits, f"{name}Minimum"), _number(limits, f"{name}Maximum")))
            else:
                low, high = (float(field.entry.get(word, default)) for word, default in _BYTES)
                ranges.append((low, high))
        low, high = np.array(ranges).T
        shares = (colors - low) / np.where(high > low, high - low, 1)
        return np.rint(255 * np.clip(np.nan_to_num(shares), 0, 1)).astype(np.uint8)


_BYTES = (("minimum", "0"), ("maximum", "255"))


def _field(entry: Element) -> _Field:
    kind = entry.get("type", "")
    if kind == "Float":
        return _Field(entry, kind, 32 if entry.get("precision") == "single" else 64, 0)
    if kind not in {"Integer", "ScaledInteger"}:
        return _Field(entry, kind, 0, 0)
    least, most = int(entry.get("minimum", -(2**63))), int(entry.get("maximum", 2**63 - 1))
    bits = (most - least).bit_length()
    if most < least or bits > 64:
        raise InputError(f"{_name(entry)}: from {least} to {most}")
    return _Field(entry, kind, bits, least)


def _add(streams: dict[int, bytearray], packet: memoryview, fields: int) -> None:
    """Append a packet's data to each stream."""
    (count,) = struct.unpack_from("<4xH", packet)
    lengths = np.frombuffer(packet, "<u2", count, offset=6)
    ends = np.cumsum(lengths, dtype=np.int64) + 6 + 2 * count
    if count != fields or (count and ends[-1] > len(packet)):
        raise InputError(f"a packet of {len(packet)} bytes with {count} streams for {fields} fields")
    for row in streams:
        streams[row] += packet[ends[row] - lengths[row] : ends[row]]


def _integers(plain: NDArray[np.uint8], records: slice, bits: int, least: int) -> NDArray[np.int64]:
    """Return numbers of equal width in bits, from the lowest bit of the first byte."""
    starts = np.arange(records.start, records.stop, dtype=np.int64) * bits
    places, shifts = starts >> 3, (starts & 7).astype(np.uint64)
    words = np.ndarray((len(plain) - 8,), "<u8", plain, strides=(1,))[places] >> shifts
    if bits > 57:  # the last of them stand in a ninth byte
        words |= plain[places + 8].astype(np.uint64) << (np.uint64(63) - shifts) << np.uint64(1)
    words &= np.uint64(2**bits - 1)
    return (words + np.uint64(least % 2**64)).view(np.int64)


def _stack(columns: dict[str, FloatArray], names: tuple[str, ...]) -> FloatArray | None:
    return np.stack([columns[name] for name in names], axis=1) if columns.keys() >= set(names) else None


def pose_of(pose: Element) -> FloatArray:
    """Return the matrix that moves a scan into the frame of the file."""
    place, turn = (_child(pose, name) for name in ("translation", "rotation"))
    x, y, z = (_number(place, axis) for axis in "xyz")
    rotation = [0.0, 0.0, 0.0, 1.0] if turn is None else [_number(turn, axis) for axis in "xyzw"]
    return from_quaternions("pose", np.array([[x, y, z, *rotation]]))[0]
