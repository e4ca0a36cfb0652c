"""Functions of higher rooms that results and checks call: they explain, draw, and read clouds.

A higher room is loaded when one of its functions is called first.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOOKS = {
    "cloud": ("cgroup.io", "read_cloud"),
    "explanation": ("cgroup._explain", "explain_match"),
    "figure": ("cgroup.plots.matches", "figure_of"),
    "chart": ("cgroup.pages.figure", "figure_of"),
    "scene": ("cgroup.scenes.register_all", "add_scan"),
}


def call_hook(name: str, *arguments: Any) -> Any:  # noqa: ANN401 - types of the higher room
    """Call the function of a hook."""
    module, function = _HOOKS[name]
    return getattr(import_module(module), function)(*arguments)
