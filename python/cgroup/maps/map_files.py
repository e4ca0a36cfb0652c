"""Folders of arrays, each with a checksum."""

import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgroup.errors import InputError
from cgroup.io.files import load_json, new_folder, read_content
from cgroup.io.numpy_files import load_npy

_FACTS = "map.json"
_VERSION = 2


def check_new(folder: Path) -> Path:
    """Raise if a folder exists."""
    if folder.exists():
        raise InputError(f"{folder}: exists already; give the name of a new folder")
    return folder


def save_arrays(folder: Path, facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays to a new folder, all or none."""
    with new_folder(folder) as beside:
        checks = {name: _save(beside / f"{name}.npy", array) for name, array in arrays.items()}
        document = {"version": _VERSION, **facts, "arrays": checks}
        content = json.dumps({**document, "check": _check_of(document)})
        (beside / _FACTS).write_text(content, encoding="utf-8")


def _save(path: Path, array: NDArray[Any]) -> int:
    np.save(path, array, allow_pickle=False)
    check = 0
    with path.open("rb") as file:
        while chunk := file.read(1 << 20):
            check = zlib.crc32(chunk, check)
    return check


def _check_of(document: Mapping[str, Any]) -> int:
    return zlib.crc32(json.dumps(document, sort_keys=True).encode())


def load_arrays(folder: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Read the arrays of a folder into memory, and compare their checksums.

    A memory-mapped array of a truncated file would end the process, and could change after the check.
    """
    facts = _load_facts(folder)
    return facts, {name: _load(folder, f"{name}.npy", check) for name, check in facts["arrays"].items()}


def _load_facts(folder: Path) -> dict[str, Any]:
    try:
        facts: Any = load_json(read_content(folder / _FACTS))
        check = facts.pop("check", None)
    except (ValueError, AttributeError, TypeError) as error:
        raise not_a_map(folder, error) from error
    if check is None:
        raise not_a_map(folder, f"{_FACTS} has no checksum: it is damaged, or of an older version of cgroup")
    if check != _check_of(facts) or facts["version"] != _VERSION:
        raise not_a_map(folder, f"{_FACTS} is damaged, or of another version of cgroup")
    return facts


def _load(folder: Path, name: str, check: int) -> NDArray[Any]:
    try:
        content = read_content(folder / name)
    except InputError as error:
        raise not_a_map(folder, error) from error
    if zlib.crc32(content) != check:
        raise not_a_map(folder, f"{name} is damaged")
    return load_npy(content)


def not_a_map(folder: Path, reason: object) -> InputError:
    """Return the error for a folder that can't be read."""
    foreign = f"no folder that `PreparedMap.save` has written ({reason})"
    return InputError(f"{folder}: {foreign}; save the map again")
