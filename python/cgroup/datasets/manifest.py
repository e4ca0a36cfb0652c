"""Lists of pairs from a manifest, for data without a list by their owners.

A ``manifest.json`` in the data root has one entry per data set; the loaders read the owners' files where they
can, and this list for the rest.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from cgroup.errors import InputError
from cgroup.io._files import load_text

if TYPE_CHECKING:
    from pathlib import Path


def manifest_entry(root: Path, dataset: str) -> dict[str, Any] | None:
    """Entry of one data set in the root's manifest; None where there is none."""
    path = root / "manifest.json"
    if not path.is_file():
        return None
    try:
        entries: Any = json.loads(load_text(path))
    except ValueError as error:
        message = f"{path}: not a readable manifest ({error})"
        raise InputError(message) from error
    if not isinstance(entries, dict) or not isinstance(entries.get(dataset, {}), dict):
        message = f"{path}: has to be an object with one object per data set"
        raise InputError(message)
    return entries.get(dataset)
