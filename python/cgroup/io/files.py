"""Reading and writing files, with errors that name the file.

A file is written whole or not at all: a part beside the file takes its place once it is complete.
"""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import secrets
import shutil
import stat
import struct
import sys
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from cgroup import _core
from cgroup._checks.quoting import escape
from cgroup._checks.values import as_instance, as_path, run_options
from cgroup.errors import InputError
from cgroup.types import FloatArray

Result = TypeVar("Result")

_CHUNK = 16 << 20  # bytes read at a time; a signal is heard in between
_TRUSTED = 64 << 20  # bytes that any file may grow to
_MOST_GROWTH = 100  # times that a file may grow beyond; numbers that were measured grow a few times
_MOST_DIGITS = 20  # of a whole number of 64 bits, with its sign
_LARGEST = 2**64
_SHOWN = 160  # characters of a parser's reason that an error shows
_FLAGS = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)
# Windows neither moves nor removes a file that is open, and has no `flock`
_IS_WINDOWS = sys.platform == "win32"
_BEGIN, _END, _ALIVE = ".cgroup-", ".part", "locked"
_PART_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0)


def write_file(path: str | os.PathLike[str], content: bytes) -> None:
    """Write the bytes of a file, all or none.

    Parameters
    ----------
    path : path-like
        Output path; an existing file is replaced when the new one is complete.
    content : bytes
        All that it is to hold.
    """
    path, content = as_path("path", path), as_instance("content", content, bytes)
    write_stream(path, lambda file: file.write(content))


def write_stream(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Write a file, all or none, by a function that writes to an open file."""
    check_outputs([path])
    try:
        if path.parent not in _run.swept:
            _run.swept.add(path.parent)
            remove_dead_parts(path.parent)
        replace_whole(path, write)
    except (OSError, UnicodeEncodeError) as error:
        reason = error.strerror or error if isinstance(error, OSError) else "no such file name"
        raise InputError(f"{path}: can't be written ({reason})") from error


listeners: list[Callable[[Path, str], object]] = []
"""Called with each file and the SHA-256 of its new content before it is replaced."""


@dataclass
class _Run:
    """Files that a command, or a process without a command, has read and written."""

    # path and SHA-256 of each file that was read, by its device and number
    read: dict[tuple[int, int], tuple[str, str]] = field(default_factory=dict)
    swept: set[Path] = field(default_factory=set)  # folders where no process has left a part of a file
    is_command: bool = False


_run = _Run()


@contextmanager
def keeping_inputs() -> Generator[None]:
    """Raise if an output would replace a file that has been read, under any name."""
    global _run  # noqa: PLW0603 - as long as the block runs
    before = _run
    _run = _Run(is_command=True)
    try:
        yield
    finally:
        _run = before


def digests_of_inputs() -> dict[str, str]:
    """Return the SHA-256 of the files that the command has read, by path."""
    return dict(_run.read.values())


def is_input(path: Path) -> bool:
    """Return whether the command has read the file, under any name."""
    return _identify(path) in _run.read


def digest_of(path: str | os.PathLike[str]) -> str | None:
    """Return the SHA-256 of a regular file; None if it cannot be read."""
    digest = hashlib.sha256()
    try:
        _refuse_others(path, Path(path).stat())
        with Path(path).open("rb", buffering=0) as file:
            while chunk := file.read(_CHUNK):
                digest.update(chunk)
    except (OSError, ValueError):
        return None
    return digest.hexdigest()


def check_outputs(paths: Iterable[Path], inputs: Iterable[str | os.PathLike[str]] = ()) -> None:
    """Raise for outputs that would replace an input or are not regular files."""
    kept = {*_run.read, *map(_identify, inputs)} - {None}
    for path in paths:
        if _identify(path) in kept:
            raise InputError(f"{path}: is one of the inputs, and would be replaced; write elsewhere")
        if kind := _irregular(path):
            raise InputError(f"{path}: is {kind}, not a file; write elsewhere, or remove it")


def _irregular(path: Path) -> str | None:
    """Return the kind of a special file; None for a regular or missing file."""
    try:
        mode = path.lstat().st_mode
    except (OSError, ValueError):
        return None
    if stat.S_ISLNK(mode):
        return "a link"
    return None if stat.S_ISREG(mode) or stat.S_ISDIR(mode) else "a pipe, a device or a socket"


def _identify(path: str | os.PathLike[str]) -> tuple[int, int] | None:
    """Return device and inode of a file; None if it does not exist."""
    try:
        status = Path(path).stat()
    except (OSError, ValueError):
        return None
    return status.st_dev, status.st_ino


def written_path(path: str | os.PathLike[str], what: str, *suffixes: str) -> Path:
    """Return the output path; raise `InputError` unless it has the suffix of a format."""
    path = as_path("path", path)
    if path.suffix.lower() not in suffixes:
        formats = " or ".join(suffix[1:].upper() for suffix in suffixes)
        raise InputError(
            f"{path}: {what} are written as {formats}; use a name that ends in {' or '.join(suffixes)}"
        )
    return path


def check_growth(what: str, grown: int, packed: int, remedy: str = "") -> None:
    """Raise for content that would take much more memory than its file has bytes."""
    if grown > max(_TRUSTED, _MOST_GROWTH * packed):
        raise InputError(f"{what} would grow from {packed} to {grown} bytes{remedy}")


@contextmanager
def naming(path: Path) -> Generator[None]:
    """Prefix errors about the content of a file with its name."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def read_content(path: str | os.PathLike[str]) -> bytes:
    """Read a regular file that is not empty; reading a pipe or a device might never end."""
    path = as_path("path", path)
    with open_input(path) as file:
        status = os.fstat(file.fileno())
        content = io.BytesIO()  # gives its bytes away without a copy
        while chunk := file.read(min(_CHUNK, status.st_size - content.tell())):
            content.write(chunk)
    found = content.getvalue()
    key = status.st_dev, status.st_ino
    if _run.is_command and not _run.read[key][1]:
        _run.read[key] = str(path), hashlib.sha256(found).hexdigest()
    return found


@contextmanager
def open_input(path: Path) -> Generator[BinaryIO]:
    """Open a regular file that is not empty."""
    try:
        # Opening a device can do something to it, so its kind is looked at before; and after, when it stays.
        _refuse_others(path, path.stat())
        with open(path, "rb", opener=lambda name, _: os.open(name, _FLAGS)) as file:
            status = os.fstat(file.fileno())
            _refuse_others(path, status)
            if not status.st_size:
                raise InputError(f"{path}: the file is empty")
            if _run.is_command:
                _run.read.setdefault((status.st_dev, status.st_ino), (str(path), ""))
            yield file
    except (FileNotFoundError, UnicodeEncodeError) as error:
        raise InputError(f"{path}: no such file") from error
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror or error})") from error


def _refuse_others(path: str | os.PathLike[str], status: os.stat_result) -> None:
    """Raise for anything else than a regular file."""
    if stat.S_ISDIR(status.st_mode):
        raise InputError(f"{path}: is a directory, not a file")
    if not stat.S_ISREG(status.st_mode):
        what = "a pipe, a device or a socket, not a file; save what it yields as a file first"
        raise InputError(f"{path}: is {what}")


def parse_file(path: Path, parse: Callable[[bytes], Result]) -> Result:
    """Parse the file; any error of a parser becomes one error with the name of the file."""
    content = read_content(path)
    with faults_of(path):
        return parse(content)


@contextmanager
def faults_of(path: Path, extra: str = "scans") -> Generator[None]:
    """Turn any error of a parser into one error with the name of the file."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(f"{path}: reading it needs {error.name}; pip install 'cgroup[{extra}]'") from error
    except MemoryError:
        raise
    except Exception as error:
        if getattr(error, "errno", None):  # of the system, not of a parser
            raise
        said = "the end of the file" if isinstance(error, struct.error) else str(error)
        reason = escape(" ".join(said.split())[:_SHOWN]) or type(error).__name__
        kind = path.suffix.lstrip(".").upper() or "text"
        raise InputError(f"{path}: not a readable {kind} file, or cut off ({reason})") from error


def load_numbers(content: bytes) -> FloatArray:
    """Read rows of numbers, separated by white space, commas or semicolons; # and // start comments."""
    return _core.parse_table(content, run_options(threads=1))


def load_text(path: str | os.PathLike[str]) -> str:
    """Read a text: UTF-8, with or without a byte order mark; invalid bytes become question marks."""
    return read_content(path).decode("utf-8-sig", errors="replace")


def load_json(content: str | bytes) -> Any:  # noqa: ANN401 - whatever the text holds
    """Parse JSON; raise for excessive nesting, and for integers beyond 64 bits."""
    try:
        return json.loads(content, parse_int=_whole_number)
    except RecursionError as error:
        raise InputError("its lists or objects are nested too deeply") from error


def _whole_number(word: str) -> int:
    number = int(word) if len(word) <= _MOST_DIGITS else _LARGEST
    if abs(number) >= _LARGEST:
        raise InputError(f"a number of {len(word)} digits; whole numbers are of 64 bits at most")
    return number


def number_lines(rows: FloatArray) -> list[str]:
    """Write each row of numbers as a line, exact to the last bit."""
    return [" ".join(map(repr, row)) for row in rows.tolist()]


def replace_whole(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Write a temporary file, call the listeners, and replace the file by it.

    The part is locked as long as its process lives. A process that is killed leaves it without a lock, for
    `remove_dead_parts`.
    """
    status = path.stat() if path.exists() else None
    if status is not None and not os.access(path, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    part = path.parent / f"{_BEGIN}{secrets.token_hex(4)}{_END}"
    try:
        with part.open("x+b") as file:
            with suppress(OSError):  # of a file system without locks
                _lock(file.fileno())
            if status is not None:
                part.chmod(stat.S_IMODE(status.st_mode))
            write(file)
            file.flush()
            os.fsync(file.fileno())
            for tell in listeners:
                tell(path, digest_of(part) or "")
            if not _IS_WINDOWS:
                part.replace(path)  # while it is locked
        if _IS_WINDOWS:
            part.replace(path)
    except BaseException:
        with suppress(OSError):
            part.unlink()
        raise


@contextmanager
def folder_made_whole(folder: Path) -> Generator[Path]:
    """Return an empty temporary folder, which is renamed if the block ends without an error.

    Its part holds a locked file as long as its process lives, for `remove_dead_parts`.
    """
    remove_dead_parts(folder.parent)
    part = folder.parent / f"{_BEGIN}{secrets.token_hex(4)}{_END}"
    part.mkdir()
    try:
        with (part / _ALIVE).open("xb") as file:
            with suppress(OSError):  # of a file system without locks
                _lock(file.fileno())
            (part / folder.name).mkdir()
            yield part / folder.name
            (part / folder.name).rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)


@contextmanager
def new_folder(folder: Path) -> Generator[Path]:
    """As `folder_made_whole`, with errors that name the folder, which must not exist."""
    if folder.exists():
        raise InputError(f"{folder}: exists already; give the name of a new folder")
    try:
        with folder_made_whole(folder.absolute()) as made:
            yield made
    except (OSError, UnicodeEncodeError) as error:
        reason = error.strerror or error if isinstance(error, OSError) else "no such file name"
        raise InputError(f"{folder}: can't be written ({reason})") from error


def remove_dead_parts(folder: Path) -> None:
    """Remove temporary files and folders of killed processes: those without a lock."""
    for part in folder.glob(f"{_BEGIN}*{_END}"):
        with suppress(OSError):  # it is locked, gone, or no part
            if part.is_dir() and not part.is_symlink():
                _refuse_alive(part / _ALIVE)
                shutil.rmtree(part)
            else:
                _refuse_alive(part)
                part.unlink()


def _refuse_alive(path: Path) -> None:
    """Raise `OSError` if a path is not a regular file, or if a process has locked it."""
    number = os.open(path, _PART_FLAGS)
    try:
        if not stat.S_ISREG(os.fstat(number).st_mode):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        _lock(number)
    finally:
        os.close(number)


def _lock(number: int) -> None:
    """Lock an open file until it is closed; raise `OSError` if it is already locked."""
    if sys.platform != "win32":
        import fcntl  # noqa: PLC0415 - of Unix

        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
