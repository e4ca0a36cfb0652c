"""Files of measurements, which figures, tables and the chooser are made from.

Each is CSV below a heading that says where its numbers come from: ``# key: value`` with the keys of `Origin`.
"""

from __future__ import annotations

import subprocess
from dataclasses import dataclass, fields
from datetime import datetime, timezone
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from cgroup.benchmark.results import this_machine

if TYPE_CHECKING:
    from collections.abc import Sequence

ROOT = Path(__file__).parents[3]
FOLDER = Path(__file__).parents[1] / "measured"
METHODS_CSV = FOLDER / "methods.csv"
OPTIONS_CSV = FOLDER / "options.csv"
BY_HAND = "hand"
VECTORS = {"avx512f": "AVX-512", "avx2": "AVX2"}


@dataclass(frozen=True)
class Origin:
    """Where numbers come from.

    Attributes
    ----------
    command : str
        What repeats the measurement; "hand" where no command does.
    commit : str
        The last change of `code`; the first commit with the numbers where the other isn't on record.
    date, machine : str
        When, and on what.
    code : str
        What the numbers depend on: paths from the root, separated by spaces.
    """

    command: str
    commit: str
    date: str
    machine: str
    code: str

    def __str__(self) -> str:
        """Say it in a caption."""
        how = self.command if self.command == BY_HAND else f"`{self.command}`"
        return f"Measured {self.date} at {self.commit} by {how}; {self.machine}."

    def changes(self) -> list[str]:
        """List the source files that have changed since the measurement."""
        return _list_changes(self.commit, self.code.split())


def load_origin(path: Path) -> Origin:
    """Read the heading of a file of measurements."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return Origin(**dict(line.removeprefix("# ").split(": ", 1) for line in lines[: len(fields(Origin))]))


def save(path: Path, command: str, code: Sequence[str], table: pd.DataFrame, how: str) -> None:
    """Write numbers that were just measured with the code as it is."""
    changed = _list_changes("HEAD", code)
    if changed:
        message = f"{changed[0]} differs from the last commit: commit first, so that the numbers can name it"
        raise SystemExit(message)
    machine = this_machine()
    origin = Origin(
        command,
        _git("log", "-1", "--format=%h", "--", *code).strip(),
        datetime.now(tz=timezone.utc).date().isoformat(),
        f"{machine.cpu} ({_widest_vectors()}), {machine.cores} cores, {how}",
        " ".join(code),
    )
    heading = "".join(f"# {field.name}: {getattr(origin, field.name)}\n" for field in fields(origin))
    path.write_text(heading + table.to_csv(index=False), encoding="utf-8")


def load_table(path: Path) -> pd.DataFrame:
    """Return a table as it is shown, every cell a text."""
    return pd.read_csv(path, skiprows=len(fields(Origin)), dtype=str, keep_default_na=False)


@cache
def load_methods() -> pd.DataFrame:
    """Return the means of all methods on generated matches, one row per method and kind of problem."""
    return pd.read_csv(METHODS_CSV, comment="#", dtype={"set": str}, keep_default_na=False)


@cache
def load_options() -> pd.DataFrame:
    """Return precision, recall, F and time of the values of options."""
    return pd.read_csv(OPTIONS_CSV, comment="#", dtype={"value": str}, keep_default_na=False)


def _list_changes(commit: str, code: Sequence[str]) -> list[str]:
    return _git("diff", "--name-only", commit, "--", *code).splitlines()


def _widest_vectors() -> str:
    """Name the vector instructions that times depend on most."""
    flags = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    return next((name for flag, name in VECTORS.items() if flag in flags), "baseline")


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(ROOT), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout  # noqa: S603 - our own
