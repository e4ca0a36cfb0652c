"""Move tables of points: PLY, PCD, STL, KITTI's scans, and texts, whose other words stay as they are."""

from __future__ import annotations

import io
import os
import shutil
import struct
from codecs import BOM_UTF8
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain, islice
from typing import Any, BinaryIO, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cgroup import _core
from cgroup._checks.values import run_options
from cgroup.errors import InputError
from cgroup.io._motion import CORNERS, NORMAL, XYZ, Motion
from cgroup.io.files import check_growth, number_lines
from cgroup.rigid import apply
from cgroup.rigid.transforms import quaternions, turn
from cgroup.types import FloatArray

_Header: TypeAlias = Callable[[Sequence[str]], bytes]  # by the names of fields that get double precision

_CHUNK = 16 << 20  # bytes of records that are moved at a time
_LINES = 1 << 14  # moved at a time
_LONGEST_LINE = 1 << 20  # of a header
_WORDS = ("char", "short", "int", "uchar", "ushort", "uint", "float", "double")
_KINDS = ("i1", "i2", "i4", "u1", "u2", "u4", "f4", "f8")
_SIZES = dict(zip(_WORDS, _KINDS, strict=True)) | {
    f"{word}{8 * size}": f"{word[0]}{size}" for word in ("int", "uint", "float") for size in (1, 2, 4, 8)
}
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_TRIANGLE = dict.fromkeys([*NORMAL, *chain(*CORNERS)], "<f4") | {"attributes": "<u2"}  # of STL
_WIDENED = "x y z: written in double precision, as their type has too few digits there"
_KITTI = dict.fromkeys([*XYZ, "reflectance"], "<f4")


class _Table(NamedTuple):
    """Records of a file: their number, and types by name; of a list those of its count and items."""

    rows: int
    kinds: dict[str, str]
    is_text: bool = False

    @property
    def names(self) -> set[str]:
        """Names of the fields; none unless all records are of one size."""
        return set() if any(" " in kind for kind in self.kinds.values()) else {*self.kinds}

    @property
    def has_points(self) -> bool:
        return {*XYZ} <= self.names

    def move(self, motion: Motion, source: BinaryIO, out: BinaryIO, wide: Sequence[str]) -> None:
        """Move records by chunks, `wide` fields in double precision; copy those with lists."""
        if self.is_text:
            layouts = {"": [*self.kinds]} if self.names else {}
            move_rows(motion, _lines(source, self.rows), out, layouts)
        elif self.names:
            kind = np.dtype([*self.kinds.items()])
            written = [(name, f"{one[0]}f8" if name in wide else one) for name, one in self.kinds.items()]
            names, most = motion.names(self.names), max(1, _CHUNK // kind.itemsize)
            for first in range(0, self.rows, most):
                block = _read(source, kind, min(most, self.rows - first)).astype(written)
                for name, values in motion.move({name: block[name] for name in names}).items():
                    block[name] = values
                out.write(block.tobytes())
        else:
            lists = [[np.dtype(word) for word in kind.split()] for kind in self.kinds.values()]
            for _ in range(self.rows if lists else 0):
                for count, *items in lists:
                    size = _read(source, count, 1)
                    out.write(size.tobytes())
                    out.writelines(_read(source, item, int(size[0])).tobytes() for item in items)


def _lines(source: BinaryIO, rows: int) -> Iterator[bytes]:
    """Yield the lines of records; blank lines and comments are not counted."""
    while rows:
        line = source.readline()
        if not line:
            raise InputError(f"the end of the file, {rows} records before that of the table")
        rows -= bool(line.strip()) and not line.startswith(b"#")
        yield line


def _read(source: BinaryIO, kind: np.dtype[Any], count: int) -> NDArray[Any]:
    content = source.read(count * kind.itemsize)
    if len(content) < count * kind.itemsize:
        raise InputError(f"the end of the file after {len(content) // kind.itemsize} of {count} records")
    return np.frombuffer(content, kind)


def _move(motion: Motion, source: BinaryIO, out: BinaryIO, tables: Sequence[_Table], header: _Header) -> None:
    """Move tables and copy the rest; begin anew in double precision if that is needed."""
    kinds = {table.kinds[axis][1:] for table in tables if table.has_points for axis in XYZ} - {"f8"}
    start = source.tell()
    for wide in ((), XYZ):
        source.seek(start)
        out.seek(0)
        out.truncate()
        out.write(header(wide))
        for table in tables:
            table.move(motion, source, out, wide if table.has_points else ())
        if not kinds or (kinds == {"f4"} and not motion.needs_double()):
            break
        motion.notes.insert(0, _WIDENED)
    shutil.copyfileobj(source, out, _CHUNK)


def move_ply(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Move all elements of fixed size that have positions, directions or splats."""
    lines, tables, places = _ply_header(source)
    if not any(table.has_points for table in tables):
        raise InputError("no element has x, y and z as plain numbers")

    def header(wide: Sequence[str]) -> bytes:
        for (at, name), row in places.items():
            if name in wide and tables[at].has_points:
                lines[row] = b"property double " + lines[row].split(None, 2)[-1]
        return b"".join(lines)

    last = max(at for at, table in enumerate(tables) if motion.names(table.names))
    _move(motion, source, out, tables[: last + 1], header)


def _ply_header(source: BinaryIO) -> tuple[list[bytes], list[_Table], dict[tuple[int, str], int]]:
    """Return the lines of a header, the elements, and the line of each property by element and name."""
    lines, order, tables, places = list[bytes](), "", list[_Table](), dict[tuple[int, str], int]()
    while not lines or lines[-1].strip() != b"end_header":
        lines.append(source.readline(_LONGEST_LINE))
        words = lines[-1].decode("latin-1").split()
        if not lines[-1] or (len(lines) == 1 and words != ["ply"]):
            raise InputError("no header of PLY")
        if words[:1] == ["format"]:
            order = _ORDERS[words[1]]
        elif words[:1] == ["element"]:
            tables.append(_Table(int(words[2]), {}, order == "="))
        elif words[:1] == ["property"]:
            types, name = words[2:4] if words[1] == "list" else words[1:2], words[-1].lower()
            if places.setdefault((len(tables) - 1, name), len(lines) - 1) != len(lines) - 1:
                raise InputError(f"two properties {name}")
            tables[-1].kinds[name] = " ".join(order + _SIZES[word] for word in types)
    return lines, tables, places


def move_pcd(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Move points, normals and the viewpoint; a compressed file becomes a binary one."""
    entries: dict[str, list[str]] = {}
    while "DATA" not in entries:
        line = source.readline(_LONGEST_LINE).decode("latin-1")
        if not line:
            raise InputError("no header of PCD")
        key, *words = [line.strip()] if line.startswith("#") else line.split() or [""]
        entries[key if key.startswith("#") else key.upper()] = words
    entries["DATA"] = [word.lower() for word in entries["DATA"]]
    names = [name.lower() for name in entries.get("FIELDS", entries.get("COLUMNS", []))]
    counts = [int(word) for word in entries.get("COUNT", ["1"] * len(names))]
    table = _pcd_table(names, counts, entries)
    if not table.has_points:
        raise InputError("no fields x, y and z")
    if entries["DATA"] not in (["ascii"], ["binary"], ["binary_compressed"]):
        raise InputError(f"its DATA is {' '.join(entries['DATA'])!r}")
    if entries["DATA"] == ["binary_compressed"]:
        widths = [int(size) * count for size, count in zip(entries["SIZE"], counts, strict=True)]
        source = _unpack_pcd(source, table.rows, widths)
        entries["DATA"] = ["binary"]
        motion.notes.append("compression: written as binary PCD")

    def header(wide: Sequence[str]) -> bytes:
        written = dict(entries)
        for key, word in (("SIZE", "8"), ("TYPE", "F")):
            words = zip(names, entries[key], strict=True)
            written[key] = [word if name in wide else one for name, one in words]
        if "VIEWPOINT" in entries:
            written["VIEWPOINT"] = _move_viewpoint(motion, entries["VIEWPOINT"])
        return "".join(f"{' '.join([key, *words])}\n" for key, words in written.items()).encode("latin-1")

    _move(motion, source, out, [table], header)


def _pcd_table(names: Sequence[str], counts: Sequence[int], entries: dict[str, list[str]]) -> _Table:
    kinds: dict[str, str] = {}
    for name, size, kind, count in zip(names, entries["SIZE"], entries["TYPE"], counts, strict=True):
        for k in range(count):
            unique = name if count == 1 and name not in kinds else f"{name} {k} {len(kinds)}"
            kinds[unique] = f"<{kind.lower()}{size}"
    rows = entries.get("POINTS") or [int(entries["WIDTH"][0]) * int(entries["HEIGHT"][0])]
    return _Table(int(rows[0]), kinds, entries["DATA"] == ["ascii"])


def _unpack_pcd(source: BinaryIO, rows: int, widths: Sequence[int]) -> BinaryIO:
    """Return the records of compressed data, which has one field after the other."""
    packed, size = struct.unpack("<II", source.read(8))
    content = source.read(packed)
    check_growth("its points", size, packed)
    if len(content) < packed or size != rows * sum(widths):
        raise InputError(f"{len(content)} of {packed} bytes for {rows} points")
    plain = np.frombuffer(_core.decompress_lzf(content, size, run_options(threads=1)), np.uint8)
    fields = zip(np.split(plain, rows * np.cumsum(widths)[:-1]), widths, strict=True)
    return io.BytesIO(np.hstack([field.reshape(rows, width) for field, width in fields]).tobytes())


def _move_viewpoint(motion: Motion, words: Sequence[str]) -> list[str]:
    """Return the viewpoint tx ty tz qw qx qy qz; the position 0 0 0, an unknown one, stays."""
    numbers = np.array([float(word) for word in words])
    if not numbers[:3].any():
        motion.notes.append("VIEWPOINT: not moved; 0 0 0 is an unknown position")
        return [*words]
    w, x, y, z = numbers[3:] / np.linalg.norm(numbers[3:])
    turned = quaternions((motion.turning @ turn(x, y, z, w))[None])[0]
    place = apply(motion.matrix, numbers[None, :3])[0]
    return [repr(number) for number in [*place.tolist(), *np.roll(turned, 1).tolist()]]


def move_bin(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Move a scan of KITTI: x y z reflectance in single precision."""
    rows, left = divmod(source.seek(0, os.SEEK_END), 16)
    if left:
        raise InputError(f"{left} bytes after {rows} points of 16 bytes")
    source.seek(0)
    _move(motion, source, out, [_Table(rows, _KITTI)], partial(_single, b""))


def move_stl(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Move triangles and their normals."""
    head, size = source.read(84), source.seek(0, os.SEEK_END)
    count = int.from_bytes(head[80:], "little")
    if len(head) == 84 and size >= 84 + 50 * count:
        source.seek(84)
        _move(motion, source, out, [_Table(count, _TRIANGLE)], partial(_single, head))
    elif head.lstrip().lower().startswith(b"solid"):
        source.seek(0)
        move_rows(motion, source, out, {"vertex": XYZ, "facet": ["", *NORMAL]})
    else:
        raise InputError("neither binary nor ASCII")


def _single(head: bytes, wide: Sequence[str]) -> bytes:
    """Return the header of a format that has only single precision."""
    if wide:
        raise InputError("has single precision, too few digits so far away; convert it to PLY first")
    return head


def move_obj(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Move vertices and normals."""
    move_rows(motion, source, out, {"v": XYZ, "vn": NORMAL})
    source.seek(0)
    for line in (line for line in source if line.startswith(b"mtllib")):
        name = line[6:].decode("latin-1").strip()
        motion.notes.append(f"{name}: not copied; materials are in separate files")


def move_rows(
    motion: Motion,
    source: Iterable[bytes],
    out: BinaryIO,
    layouts: Mapping[str, Sequence[str]],
    separator: str = "",
) -> None:
    """Move lines by the names of their columns: after a word that is a key of `layouts`, or all by ""."""
    names = {key: motion.names(columns) for key, columns in layouts.items()}
    places = [(key, [layouts[key].index(name) for name in own]) for key, own in names.items() if own]
    lines = iter(source)
    while block := b"".join(islice(lines, _LINES)):
        rows = _core.TextRows(block, places, separator)
        moved: list[FloatArray] = []
        for (key, _), numbers in zip(places, rows.numbers(), strict=True):
            columns = motion.move(dict(zip(names[key], numbers.T, strict=True)))
            moved.append(np.stack([columns[name] for name in names[key]], axis=1))
        out.write(rows.replaced(moved))


def move_text(motion: Motion, source: BinaryIO, out: BinaryIO, *, more: Sequence[str] = ()) -> None:
    """Move a text of columns: named ones, or x y z and `more`."""
    if source.read(len(BOM_UTF8)) == BOM_UTF8:
        out.write(BOM_UTF8)
    else:
        source.seek(0)
    names, first, separator, is_sure, odd = list[str](), b"", "", False, b""
    for line in source:
        separator, words, is_comment = _core.columns_of(line)
        text = line.strip()
        if {*XYZ} <= {*map(str.lower, words)}:
            names, is_sure = [*map(str.lower, words)], not is_comment
        elif words and not is_comment:
            first, is_sure = line, is_sure or len(names) == len(words)
            if not is_sure:
                names = [*XYZ, *more]
                if len(words) > len(names):
                    motion.notes.append("columns without names: not moved, except x y z")
            break
        elif text and not text.isdigit() and not is_comment:
            odd = odd or text
        out.write(line)
    if odd and not first:
        raise InputError(f"{odd[:60].decode('latin-1')!r}: numbers with decimal points belong there")
    move_rows(motion, chain([first], source), out, {"": names or XYZ}, separator)


def move_ptx(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Move the matrices of the scans, and the scanner; points stay in the frames of their scans."""
    lines = filter(bytes.strip, source)
    while head := list(islice(lines, 10)):
        rows = [[float(word) for word in line.split()] for line in head]
        if [len(row) for row in rows] != [1, 1, 3, 3, 3, 3, 4, 4, 4, 4]:
            raise InputError("a scan without its 10 lines of sizes, axes and matrix")
        scanner, matrix = np.array(rows[2:6]), np.array(rows[6:])  # of row vectors
        if np.allclose(scanner[0], matrix[3, :3]):
            scanner = np.vstack([apply(motion.matrix, scanner[:1]), scanner[1:] @ motion.turning.T])
        else:
            motion.notes.append("the lines of the scanner's place: not moved; they are in another frame")
        end = head[0][len(head[0].rstrip()) :]
        changed = [*number_lines(scanner), *number_lines(matrix @ motion.matrix.T)]
        out.writelines([*head[:2], *(line.encode() + end for line in changed)])
        count = int(rows[0][0] * rows[1][0])
        for row in range(count):
            point = next(lines, b"")
            if not point:
                raise InputError(f"the end of the file, {count - row} points before that of a scan")
            out.write(point)
