"""Tables of a method's data and options, from its signature and docstring."""

from __future__ import annotations

import inspect
import json
import re

from numpydoc.docscrape import FunctionDoc

from cgroup.registry import find_method
from cgroup.types.fields import FIELDS

_UNIT = "Lengths are in the unit of the points. [pr](../glossary.md#pr) in a default is the `resolution`."
_MULTIPLE = re.compile(r"[;,] default `([^`]+)`")
_IN_WORDS = re.compile(r"[;,] (?:by default|None for) (.+?)(?=[.;](?: |$))")
_CITED = re.compile(r",? (?:as in|of) \[\d\]_")


def option_table(function: str) -> str:
    """List the fields of a method, then its options with their defaults."""
    method = find_method(function).function
    entries = {name: entry for entry in FunctionDoc(method)["Parameters"] for name in entry.name.split(", ")}
    fields = ["| field | type | meaning |", "|---|---|---|"]
    options = ["| option | default | meaning |", "|---|---|---|"]
    for name, parameter in inspect.signature(method).parameters.items():
        entry = entries[name]
        meaning = _CITED.sub("", " ".join(entry.desc).replace("``", "`"))
        if name in FIELDS:
            fields.append(_row(name, entry.type, meaning))
        else:
            default, meaning = _default(parameter.default, meaning)
            options.append(_row(name, default, _choices(entry.type) + meaning))
    return "\n".join([*fields, "", _UNIT, "", *options])


def _row(name: str, second: str, meaning: str) -> str:
    return f"| `{name}` | {second} | {meaning.replace('|', chr(92) + '|')} |"


def _choices(type_: str) -> str:
    """Return the words to choose from, if any, as the beginning of a meaning."""
    words = type_.strip("{}").split(", ") if type_.startswith("{") else []
    return f"{', '.join(f'`{word}`' for word in words)}: " if words else ""


def _default(value: object, meaning: str) -> tuple[str, str]:
    """Return a default as the table shows it, and the meaning without it."""
    if value is None:
        if multiple := _MULTIPLE.search(meaning):
            return _length(multiple[1]), _MULTIPLE.sub("", meaning, count=1)
        words = _IN_WORDS.search(meaning)
        return (words[1], _IN_WORDS.sub("", meaning, count=1)) if words else ("none", meaning)
    if isinstance(value, bool | str):
        return f"`{json.dumps(value) if isinstance(value, str) else value}`", meaning
    return f"{value:,}" if isinstance(value, int) else f"{value:g}", meaning


def _length(formula: str) -> str:
    """Return "5 pr" for "5 * resolution", and "0.12 `tolerance`" for "0.12 * tolerance"."""
    text = formula.replace(" * ", " ")
    return re.sub(r"[a-z_]+", lambda name: "pr" if name[0] == "resolution" else f"`{name[0]}`", text)
