"""All public names, module by module.

`python tests/python/public_names.py` lists them, and shows which have an example and which a page names.
"""

import functools
import inspect
import re
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

from _site.reference import GROUPS

ROOT = Path(__file__).parents[2]

MODULES = (*sorted(GROUPS, key=lambda module: module == "cgroup.io"), "cgroup.group", "cgroup.methods")
"""With `cgroup.io` after those whose names it exports too; the last two are on the page of cgroup."""

PROPERTIES = (property, functools.cached_property)


class Public(NamedTuple):
    """A public name, and what it stands for."""

    name: str
    value: Any

    @property
    def last(self) -> str:
        """The name without those of its module and class."""
        return self.name.rpartition(".")[2]

    @property
    def is_member(self) -> bool:
        """Whether it is a method or a property of a class."""
        return not inspect.isclass(self.value) and "." in self.documented.__qualname__

    @property
    def documented(self) -> Any:
        """The object that has the docstring."""
        if isinstance(self.value, functools.cached_property):
            return self.value.func
        return self.value.fget if isinstance(self.value, property) else self.value


def public_names() -> dict[str, Public]:
    """Find every function, class, method and property, each once, under the first name that it has."""
    found: dict[int, Public] = {}
    for module in MODULES:
        for name in import_module(module).__all__:
            for public in _with_members(f"{module}.{name}", getattr(import_module(module), name)):
                found.setdefault(id(public.value), public)
    return {public.name: public for public in found.values()}


def _with_members(name: str, value: Any) -> Iterator[Public]:
    """A function; a class and what it defines itself; nothing for a constant or an alias of a type."""
    if inspect.isfunction(value) and value.__module__.startswith("cgroup"):
        yield Public(name, value)
    elif inspect.isclass(value) and value.__module__.startswith("cgroup"):
        yield Public(name, value)
        for member, given in vars(value).items():
            method = given.__func__ if isinstance(given, classmethod | staticmethod) else given
            if not member.startswith("_") and (inspect.isfunction(method) or isinstance(method, PROPERTIES)):
                public = Public(f"{name}.{member}", method)
                if ":meta private:" not in (inspect.getdoc(public.documented) or ""):  # hidden by Sphinx
                    yield public


def in_code(*, blocks_only: bool = False) -> set[str]:
    """Return all words in the code of the pages: in blocks of Python, or in any block or backticks."""
    pages = [ROOT / "README.md", *(path for path in ROOT.glob("docs/**/*.md") if path.stem != "changelog")]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    blocks = re.findall(r"```.*?```", text, flags=re.DOTALL)
    if blocks_only:
        blocks = [block for block in blocks if block.startswith("```python")]
    spans = re.findall(r"`+[^`\n]+(?:\n[^`\n]+)?`+", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
    return set(re.findall(r"\w+", "\n".join(blocks if blocks_only else [*blocks, *spans])))


def has_example(public: Public) -> bool:
    return ">>> " in (inspect.getdoc(public.documented) or "")


if __name__ == "__main__":
    names = public_names()
    named = in_code()
    for public in names.values():
        marks = ("example" if has_example(public) else "", "page" if public.last in named else "")
        print(f"{marks[0]:8}{marks[1]:5}{public.name}")  # noqa: T201
    print(f"{sum(map(has_example, names.values()))} of {len(names)} names have an example")  # noqa: T201
