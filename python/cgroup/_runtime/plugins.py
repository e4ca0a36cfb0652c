"""Load plug-ins by their name "module:attribute"."""

from __future__ import annotations

import importlib
from typing import Any

from cgroup._checks.values import as_word
from cgroup.errors import InputError


def load_plugin(what: str, reference: str) -> Any:  # noqa: ANN401 - whatever the name stands for
    """Import what a reference names; errors call it by `what` it is to be, such as "data set"."""
    module_name, _, attribute = as_word(what, reference).partition(":")
    if not all(part.isidentifier() for part in module_name.split(".")):
        remedy = f"{module_name!r} is no name of a module; write module:attribute"
        raise InputError(what, remedy=remedy)
    try:
        module = importlib.import_module(module_name)
    except ImportError as error:
        raise InputError(
            f"{what}: can't import {module_name!r} for {reference!r} ({error}); "
            "install it, or put its folder on PYTHONPATH"
        ) from error
    if not attribute or not hasattr(module, attribute):
        remedy = f"module {module_name!r} has no {attribute!r}; write module:attribute"
        raise InputError(what, remedy=remedy)
    return getattr(module, attribute)
