"""One figure per method that shows its idea on a small example."""

from __future__ import annotations

import importlib
import pkgutil
from typing import TYPE_CHECKING

from cgroup.registry import METHOD_INFO

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from matplotlib.figure import Figure

_MODULES = [importlib.import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__)]
_FUNCTIONS = [info.function.__name__ for info in METHOD_INFO.values()]

IDEAS: Mapping[str, Callable[[], Figure]] = {
    name: vars(module)[name] for name in _FUNCTIONS for module in _MODULES if name in vars(module)
}
"""How the idea of each method is drawn, by the function's name."""
