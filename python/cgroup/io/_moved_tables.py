"""Move tables of points: PLY, PCD, binary STL and KITTI's scans."""

from __future__ import annotations

import io
import os
import shutil
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cgroup import _core
from cgroup._checks.values import run_options
from cgroup.errors import InputError
from cgroup.io._motion import XYZ, Motion, Mover
from cgroup.io._moved_texts import lines_of, move_rows, move_stl_text, point_blocks
from cgroup.io.files import check_growth
from cgroup.rigid import apply
from cgroup.rigid.transforms import quaternions, turn

_CHUNK = 16 << 20  # bytes of records that are moved at a time
_LONGEST_LINE = 1 << 20  # of a header
_SIZES = {
    "char": "i1",
    "short": "i2",
    "int": "i4",
    "uchar": "u1",
    "ushort": "u2",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "float32": "f4",
    "float64": "f8",
    **{f"{sign}int{8 * size}": f"{sign or 'i'}{size}" for sign in ("", "u") for size in (1, 2, 4)},
}
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_TRIANGLE = np.dtype([("rows", "<f4", (4, 3)), ("attributes", "<u2")])  # of STL: normal and corners
_WIDENED = "x y z: written in double precision, as single precision has too few digits there"


class _Table(NamedTuple):
    """Records of a file: their number, and types by name; of a list those of its count and items."""

    rows: int
    kinds: dict[str, str]
    is_text: bool

    @property
    def is_fixed(self) -> bool:
        """Whether all records are of one size."""
        return not any(" " in kind for kind in self.kinds.values())

    def mover(self, motion: Motion) -> Mover:
        return Mover(motion, self.kinds if self.is_fixed else ())

    def needs_double(self, motion: Motion, source: BinaryIO) -> bool:
        """Read the records, and return whether moved positions need wider numbers than they have."""
        is_narrow = self.kinds.keys() >= {*XYZ} and any(self.kinds[axis][-2:] != "f8" for axis in XYZ)
        if not is_narrow or not self.is_fixed:
            with open(os.devnull, "wb") as nowhere:  # noqa: PTH123
                self.copy(source, nowhere)
            return False
        if self.is_text:
            columns = [[*self.kinds].index(axis) for axis in XYZ]
            return motion.needs_double(point_blocks(islice(lines_of(source), self.rows), columns))
        blocks = _records(source, np.dtype([*self.kinds.items()]), self.rows)
        return motion.needs_double(np.stack([part[axis] for axis in XYZ], axis=1) for part in blocks)

    def move(self, motion: Motion, source: BinaryIO, out: BinaryIO, *, is_wide: bool) -> None:
        """Move records by chunks."""
        if self.is_text:
            move_rows(motion, islice(lines_of(source), self.rows), out, {"": [*self.kinds]})
            return
        kinds = {
            name: f"{kind[0]}f8" if is_wide and name in XYZ else kind for name, kind in self.kinds.items()
        }
        written, mover = np.dtype([*kinds.items()]), self.mover(motion)
        for records in _records(source, np.dtype([*self.kinds.items()]), self.rows):
            moved = records.astype(written)
            mover.move(moved)
            out.write(moved.tobytes())

    def copy(self, source: BinaryIO, out: Any) -> None:  # noqa: ANN401 - whatever has write
        """Copy records."""
        if self.is_text:
            for line in islice(source, self.rows):
                out.write(line)
            return
        if self.is_fixed:
            for records in _records(source, np.dtype([*self.kinds.items()]), self.rows):
                out.write(records.tobytes())
            return
        sizes = [[np.dtype(word) for word in kind.split()] for kind in self.kinds.values()]
        for _ in range(self.rows):
            for kind, *items in sizes:
                first = _read(source, kind, 1)
                out.write(
                    first.tobytes() + b"".join(_read(source, one, int(first[0])).tobytes() for one in items)
                )


def _read(source: BinaryIO, kind: np.dtype[Any], count: int) -> NDArray[Any]:
    content = source.read(count * kind.itemsize)
    if len(content) < count * kind.itemsize:
        raise InputError(f"the end of the file after {len(content) // kind.itemsize} of {count} records")
    return np.frombuffer(content, kind).copy()


def _records(source: BinaryIO, kind: np.dtype[Any], count: int) -> Iterator[NDArray[Any]]:
    most = max(1, _CHUNK // kind.itemsize)
    return (_read(source, kind, min(most, count - first)) for first in range(0, count, most))


def move_ply(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Move all elements of fixed size that have positions, directions or splats."""
    header, tables, lines = _ply_header(source)
    movers = [table.mover(motion) for table in tables]
    if not any({*XYZ} <= mover.names for mover in movers):
        raise InputError("no element has x, y and z as plain numbers")
    tables = tables[: max(at + 1 for at, mover in enumerate(movers) if mover.names)]
    start, wide = source.tell(), [table.needs_double(motion, source) for table in tables]
    source.seek(start)
    for at in (at for at, is_wide in enumerate(wide) if is_wide):
        motion.note(_WIDENED)
        for row in (lines[at][axis] for axis in XYZ):
            words = header[row].split()
            header[row] = b" ".join([words[0], b"double", words[2]]) + b"\n"
    out.write(b"".join(header))
    for table, mover, is_wide in zip(tables, movers, wide, strict=False):
        if mover.names:
            table.move(motion, source, out, is_wide=is_wide)
        else:
            table.copy(source, out)
    shutil.copyfileobj(source, out, _CHUNK)


def _ply_header(source: BinaryIO) -> tuple[list[bytes], list[_Table], list[dict[str, int]]]:
    """Return the lines of a header, the elements, and the line of each property by name."""
    header, order, tables, lines = list[bytes](), "", list[_Table](), list[dict[str, int]]()
    while not header or header[-1].strip() != b"end_header":
        header.append(source.readline(_LONGEST_LINE))
        words = header[-1].decode("latin-1").split()
        if not header[-1] or (len(header) == 1 and words != ["ply"]):
            raise InputError("no header of PLY")
        if words[:1] == ["format"]:
            order = _ORDERS[words[1]]
        elif words[:1] == ["element"]:
            tables.append(_Table(int(words[2]), {}, order == "="))
            lines.append({})
        elif words[:1] == ["property"]:
            types = words[2:4] if words[1] == "list" else words[1:2]
            if lines[-1].setdefault(words[-1].lower(), len(header) - 1) != len(header) - 1:
                raise InputError(f"two properties {words[-1]}")
            tables[-1].kinds[words[-1].lower()] = " ".join(order + _SIZES[word] for word in types)
    return header, tables, lines


def move_pcd(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Move points, normals and the viewpoint; a compressed file becomes a binary one."""
    header, entries, table = _pcd_header(source)
    data = entries["DATA"][0]
    if not table.kinds.keys() >= {*XYZ}:
        raise InputError("no fields x, y and z")
    if data == "binary_compressed":
        source = io.BytesIO(_unpack_pcd(source, table, entries))
        motion.note("compression: written as binary PCD")
    start, is_wide = source.tell(), table.needs_double(motion, source)
    source.seek(start)
    if is_wide:
        motion.note(_WIDENED)
        fields = [name.lower() for name in entries["FIELDS"]]
        for key, word in (("SIZE", "8"), ("TYPE", "F")):
            entries[key] = [
                word if name in XYZ else one for name, one in zip(fields, entries[key], strict=True)
            ]
    if "VIEWPOINT" in entries:
        entries["VIEWPOINT"] = _move_viewpoint(motion, entries["VIEWPOINT"])
    entries["DATA"] = ["ascii" if table.is_text else "binary"]
    for line in header:
        key = line.partition(" ")[0].strip()
        words = entries.get(key)
        out.write((line if words is None else " ".join([key, *words]) + "\n").encode("latin-1"))
    table.move(motion, source, out, is_wide=is_wide)


def _pcd_header(source: BinaryIO) -> tuple[list[str], dict[str, list[str]], _Table]:
    """Return the lines of a header, their words by key, and the table of its fields."""
    header, entries = list[str](), dict[str, list[str]]()
    while "DATA" not in entries:
        header.append(source.readline(_LONGEST_LINE).decode("latin-1"))
        key, *words = header[-1].split() or [""]
        entries["FIELDS" if key == "COLUMNS" else key] = words
        if not header[-1]:
            raise InputError("no header of PCD")
    fields = entries["FIELDS"]
    counts = map(int, entries.get("COUNT", ["1"] * len(fields)))
    kinds: dict[str, str] = {}
    for name, size, kind, count in zip(fields, entries["SIZE"], entries["TYPE"], counts, strict=True):
        for k in range(count):
            plain = name.lower() if count == 1 and name != "_" else f"{name} {k}"
            unique = plain if plain not in kinds else f"{plain} {len(kinds)}"
            kinds[unique] = f"<{kind.lower()}{size}"
    rows = (
        int(entries["POINTS"][0])
        if "POINTS" in entries
        else int(entries["WIDTH"][0]) * int(entries["HEIGHT"][0])
    )
    return header, entries, _Table(rows, kinds, entries["DATA"] == ["ascii"])


def _move_viewpoint(motion: Motion, words: Sequence[str]) -> list[str]:
    """Return the viewpoint tx ty tz qw qx qy qz; the position 0 0 0, an unknown one, stays."""
    numbers = np.array([float(word) for word in words])
    if not numbers[:3].any():
        motion.note("VIEWPOINT: not moved; 0 0 0 is an unknown position")
        return [*words]
    x, y, z, w = np.roll(numbers[3:] / np.linalg.norm(numbers[3:]), -1)
    turned = quaternions((motion.turning @ turn(x, y, z, w))[None])[0]
    place = apply(motion.matrix, numbers[None, :3])[0]
    return [repr(number) for number in [*place.tolist(), *np.roll(turned, 1).tolist()]]


def _unpack_pcd(source: BinaryIO, table: _Table, entries: dict[str, list[str]]) -> bytes:
    """Return the records of compressed data, which has one field after the other."""
    packed, size = np.frombuffer(source.read(8), "<u4").tolist()
    content = source.read(packed)
    check_growth("its points", size, packed)
    counts = entries.get("COUNT", ["1"] * len(entries["FIELDS"]))
    widths = [int(one) * int(count) for one, count in zip(entries["SIZE"], counts, strict=True)]
    if len(content) < packed or size != table.rows * sum(widths):
        raise InputError(f"{len(content)} of {packed} bytes for {table.rows} points")
    plain = np.frombuffer(_core.decompress_lzf(content, size, run_options(threads=1)), np.uint8)
    ends = np.cumsum(widths) * table.rows
    columns = [
        plain[end - width * table.rows : end].reshape(table.rows, width)
        for end, width in zip(ends, widths, strict=True)
    ]
    return np.concatenate(columns, axis=1).tobytes()


def move_stl(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Move triangles and their normals."""
    head = source.read(84)
    count = int.from_bytes(head[80:84], "little")
    if source.seek(0, os.SEEK_END) < 84 + 50 * count or len(head) < 84:
        if not head.lstrip().lower().startswith(b"solid"):
            raise InputError("neither binary nor ASCII")
        source.seek(0)
        move_stl_text(motion, source, out)
        return
    for is_first in (True, False):
        source.seek(84)
        blocks = _records(source, _TRIANGLE, count)
        if is_first:
            _refuse_double(motion, motion.needs_double(one["rows"][:, 1:].reshape(-1, 3) for one in blocks))
            out.write(head)
            continue
        for records in blocks:
            rows = records["rows"].astype(float)
            records["rows"][:, 1:] = apply(motion.matrix, rows[:, 1:].reshape(-1, 3)).reshape(-1, 3, 3)
            records["rows"][:, 0] = rows[:, 0] @ motion.turning.T
            out.write(records.tobytes())


def move_bin(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Move a scan of KITTI: x y z reflectance in single precision."""
    rows, left = divmod(source.seek(0, os.SEEK_END), 16)
    if left:
        raise InputError(f"{left} bytes after {rows} points of 16 bytes")
    table = _Table(rows, dict.fromkeys((*XYZ, "reflectance"), "<f4"), is_text=False)
    source.seek(0)
    _refuse_double(motion, table.needs_double(motion, source))
    source.seek(0)
    table.move(motion, source, out, is_wide=False)


def _refuse_double(motion: Motion, is_needed: bool) -> None:  # noqa: FBT001
    if is_needed:
        reach = float(np.abs(motion.matrix[:3, 3]).max())
        raise InputError(
            f"has single precision, too few digits for a move by {reach:.6g}; convert it to PLY first"
        )
