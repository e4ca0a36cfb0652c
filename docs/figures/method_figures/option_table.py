"""Tables of options on the methods' pages, from the signatures and docstrings of the methods."""

from __future__ import annotations

import inspect
import json
import re
from typing import TYPE_CHECKING

from numpydoc.docscrape import FunctionDoc

from cgroup._checks.fields import FIELDS
from cgroup.registry import find_method

if TYPE_CHECKING:
    from collections.abc import Callable

_MULTIPLE = re.compile(r"[;,] default `([^`]+)`")
_IN_WORDS = re.compile(r"[;,] (?:by default|None for) (.+?)(?=[.;](?: |$))")
_CITED = re.compile(r",? (?:as in|of) \[\d\]_")


def option_table(function: str) -> str:
    """List the options of a method with their defaults and meanings."""
    method = find_method(function).function
    meanings = _meanings(method)
    lines = ["| option | default | meaning |", "|---|---|---|"]
    for name, parameter in inspect.signature(method).parameters.items():
        if name not in FIELDS:
            choices, meaning = meanings[name]
            default, meaning = _default(parameter.default, meaning)
            text = f"{choices}: {meaning}" if choices else meaning
            lines.append(f"| `{name}` | {default} | {text.replace('|', chr(92) + '|')} |")
    return "\n".join(lines)


def _meanings(method: Callable[..., object]) -> dict[str, tuple[str, str]]:
    """Return words to choose from, if any, and the meaning of each parameter."""
    found: dict[str, tuple[str, str]] = {}
    for entry in FunctionDoc(method)["Parameters"]:
        words = entry.type.strip("{}").split(", ") if entry.type.startswith("{") else []
        meaning = _CITED.sub("", " ".join(entry.desc).replace("``", "`"))
        for name in entry.name.split(", "):
            found[name] = (", ".join(f"`{word}`" for word in words), meaning)
    return found


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
