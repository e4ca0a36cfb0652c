"""Hooks through which results explain and draw themselves, and paths become clouds.

Results and checks lie in low rooms, explanations, figures and readers in higher ones. `cgroup` itself knows
all rooms and fills the hooks in, with functions that load a room when they are called.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

_hooks: dict[str, Callable[..., Any]] = {}


def fill_hooks(**functions: Callable[..., Any]) -> None:
    """Set the function behind each hook."""
    _hooks.update(functions)


def call_hook(name: str, *arguments: Any) -> Any:  # noqa: ANN401 - whatever the higher room takes and makes
    """Call the function behind a hook."""
    return _hooks[name](*arguments)
