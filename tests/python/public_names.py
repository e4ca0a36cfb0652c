"""All that is public: what a user can look up, module by module.

`python tests/python/public_names.py` lists it, and says what has an example.
"""

import functools
import inspect
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

from _site.reference import GROUPS

MODULES = (*sorted(GROUPS, key=lambda module: module == "cgroup.io"), "cgroup.group", "cgroup.methods")
"""With `cgroup.io` after those whose names it exports too; the last two are on the page of cgroup."""

PROPERTIES = (property, functools.cached_property)


class Public(NamedTuple):
    """A public name, and what it stands for."""

    name: str
    value: Any

    @property
    def documented(self) -> Any:
        """What carries the docstring."""
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
                yield Public(f"{name}.{member}", method)


def has_example(public: Public) -> bool:
    return ">>> " in (inspect.getdoc(public.documented) or "")


if __name__ == "__main__":
    names = public_names()
    for public in names.values():
        print("example " if has_example(public) else "        ", public.name)  # noqa: T201
    print(f"{sum(map(has_example, names.values()))} of {len(names)} names have an example")  # noqa: T201
