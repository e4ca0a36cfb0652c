"""Result folders: checked before work starts, created at the first output, with a list of own files.

A run replaces and removes only what an earlier run wrote into the folder, and nobody has changed since. A
list in the folder, a line of JSON per file, has what wrote each, and the digests of its content.
"""

from __future__ import annotations

import json
import os
from collections import defaultdict
from collections.abc import Generator, Iterable
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, NamedTuple

from cgroup.errors import InputError
from cgroup.io.files import check_outputs, digest_of, is_input, listeners

LIST = ".cgroup-files.jsonl"  # name of the list; processes that write to one folder append to it side by side

_NO_FOLDER = "can't be made a folder for the results"


def check_folder(path: Path) -> Path:
    """Check that a folder for results can be created and written to, without creating it."""
    with _refusing(path, _NO_FOLDER):
        there = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
        TemporaryFile(dir=there).close()
    return path


def make_folder(path: Path) -> Path:
    """Create a folder for results, unless it exists."""
    with _refusing(path, _NO_FOLDER):
        path.mkdir(parents=True, exist_ok=True)
    return path


def remove_file(path: Path) -> None:
    """Remove a file, if it exists."""
    with _refusing(path, "can't be removed"):
        path.unlink(missing_ok=True)


class _Line(NamedTuple):
    by: str
    run: str
    digest: str


class Results:
    """The output files of runs of a kind in a folder.

    `by` names the kind, such as "merge" or "register source_on_target": the next such run removes what it
    doesn't write again.
    """

    def __init__(self, folder: Path, by: str) -> None:
        self._folder, self._by = folder, by
        self.removed: list[Path] = []

    def unchanged(self, paths: Iterable[Path]) -> set[Path]:
        """Return the paths that are results of any run, and unchanged, except files that were only moved."""
        lines = self._read()
        found = {path: self._found(path, lines) for path in paths}
        return {path for path, each in found.items() if any(not one.by.startswith("apply ") for one in each)}

    def check(self, paths: Iterable[Path], inputs: Iterable[str | os.PathLike[str]] = ()) -> None:
        """Raise if a run would replace an input, a special file, or a file that is no unchanged output."""
        paths = list(paths)
        check_outputs(paths, inputs)
        lines = self._read()
        for path in paths:
            if os.path.lexists(path) and not path.is_dir() and not self._found(path, lines):
                raise InputError(
                    f"{path}: is there, and not as cgroup wrote it; move it, or give another folder"
                )

    @contextmanager
    def writing(self, run: str = "") -> Generator[list[Path]]:
        """Create the folder, list the written files, and yield them; finally remove the others.

        Files of an earlier run stay if it was the same `run`, other than "", and wrote the same as this one.
        """
        written: list[Path] = []
        lines: dict[str, _Line] = {}
        was_there, before = self._folder.exists(), self._read()
        make_folder(self._folder)

        def add(path: Path, digest: str) -> None:
            if (name := self._name(path)) is not None:
                self.check([path])
                if name not in lines:
                    written.append(path)
                lines[name] = _Line(self._by, run, digest)
                self._append(name, lines[name])

        listeners.append(add)
        try:
            yield written
        finally:
            listeners.remove(add)
            if not was_there:
                with suppress(OSError):  # it holds something
                    self._folder.rmdir()
        is_same = bool(run and lines) and all(line in before[name] for name, line in lines.items())
        for name in sorted(before.keys() - lines.keys()):
            path = self._folder / name
            runs = {line.run for line in self._found(path, before) if line.by == self._by}
            if runs and not is_input(path) and not (is_same and run in runs):
                remove_file(path)
                self.removed.append(path)

    def _found(self, path: Path, lines: dict[str, list[_Line]]) -> list[_Line]:
        """Return the list entries of a file in the folder whose content is unchanged.

        The list may be forged: a path that leads out of the folder, as by ``..`` or a link, has none.
        """
        listed = lines.get(self._name(path) or "", [])
        try:
            is_inside = path.resolve().is_relative_to(self._folder.resolve())
        except (OSError, ValueError, RuntimeError):  # no name of a file, or links in a circle
            return []
        if not listed or path.is_symlink() or not path.is_file() or not is_inside:
            return []
        digest = digest_of(path)
        return [line for line in listed if line.digest == digest]

    def _name(self, path: Path) -> str | None:
        """Return the path of a file in the folder, as in the list."""
        try:
            return path.relative_to(self._folder).as_posix()
        except ValueError:
            return None

    def _read(self) -> dict[str, list[_Line]]:
        """Return the list by name, without truncated or foreign lines."""
        lines: dict[str, list[_Line]] = defaultdict(list)
        path = self._folder / LIST
        check_outputs([path])
        with _refusing(path, "can't be read"):
            content = path.read_bytes() if path.exists() else b""
        for text in content.splitlines():
            with suppress(ValueError, TypeError, KeyError, RecursionError):
                entry: Any = json.loads(text)
                name, *line = (str(entry[key]) for key in ("file", "by", "run", "sha256"))
                lines[name].append(_Line(*line))
        return lines

    def _append(self, name: str, line: _Line) -> None:
        if line in self._read()[name]:
            return
        entry = {"by": line.by, "run": line.run, "file": name, "sha256": line.digest}
        path = self._folder / LIST
        with _refusing(path, "can't be written"):
            number = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
            try:
                os.write(number, json.dumps(entry).encode() + b"\n")
            finally:
                os.close(number)


@contextmanager
def _refusing(path: Path, what: str) -> Generator[None]:
    try:
        yield
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: {what} ({getattr(error, 'strerror', None) or error})") from error
