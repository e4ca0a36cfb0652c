"""Documents: one JSON object per command, with stable keys.

``docs/command-line.md`` lists the keys. Removing a key or changing its meaning needs a new `SCHEMA_VERSION`.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cgroup import __version__

SCHEMA_VERSION = 1

Document = dict[str, Any]


def make_document(command: str, /, **parts: Any) -> Document:
    """Make a document; arrays become lists, non-finite numbers None, paths text."""
    head = {"schema_version": SCHEMA_VERSION, "cgroup_version": __version__, "command": command}
    return {**head, **_plain(parts)}


def fields(found: object, *names: str) -> Document:
    """Return attributes of a result by name, for a document."""
    return {name: getattr(found, name) for name in names}


def as_text(document: Mapping[str, Any]) -> str:
    """Return a document as JSON in ASCII: short lists on one line, the rest indented.

    Lone surrogates, from file names that are not UTF-8, become escaped text.
    """
    return _layout(document, "")


def _layout(value: Any, indent: str) -> str:
    inner = indent + "  "
    if isinstance(value, dict) and value:
        items = [f"{json.dumps(_in_unicode(key))}: {_layout(item, inner)}" for key, item in value.items()]
    elif isinstance(value, list) and any(isinstance(item, dict | list) for item in value):
        items = [_layout(item, inner) for item in value]
    else:
        return json.dumps(_in_unicode(value), allow_nan=False)
    opening, closing = "{}" if isinstance(value, dict) else "[]"
    return f"{opening}\n{inner}" + f",\n{inner}".join(items) + f"\n{indent}{closing}"


def _in_unicode(value: Any) -> Any:
    """Return a text or a list without lone surrogates, which many JSON readers reject."""
    if isinstance(value, list):
        return [_in_unicode(item) for item in value]
    return value.encode("utf-8", "backslashreplace").decode("utf-8") if isinstance(value, str) else value


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value
