"""Move texts: tables of points, OBJ, STL, PTX, and the rows of PLY and PCD. Other words stay as they are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain, islice
from typing import BinaryIO

import numpy as np

from cgroup.errors import InputError
from cgroup.io._motion import XYZ, Motion, Mover
from cgroup.io.files import number_lines
from cgroup.types import FloatArray

_LINES = 1 << 16  # moved at a time
_COMMENTS = ("#", "//")
NORMAL = ("nx", "ny", "nz")
_OF_OBJ = {"v": ["", *XYZ], "vn": ["", *NORMAL]}
_OF_STL = {"vertex": ["", *XYZ], "facet": ["", "", *NORMAL]}
_PTX_HEAD, _PTX_MATRIX = 10, 6  # lines before the points, and those of them before the matrix


def lines_of(source: BinaryIO) -> Iterator[str]:
    """Yield the lines of a text as they are; bytes become characters one by one."""
    return (line.decode("latin-1") for line in source)


def move_rows(
    motion: Motion,
    lines: Iterable[str],
    out: BinaryIO,
    layouts: Mapping[str, Sequence[str]],
    separator: str | None = None,
) -> None:
    """Move lines whose first word is a key of `layouts`, or all for the key "", by the names of columns."""
    movers = {word: Mover(motion, columns) for word, columns in layouts.items()}
    always, lines = layouts.get(""), iter(lines)
    while block := list(islice(lines, _LINES)):
        found: dict[str, list[tuple[int, list[str]]]] = {word: [] for word in layouts}
        for at, line in enumerate(block):
            words = line.split(separator)
            key = "" if always else (words[0] if words else "")
            if key in found and (not always or (len(words) >= 3 and not line.lstrip().startswith(_COMMENTS))):
                found[key].append((at, words))
        for key, rows in found.items():
            _move_words(movers[key], [words for _, words in rows], layouts[key])
            for at, words in rows:
                body = block[at].rstrip("\r\n")
                indent = body[: len(body) - len(body.lstrip())] if separator is None else ""
                end = (
                    block[at][len(body) :]
                    if separator is None or not words[-1].endswith(("\r", "\n"))
                    else ""
                )
                block[at] = indent + (separator or " ").join(words) + end
        out.write("".join(block).encode("latin-1"))


def _move_words(mover: Mover, rows: list[list[str]], columns: Sequence[str]) -> None:
    fields = {name: at for at, name in enumerate(columns) if name in mover.names}
    records = np.empty(len(rows), [(name, "f8") for name in fields])
    try:
        for name, at in fields.items():
            records[name] = [float(row[at]) for row in rows]
    except (ValueError, IndexError) as error:
        wrong = next(
            " ".join(row) for row in rows if not _are_numbers([*map(row.__getitem__, fields.values())])
        )
        raise InputError(f"{wrong[:60]!r}: numbers with decimal points belong there") from error
    mover.move(records)
    for name, at in fields.items():
        for row, word in zip(rows, map(repr, records[name].tolist()), strict=True):
            end = row[at][len(row[at].rstrip("\r\n")) :]
            row[at] = word + end


def _are_numbers(words: Sequence[str]) -> bool:
    try:
        return all(isinstance(float(word), float) for word in words)
    except (ValueError, IndexError):
        return False


def move_table(motion: Motion, source: BinaryIO, out: BinaryIO, *, more: Sequence[str] = ()) -> None:
    """Move a text of columns: named ones, or x y z and `more`."""
    lines, first = lines_of(source), list[str]()
    names: list[str] = []
    separator = None
    for line in lines:
        first.append(line)
        text = line.strip().lstrip("#/").strip()
        separator = next((each for each in ";,\t" if each in text), None)
        words = [word.strip().strip('"').lower() for word in text.split(separator)]
        if {*XYZ} <= {*words}:
            names = words
            if not line.lstrip().startswith(_COMMENTS):
                break
        elif len(words) >= 3 and not line.lstrip().startswith(_COMMENTS):
            if len(names) != len(words):
                names = [*XYZ, *more]
                if len(words) > len(names):
                    motion.note("columns without names: not moved, except x y z")
            lines = chain([first.pop()], lines)
            break
    out.write("".join(first).encode("latin-1"))
    move_rows(motion, lines, out, {"": names or XYZ}, separator)


def move_obj(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Move the vertices and normals of an OBJ file."""

    def watched() -> Iterator[str]:
        for line in lines_of(source):
            if line.startswith("mtllib"):
                motion.note(f"{line[6:].strip()}: not copied; materials are in separate files")
            yield line

    move_rows(motion, watched(), out, _OF_OBJ)


def move_stl_text(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Move an STL file in ASCII."""
    move_rows(motion, lines_of(source), out, _OF_STL)


def move_ptx(motion: Motion, source: BinaryIO, out: BinaryIO) -> None:
    """Move the matrices of the scans; their points stay in their own frames."""
    lines = lines_of(source)
    while head := list(islice(lines, _PTX_HEAD)):
        rows = [[float(word) for word in line.split()] for line in head]
        if [len(row) for row in rows] != [1, 1, 3, 3, 3, 3, 4, 4, 4, 4]:
            raise InputError("a scan without its 10 lines of sizes, axes and matrix")
        matrix = np.array(rows[_PTX_MATRIX:]).T  # of rows in the file
        if np.allclose(rows[2], matrix[:3, 3]):
            scanner = np.vstack([(motion.matrix @ matrix)[:3, 3], np.array(rows[3:6]) @ motion.turning.T])
        else:
            scanner = np.array(rows[2:6])
            motion.note("the lines of the scanner's place: not moved; they are in another frame")
        texts = [*number_lines(scanner), *number_lines((motion.matrix @ matrix).T)]
        ends = [line[len(line.rstrip("\r\n")) :] for line in head[2:]]
        out.write("".join(head[:2] + [a + b for a, b in zip(texts, ends, strict=True)]).encode("latin-1"))
        left = int(rows[0][0] * rows[1][0])
        while left > 0:
            block = list(islice(lines, min(left, _LINES)))
            if not block:
                raise InputError(f"the end of the file, {left} points before that of a scan")
            out.write("".join(block).encode("latin-1"))
            left -= len(block)


def point_blocks(lines: Iterator[str], columns: Sequence[int]) -> Iterator[FloatArray]:
    """Yield points from columns of rows."""
    while block := list(islice(lines, _LINES)):
        yield np.loadtxt(block, usecols=columns, ndmin=2, comments=None)
