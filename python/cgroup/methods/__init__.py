"""The grouping methods.

A length (``tolerance`` and the like) is in the data's unit; its default is the paper's multiple of
``resolution``. The compiled core describes each option once: name, type, default, range and text. Signatures
and docstrings are made from that, and ``__init__.pyi`` for type checkers (``tools/write_stubs.py``).
"""

from typing import Literal

# Importing these declares the methods.
from cgroup.methods import modern, paper  # noqa: F401  # pyright: ignore[reportUnusedImport]
from cgroup.methods._declare import DECLARED, DESCRIBED

METHOD_INFO = {name: DECLARED[name] for name in DESCRIBED}

MethodName = Literal[tuple(METHOD_INFO)]

__all__ = [info.function.__name__ for info in METHOD_INFO.values()]  # pyright: ignore[reportUnsupportedDunderAll]

globals().update({info.function.__name__: info.function for info in METHOD_INFO.values()})
