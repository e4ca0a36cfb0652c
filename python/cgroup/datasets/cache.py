"""Cache of expensive results in the user's cache folder."""

from __future__ import annotations

import contextlib
import hashlib
import os
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

# The variable that names the folder for caches, and that folder in the home otherwise; by platform.
_CACHES = {"darwin": ("XDG_CACHE_HOME", "Library/Caches"), "win32": ("LOCALAPPDATA", "AppData/Local")}


def cache_folder() -> Path:
    """Return ``$CGROUP_CACHE``, or the folder for caches of this platform."""
    given = os.environ.get("CGROUP_CACHE")
    if given:
        return Path(given)
    variable, usual = _CACHES.get(sys.platform, ("XDG_CACHE_HOME", ".cache"))
    named = Path(os.environ.get(variable, ""))
    return (named if named.is_absolute() else Path.home() / usual) / "cgroup"


def cached(kind: str, key: Iterable[str | bytes], make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Arrays of a kind from the cache, or made and put there; the key is all that they depend on.

    A cache that can't be read or written is no error: the arrays are then made each time.
    """
    path = cache_folder() / kind / f"{_digest(key)}.npz"
    unreadable = contextlib.suppress(OSError, ValueError, EOFError, zipfile.BadZipFile)
    with unreadable, path.open("rb") as file, np.load(file) as archive:
        return dict(archive)
    arrays = make()
    with contextlib.suppress(OSError):
        _write(path, arrays)
    return arrays


def _digest(key: Iterable[str | bytes]) -> str:
    digest = hashlib.blake2b(digest_size=16)
    for part in key:
        content = part.encode() if isinstance(part, str) else part
        digest.update(len(content).to_bytes(8, "little") + content)
    return digest.hexdigest()


def _write(path: Path, arrays: dict[str, Any]) -> None:
    """Write all or nothing: another process may be reading or writing the same file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, unfinished = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez_compressed(file, **arrays)
        Path(unfinished).replace(path)
    except BaseException:
        Path(unfinished).unlink(missing_ok=True)
        raise
