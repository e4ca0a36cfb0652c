"""Cache of expensive results in the user's cache folder."""

import hashlib
import io
import os
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from cgroup.errors import InputError
from cgroup.io.files import read_content, write_file
from cgroup.io.result_folders import make_folder, remove_file

# The variable that names the folder for caches, and that folder in the home otherwise; by platform.
_CACHES = {"darwin": ("XDG_CACHE_HOME", "Library/Caches"), "win32": ("LOCALAPPDATA", "AppData/Local")}

_DIGEST_SIZE = 16


def cache_folder() -> Path:
    """Return ``$CGROUP_CACHE``, or the folder for caches of this platform."""
    given = os.environ.get("CGROUP_CACHE")
    if given:
        return Path(given)
    variable, usual = _CACHES.get(sys.platform, ("XDG_CACHE_HOME", ".cache"))
    named = Path(os.environ.get(variable, ""))
    return (named if named.is_absolute() else Path.home() / usual) / "cgroup"


def cached(kind: str, key: Iterable[str | bytes], make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return arrays from the cache, or compute and cache them; the key contains all their inputs."""
    # A cache that can't be read or written is no error: the arrays are then made each time. A damaged file is
    # removed and made again.
    name = _digest(key)
    path = cache_folder() / kind / f"{name}.npz"
    with suppress(InputError):
        content = read_content(path)
        content, seal = content[:-_DIGEST_SIZE], content[-_DIGEST_SIZE:]
        if seal == _seal(name, content):
            with np.load(io.BytesIO(content)) as archive:
                return dict(archive)
        remove_file(path)
    arrays = make()
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    with suppress(InputError):
        make_folder(path.parent)
        write_file(path, buffer.getvalue() + _seal(name, buffer.getvalue()))
    return arrays


def _seal(name: str, content: bytes) -> bytes:
    """Return the hash of a file's name and content, its trailer; damaged arrays may still be readable."""
    return bytes.fromhex(_digest([name, content]))


def _digest(key: Iterable[str | bytes]) -> str:
    digest = hashlib.blake2b(digest_size=_DIGEST_SIZE)
    for part in key:
        content = part.encode() if isinstance(part, str) else part
        digest.update(len(content).to_bytes(8, "little") + content)
    return digest.hexdigest()
