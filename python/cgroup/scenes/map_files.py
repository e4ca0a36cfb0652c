"""Folders of arrays, that are opened without being read."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

_FACTS = "map.json"


def check_new(folder: Path) -> Path:
    """Refuse a folder that is there already."""
    if folder.exists():
        message = f"{folder}: is there already; give the name of a new folder"
        raise InputError(message)
    return folder


def save_arrays(folder: Path, facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays to a new folder: all of them, or none."""
    check_new(folder)
    try:
        with tempfile.TemporaryDirectory(dir=folder.absolute().parent) as beside:
            for name, array in arrays.items():
                np.save(Path(beside, f"{name}.npy"), array, allow_pickle=False)
            Path(beside, _FACTS).write_text(json.dumps({**facts, "arrays": list(arrays)}), encoding="utf-8")
            shutil.copytree(beside, folder, copy_function=os.replace)
    except OSError as error:
        message = f"{folder}: can't be written ({error.strerror or error})"
        raise InputError(message) from error


def load_arrays(folder: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Open the arrays of a folder."""
    try:
        facts = json.loads((folder / _FACTS).read_text(encoding="utf-8"))
        arrays = {name: np.load(folder / f"{name}.npy", mmap_mode="r") for name in facts["arrays"]}
    except (OSError, ValueError, KeyError, TypeError) as error:
        message = f"{folder}: no folder that `PreparedMap.save` has written ({error})"
        raise InputError(message) from error
    return facts, arrays
