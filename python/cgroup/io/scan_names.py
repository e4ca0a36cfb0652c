"""Names of scans in files of poses and graphs: in comments, or in a separate file."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from cgroup._checks.quoting import escape

_LINE = re.compile(r"(?:# )?(other )?scan (\d{1,9}): (.*)")


class ScanNames(NamedTuple):
    """Names of all scans by row, and the rows with a pose in the file, in its order."""

    names: dict[int, str]
    rows: list[int]


def list_names(names: Sequence[str], rows: Sequence[int]) -> list[str]:
    """Return a line per scan: first the given rows, then the scans without a pose in the file."""
    others = sorted({*range(len(names))} - {*rows})
    lines = [f"scan {row}: {escape(names[row])}" for row in rows]
    return lines + [f"other scan {row}: {escape(names[row])}" for row in others]


def find_names(lines: Iterable[str]) -> ScanNames:
    """Parse the lines of `list_names` among others, whether or not they are comments."""
    found = [match for line in lines if (match := _LINE.fullmatch(line.strip()))]
    return ScanNames(
        {int(match[2]): match[3] for match in found}, [int(match[2]) for match in found if match[1] is None]
    )


def names_file(path: Path) -> Path:
    """Return the file of names for a file whose format has no comments."""
    return path.with_name(f"{path.name}.names")


def last_numbers(names: Mapping[int, str]) -> dict[int, int] | None:
    """Return the last number in each name, without its suffix, by row; None unless all differ."""
    found = {row: re.findall(r"\d+", re.sub(r"\.[^./\\]*$", "", name)) for row, name in names.items()}
    numbers = {row: int(digits[-1][-18:]) for row, digits in found.items() if digits}
    return numbers if numbers and len(names) == len({*numbers.values()}) else None
