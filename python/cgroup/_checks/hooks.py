"""Functions that are loaded by name: those of higher packages, on the first call, and plug-ins."""

import importlib
from importlib import import_module
from typing import Any

from cgroup._checks.values import as_word
from cgroup.errors import InputError

_HOOKS = {
    "cloud": ("cgroup.io", "read_cloud"),
    "explanation": ("cgroup._explain", "explain_match"),
    "figure": ("cgroup.plots.matches", "figure_of"),
    "chart": ("cgroup.pages.matches", "figure_of"),
    "scene": ("cgroup.scenes.register_all", "add_scan"),
}


def call_hook(name: str, *arguments: Any) -> Any:  # noqa: ANN401 - types of the higher room
    """Call the function of a hook."""
    module, function = _HOOKS[name]
    return getattr(import_module(module), function)(*arguments)


def load_plugin(what: str, reference: str) -> Any:  # noqa: ANN401 - whatever the name stands for
    """Import the object of a reference; `what` is its kind in error messages, such as "data set"."""
    module_name, _, attribute = as_word(what, reference).partition(":")
    if not all(part.isidentifier() for part in module_name.split(".")):
        raise InputError(what, remedy=f"{module_name!r} is no name of a module; write module:attribute")
    try:
        module = importlib.import_module(module_name)
    except ImportError as error:
        raise InputError(
            f"{what}: can't import {module_name!r} for {reference!r} ({error}); "
            "install it, or put its folder on PYTHONPATH"
        ) from error
    if not attribute or not hasattr(module, attribute):
        raise InputError(what, remedy=f"module {module_name!r} has no {attribute!r}; write module:attribute")
    return getattr(module, attribute)
