"""Pairs with their poses in the manifest of a data root."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cgroup.errors import InputError
from cgroup.io.files import load_json, load_text


def manifest_pairs(root: Path, dataset: str) -> list[dict[str, Any]]:
    """Pairs of a data set in the root's ``manifest.json``, for data without a list by their owners."""
    path = root / "manifest.json"
    if not path.is_file():
        return []
    try:
        entries: Any = load_json(load_text(path))
    except ValueError as error:
        message = f"{path}: not a readable manifest ({error})"
        raise InputError(message) from error
    if not isinstance(entries, dict) or not isinstance(entries.get(dataset, {}), dict):
        message = f"{path}: has to be an object with one object per data set"
        raise InputError(message)
    return entries[dataset]["pairs"] if entries.get(dataset) else []
