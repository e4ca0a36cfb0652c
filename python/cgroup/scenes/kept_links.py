"""Finished pairs of scans in one SQLite file, for the continuation of an interrupted run.

The key of a row is a digest of both scans, the function with its arguments, and the version of the package. A
second digest, of the key and the result, detects damage.
"""

import hashlib
import json
import sqlite3
import threading
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from cgroup import __version__
from cgroup._runtime.sqlite import Layout, open_or_make
from cgroup.errors import InputError
from cgroup.registration import PreparedScan
from cgroup.scenes.links import Link

_TABLE = "create table links (key blob primary key, link text, digest blob) without rowid"
_LAYOUT = Layout(0x63676C6B, 2, _TABLE)  # its `application_id` is "cglk"

Task: TypeAlias = tuple[tuple[int, ...], tuple[Any, ...]]
"""Rows of the scans for a function, and its further arguments."""


class KeptLinks:
    """Links of scans, and pairs without one; threads and processes may share the file."""

    def __init__(self, path: Path, scans: Sequence[PreparedScan]) -> None:
        self._path, self._scans = path, scans
        self._digests: dict[int, bytes] = {}
        self._lock = threading.Lock()
        foreign = _unusable(self._path, "not a file of finished pairs of this version of cgroup")
        with self._report_failures():
            self._connection = open_or_make(path, _LAYOUT, foreign)

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def find(self, function: Callable[..., Any], tasks: Sequence[Task]) -> dict[int, Link | None]:
        """Return the stored results of a function, by the number of the task."""
        found: dict[int, Link | None] = {}
        with self._report_failures(), self._lock:
            for number, task in enumerate(tasks):
                key = self._key(function, *task)
                query = "select link, digest from links where key = ?"
                row = self._connection.execute(query, (key,)).fetchone()
                if row is not None:
                    found[number] = self._read(key, *row)
        return found

    def _read(self, key: bytes, text: object, digest: object) -> Link | None:
        if not isinstance(text, str) or digest != _digest(key, text):
            raise _unusable(self._path, "damaged (a row differs from its checksum)")
        if text == "null":
            return None
        try:
            fields: Any = {name: np.array(value, float)[()] for name, value in json.loads(text).items()}
            return Link(**fields)
        except (ValueError, TypeError, AttributeError) as error:
            raise _unusable(self._path, f"damaged ({error})") from error

    def add(self, function: Callable[..., Any], task: Task, link: Link | None) -> None:
        """Store a result."""
        key = self._key(function, *task)
        fields = link and {name: np.asarray(value).tolist() for name, value in asdict(link).items()}
        text = json.dumps(fields)
        row = key, text, _digest(key, text)
        with self._report_failures(), self._lock:
            self._connection.execute("insert or replace into links values (?, ?, ?)", row)

    def _key(self, function: Callable[..., Any], rows: Sequence[int], arguments: Sequence[object]) -> bytes:
        for row in rows:
            if row not in self._digests:
                scan = self._scans[row]
                facts = scan.voxel, scan.viewpoint, scan.by_frames, scan.front
                self._digests[row] = _digest(*facts, scan.scan.cloud.points, scan.scan.normals)
        name = f"{function.__module__}.{function.__qualname__}"
        return _digest(__version__, name, *(self._digests[row] for row in rows), *arguments)

    @contextmanager
    def _report_failures(self) -> Generator[None, None, None]:
        try:
            yield
        except sqlite3.Error as error:
            if "not a database" in str(error) or "malformed" in str(error):
                raise _unusable(self._path, f"damaged, or not a file of finished pairs ({error})") from error
            remedy = f"can't be read or written ({error}); fix this, then call again to continue"
            raise InputError("keep", self._path, remedy) from error


def _unusable(path: Path, reason: str) -> InputError:
    return InputError("keep", path, f"{reason}; give another path, or move the file away")


def _digest(*values: object) -> bytes:
    """Return a digest of numbers, text and arrays, alone or in tuples and lists."""
    digest = hashlib.sha256()
    for value in values:
        if isinstance(value, np.ndarray):
            part = f"{value.dtype.str} {value.shape} ".encode() + value.tobytes()
        else:
            part = _digest(*value) if isinstance(value, tuple | list) else repr(value).encode()
        digest.update(f"{type(value).__name__} {len(part)} ".encode() + part)
    return digest.digest()
