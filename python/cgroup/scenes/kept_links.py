"""Finished pairs of scans in one SQLite file, so that a run that was ended goes on from there.

A row stands under a digest of all that its result depends on: both scans, the function with its arguments,
and the version of the package.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup import __version__
from cgroup.errors import InputError
from cgroup.scenes.links import Link

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence
    from pathlib import Path

    from cgroup.registration import PreparedScan

_LAYOUT, _APPLICATION = 1, 0x63676C6B
"""Number of the file's layout, which is its `user_version`; its `application_id` is "cglk"."""

_SECONDS_OF_OTHERS = 60
"""For which another process may be at work on the file."""

_ARRAYS, _NUMBERS = ("poses", "chances", "covariance"), ("fitness", "target_fitness")
"""Fields of a link."""


class KeptLinks:
    """Links of scans, and pairs without one; threads and processes may share the file."""

    def __init__(self, path: Path, scans: Sequence[PreparedScan]) -> None:
        self._path, self._scans = path, scans
        self._digests: dict[int, bytes] = {}
        self._lock = threading.Lock()
        with self._report_failures():
            self._connection = sqlite3.connect(
                path, isolation_level=None, timeout=_SECONDS_OF_OTHERS, check_same_thread=False
            )
            try:
                self._make_or_check()
            except BaseException:
                self._connection.close()
                raise

    def _make_or_check(self) -> None:
        """Make the table in a new file; refuse a file of something else before anything is written to it."""
        run = self._connection.execute
        run("begin immediate")  # another process may make it, too
        if run("select count(*) from sqlite_master").fetchone()[0] == 0:
            run("create table links (key blob primary key, link text) without rowid")
            run(f"pragma application_id = {_APPLICATION}")
            run(f"pragma user_version = {_LAYOUT}")
        made_by = [run(f"pragma {name}").fetchone()[0] for name in ("application_id", "user_version")]
        if made_by != [_APPLICATION, _LAYOUT]:
            raise _unusable(self._path, "not a file of finished pairs of this version of cgroup")
        run("commit")
        run("pragma journal_mode = wal")
        run("pragma synchronous = normal")

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def key(self, function: Callable[..., Any], rows: Sequence[int], arguments: Sequence[object]) -> bytes:
        """Return the digest of all that a result depends on."""
        for row in rows:
            if row not in self._digests:
                self._digests[row] = _digest(*_contents(self._scans[row]))
        name = f"{function.__module__}.{function.__qualname__}"
        return _digest(__version__, name, *(self._digests[row] for row in rows), *arguments)

    def find(self, keys: Sequence[bytes]) -> dict[int, Link | None]:
        """Return what is kept, by its place among the keys."""
        found: dict[int, Link | None] = {}
        with self._report_failures(), self._lock:
            for place, key in enumerate(keys):
                row = self._connection.execute("select link from links where key = ?", (key,)).fetchone()
                if row is not None:
                    found[place] = self._read(row[0])
        return found

    def add(self, key: bytes, link: Link | None) -> None:
        """Keep a result for good."""
        text = "null"
        if link is not None:
            fields = {name: getattr(link, name).tolist() for name in _ARRAYS}
            text = json.dumps(fields | {name: float(getattr(link, name)) for name in _NUMBERS})
        with self._report_failures(), self._lock:
            self._connection.execute("insert or replace into links values (?, ?)", (key, text))

    def _read(self, text: str) -> Link | None:
        try:
            fields = json.loads(text)
            if fields is None:
                return None
            poses, chances, covariance = (np.array(fields[name], dtype=np.float64) for name in _ARRAYS)
            return Link(poses, chances, covariance, *(float(fields[name]) for name in _NUMBERS))
        except (ValueError, TypeError, KeyError) as error:
            raise _unusable(self._path, f"damaged ({error})") from error

    @contextmanager
    def _report_failures(self) -> Generator[None, None, None]:
        try:
            yield
        except sqlite3.Error as error:
            if "not a database" in str(error):
                raise _unusable(self._path, f"not a file of finished pairs ({error})") from error
            if "malformed" in str(error):
                raise _unusable(self._path, f"damaged ({error})") from error
            remedy = f"can't be read or written ({error}); once that is mended, call again to continue"
            raise InputError("keep", self._path, remedy) from error


def _unusable(path: Path, reason: str) -> InputError:
    return InputError("keep", path, f"{reason}; give another path, or move the file away")


def _contents(scan: PreparedScan) -> tuple[object, ...]:
    """Return all that a scan was made from, and what was made of its points."""
    front = scan.front.normal_radius, scan.front.support, scan.front.frame_radius
    made = scan.voxels.points, scan.normals, scan.described.indices, scan.described.descriptors
    return scan.voxel, scan.viewpoint, scan.by_frames, front, scan.scan.cloud.points, scan.scan.normals, *made


def _digest(*values: object) -> bytes:
    """Return a digest of numbers, text and arrays, alone or in tuples and lists."""
    digest = hashlib.sha256()
    for value in values:
        if isinstance(value, np.ndarray):
            part = f"{value.dtype.str} {value.shape} ".encode() + np.ascontiguousarray(value).tobytes()
        elif isinstance(value, tuple | list):
            part = _digest(*value)
        else:
            part = repr(value).encode()
        digest.update(f"{type(value).__name__} {len(part)} ".encode() + part)
    return digest.digest()
