"""Explain wrong arguments of a call in one sentence; load functions of higher packages, and plug-ins."""

import importlib
from collections.abc import Callable, Collection, Iterable
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Any, TypeVar

from cgroup._checks.values import as_word, guess_word
from cgroup.errors import InputError

_Function = TypeVar("_Function", bound="Callable[..., Any]")

_OTHER_WORDS = {
    "distance_threshold": "tolerance", "down_sampling_resolution": "voxel", "k": "neighbors",
    "downsampling_resolution": "voxel", "inlier_threshold": "tolerance", "knn": "neighbors",
    "leaf_size": "voxel", "max_correspondence_distance": "tolerance", "max_iteration": "iterations",
    "max_iterations": "iterations", "max_nn": "neighbors", "n_jobs": "threads", "noise_bound": "tolerance",
    "num_iterations": "iterations", "num_neighbors": "neighbors", "num_threads": "threads",
    "random_state": "seed", "resolution": "voxel", "voxel_size": "voxel",
}  # fmt: skip
"""Names of options elsewhere (Open3D, PCL, small_gicp, KISS-Matcher, TEASER++, scikit-learn), and ours."""


def explain_wrong_calls(function: _Function, *, too_many: str = "") -> _Function:
    """Raise `InputError` for an unknown option, and for options given by position."""
    # Other errors of a call remain Python's `TypeError`. `too_many` is the remedy for too many arguments.

    @wraps(function)
    def called(*given: Any, **named: Any) -> Any:  # noqa: ANN401 - as the function has it
        try:
            return function(*given, **named)
        except TypeError as error:
            within = error.__traceback__ is not None and error.__traceback__.tb_next is not None
            wrong = None if within else _explain(function, len(given), named, too_many)
            if wrong is None:
                raise
        raise wrong

    return called  # pyright: ignore[reportReturnType] - `wraps` keeps the signature


def bind_arguments(
    function: Callable[..., Any], parameters: Signature, given: tuple[Any, ...], named: dict[str, Any]
) -> dict[str, Any]:
    """Return the arguments of a call by name, defaults included; raise as `explain_wrong_calls` does."""
    try:
        bound = parameters.bind(*given, **named)
    except TypeError:
        wrong = _explain(function, len(given), named)
        if wrong is None:
            raise
    else:
        bound.apply_defaults()
        return bound.arguments
    raise wrong


def _explain(
    function: Callable[..., Any], given: int, named: Iterable[str], too_many: str = ""
) -> InputError | None:
    parameters = signature(function).parameters.values()
    by_position = [one.name for one in parameters if one.kind == Parameter.POSITIONAL_OR_KEYWORD]
    options = [one.name for one in parameters if one.kind == Parameter.KEYWORD_ONLY]
    unknown = next((name for name in named if name not in by_position + options), None)
    if given > len(by_position):
        remedy = too_many or f"{function.__name__} takes {', '.join(by_position)} so, and options by name"
        return InputError("arguments", f"{given} by position", remedy)
    return None if unknown is None else unknown_option(function.__name__, unknown, by_position + options)


def unknown_option(called: str, name: str, known: Collection[str], own: Collection[str] = ()) -> InputError:
    """Return the error for an option that is not among the known ones."""
    # The function that was called may pass options on: `own` are those that it takes itself.
    meant = _guess_option(name, own)
    if meant:
        return InputError("option", remedy=f"there is no {name!r} (did you mean {meant!r}?)")
    meant = _guess_option(name, known)
    guess = f" (did you mean {meant!r}?)" if meant else ""
    return InputError("option", remedy=f"{called} has no {name!r}{guess}; it takes {', '.join(known)}")


def _guess_option(name: str, choices: Collection[str]) -> str | None:
    """Return the option of that name in other libraries, or the most similar one; None if there is none."""
    elsewhere = _OTHER_WORDS.get(name)
    return elsewhere if elsewhere in choices else guess_word(name, choices, 0.7)


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
    return getattr(importlib.import_module(module), function)(*arguments)


def load_plugin(what: str, reference: str) -> Any:  # noqa: ANN401 - the named object
    """Import the object of a reference; `what` is its kind in error messages, such as "data set"."""
    module_name, _, attribute = as_word(what, reference).partition(":")
    if not all(part.isidentifier() for part in module_name.split(".")):
        raise InputError(what, remedy=f"{module_name!r} is no name of a module; write module:attribute")
    try:
        module = importlib.import_module(module_name)
    except ImportError as error:
        got = f"{what}: can't import {module_name!r} for {reference!r} ({error})"
        raise InputError(f"{got}; install it, or put its folder on PYTHONPATH") from error
    if not attribute or not hasattr(module, attribute):
        raise InputError(what, remedy=f"module {module_name!r} has no {attribute!r}; write module:attribute")
    return getattr(module, attribute)
