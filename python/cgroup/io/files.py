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
from typing import Any, TypeVar

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
    """Write the bytes of a file: all of them, or none.

    Parameters
    ----------
    path : path-like
        Where to; a file that is there is replaced once the new one is complete.
    content : bytes
        All that it is to hold.
    """
    path, content = as_path("path", path), as_instance("content", content, bytes)
    check_outputs([path])
    try:
        if path.parent not in _run.swept:
            _run.swept.add(path.parent)
            remove_dead_parts(path.parent)
        replace_whole(path, content, lambda: [tell(path, content) for tell in listeners])
    except (OSError, UnicodeEncodeError) as error:
        reason = error.strerror or error if isinstance(error, OSError) else "no such file name"
        raise InputError(f"{path}: can't be written ({reason})") from error


listeners: list[Callable[[Path, bytes], object]] = []
"""Called with each file and its content before it is replaced."""


@dataclass
class _Run:
    """What a command, or a process that runs none, has read and written."""

    # path and SHA-256 of each file that was read, by its device and number
    read: dict[tuple[int, int], tuple[str, str]] = field(default_factory=dict)
    swept: set[Path] = field(default_factory=set)  # folders where no process has left a part of a file


_run = _Run()
_is_command = False


@contextmanager
def keeping_inputs() -> Generator[None]:
    """Refuse to replace a file that has been read meanwhile, by whatever name."""
    global _run, _is_command
    before = _run, _is_command
    _run, _is_command = _Run(), True
    try:
        yield
    finally:
        _run, _is_command = before


def digests_of_inputs() -> dict[str, str]:
    """Return the SHA-256 of the files that the command has read, by path."""
    return dict(_run.read.values())


def is_input(path: Path) -> bool:
    """Whether the command has read the file, by whatever name."""
    return _identify(path) in _run.read


def digest_of(path: str | os.PathLike[str]) -> str | None:
    """Return the SHA-256 of a regular file; None where it can't be read."""
    digest = hashlib.sha256()
    try:
        if _what_else(Path(path).stat()):
            return None
        with Path(path).open("rb", buffering=0) as file:
            while chunk := file.read(_CHUNK):
                digest.update(chunk)
    except (OSError, ValueError):
        return None
    return digest.hexdigest()


def check_outputs(paths: Iterable[Path], inputs: Iterable[str | os.PathLike[str]] = ()) -> None:
    """Refuse outputs that would replace an input, and those that are no regular files."""
    kept = {*_run.read, *map(_identify, inputs)} - {None}
    for path in paths:
        if _identify(path) in kept:
            raise InputError(f"{path}: is one of the inputs, and would be replaced; write elsewhere")
        if kind := _irregular(path):
            raise InputError(f"{path}: is {kind}, not a file; write elsewhere, or remove it")


def _irregular(path: Path) -> str | None:
    """Return what else a file is that could be written to; None for a regular one, or where none is."""
    try:
        mode = path.lstat().st_mode
    except (OSError, ValueError):
        return None
    if stat.S_ISLNK(mode):
        return "a link"
    return None if stat.S_ISREG(mode) or stat.S_ISDIR(mode) else "a pipe, a device or a socket"


def _identify(path: str | os.PathLike[str]) -> tuple[int, int] | None:
    """Return device and number of a file; None where there is none."""
    try:
        status = Path(path).stat()
    except (OSError, ValueError):
        return None
    return status.st_dev, status.st_ino


def written_path(path: str | os.PathLike[str], what: str, *suffixes: str) -> Path:
    """Return where to write; `InputError` unless it ends in the suffix of a format for it."""
    path = as_path("path", path)
    if path.suffix.lower() not in suffixes:
        formats = " or ".join(suffix[1:].upper() for suffix in suffixes)
        raise InputError(
            f"{path}: {what} are written as {formats}; use a name that ends in {' or '.join(suffixes)}"
        )
    return path


def check_growth(what: str, grown: int, packed: int, remedy: str = "") -> None:
    """Refuse what would take much more memory than its file has bytes."""
    if grown > max(_TRUSTED, _MOST_GROWTH * packed):
        raise InputError(f"{what} would grow from {packed} to {grown} bytes{remedy}")


@contextmanager
def naming(path: Path) -> Generator[None]:
    """Put the name of the file before what is wrong with its content."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def read_content(path: str | os.PathLike[str]) -> bytes:
    """Read a regular file that isn't empty; reading a pipe or a device might never end."""
    path = as_path("path", path)
    try:
        # Opening a device can do something to it, so its kind is looked at before; and after, when it stays.
        reason = _what_else(path.stat()) or _open_and_read(path)
    except (FileNotFoundError, UnicodeEncodeError):
        reason = "no such file"
    except OSError as error:
        reason = f"can't be read ({error.strerror or error})"
    if isinstance(reason, bytes):
        if reason:
            return reason
        reason = "the file is empty"
    raise InputError(f"{path}: {reason}")


def _open_and_read(path: Path) -> bytes | str:
    """Return the content, or why there is none."""
    with open(os.open(path, _FLAGS), "rb", buffering=0) as file:  # noqa: PTH123 - the flags
        status = os.fstat(file.fileno())
        if else_there := _what_else(status):
            return else_there
        content = io.BytesIO()  # gives its bytes away without a copy
        while chunk := file.read(min(_CHUNK, status.st_size - content.tell())):
            content.write(chunk)
    found = content.getvalue()
    if _is_command and (status.st_dev, status.st_ino) not in _run.read:
        _run.read[status.st_dev, status.st_ino] = str(path), hashlib.sha256(found).hexdigest()
    return found


def _what_else(status: os.stat_result) -> str | None:
    """Return what is there instead of a file."""
    if stat.S_ISDIR(status.st_mode):
        return "is a directory, not a file"
    if not stat.S_ISREG(status.st_mode):
        return "is a pipe, a device or a socket, not a file; save what it yields as a file first"
    return None


def parse_file(path: Path, parse: Callable[[bytes], Result]) -> Result:
    """Parse the file; whatever a parser stumbles over becomes one error that names the file."""
    content = read_content(path)
    try:
        return parse(content)
    except ModuleNotFoundError as error:
        raise InputError(f"{path}: reading it needs {error.name}; pip install 'cgroup[scans]'") from error
    except MemoryError:
        raise
    except Exception as error:
        said = "the end of the file" if isinstance(error, struct.error) else str(error)
        reason = escape(" ".join(said.split())[:_SHOWN]) or type(error).__name__
        kind = path.suffix.lstrip(".").upper() or "text"
        raise InputError(f"{path}: not a readable {kind} file, or cut off ({reason})") from error


def load_numbers(content: bytes) -> FloatArray:
    """Read rows of numbers, separated by white space, commas or semicolons; # and // start comments."""
    return _core.parse_table(content, run_options(threads=1))


def load_text(path: str | os.PathLike[str]) -> str:
    """Read a text: UTF-8, with or without its mark; bytes that aren't become question marks."""
    return read_content(path).decode("utf-8-sig", errors="replace")


def load_json(content: str | bytes) -> Any:  # noqa: ANN401 - whatever the text holds
    """Parse JSON; nests that are too deep, and whole numbers beyond 64 bits, are refused as other text is."""
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


def replace_whole(path: Path, content: bytes, ready: Callable[[], object]) -> None:
    """Write a part, call `ready`, and put the part in the place of the file.

    The part is locked as long as its process lives. A process that is killed leaves it without a lock, for
    `remove_dead_parts`.
    """
    status = path.stat() if path.exists() else None
    if status is not None and not os.access(path, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    part = path.parent / f"{_BEGIN}{secrets.token_hex(4)}{_END}"
    try:
        with part.open("xb") as file:
            with suppress(OSError):  # of a file system without locks
                _lock(file.fileno())
            if status is not None:
                part.chmod(stat.S_IMODE(status.st_mode))
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
            ready()
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
    """Return an empty folder that takes the place of a new one where the block ends without an error.

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


def remove_dead_parts(folder: Path) -> None:
    """Remove the parts that processes left when they were killed: files and folders without a lock."""
    for part in folder.glob(f"{_BEGIN}*{_END}"):
        with suppress(OSError):  # it is locked, gone, or no part
            if part.is_dir() and not part.is_symlink():
                _refuse_alive(part / _ALIVE)
                shutil.rmtree(part)
            else:
                _refuse_alive(part)
                part.unlink()


def _refuse_alive(path: Path) -> None:
    """Raise `OSError` where a path is no regular file, or one that a process has locked."""
    number = os.open(path, _PART_FLAGS)
    try:
        if not stat.S_ISREG(os.fstat(number).st_mode):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        _lock(number)
    finally:
        os.close(number)


def _lock(number: int) -> None:
    """Lock an open file until it is closed; raise `OSError` where it is locked already."""
    if sys.platform != "win32":
        import fcntl  # noqa: PLC0415 - of Unix

        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
