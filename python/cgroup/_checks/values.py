"""Validate arguments that are not arrays: numbers, flags, choices, paths, and run options.

A number is a `numbers.Real` and no truth value, a count a `numbers.Integral` and no truth value: NumPy's
scalars, arrays of no axes and fractions are numbers; arrays of one element, strings and `decimal.Decimal` are
not. A truth value is a `bool` or `numpy.bool_`. Anything else raises `InputError`.
"""

import operator
import os
from collections.abc import Callable, Collection, Mapping
from numbers import Integral, Real
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, TypeVar

import numpy as np

from cgroup._checks.quoting import escape, show
from cgroup.errors import InputError

_Kind = TypeVar("_Kind")

LARGEST_COUNT, MOST_THREADS = 2**64 - 1, 1024

_LONGEST_WORD = 80  # letters of a wrong word that are compared with the right ones


def as_count(name: str, value: object, least: int, remedy: str | None = None) -> int:
    """Return a whole number of at least `least`."""
    if type(value) is int and least <= value <= LARGEST_COUNT:
        return value
    number = _whole(value)
    if number is None or number < least:
        raise refusal(name, value, remedy or f"give a whole number of at least {least}")
    if number > LARGEST_COUNT:
        raise refusal(name, value, f"give a whole number of at most {LARGEST_COUNT}")
    return number


def as_index(name: str, value: object, count: int, what: str) -> int:
    """Return an index below a count, counted from 0."""
    number = as_count(name, value, 0)
    if number >= count:
        raise InputError(name, str(number), f"give a number below {count}, the count of {what}")
    return number


def _whole(value: object) -> int | None:
    value = _unwrap(value)
    if isinstance(value, bool) or not isinstance(value, Integral):
        return None
    try:
        return operator.index(value)
    except Exception:  # noqa: BLE001 - numpy.timedelta64 calls itself whole, and others may fail as they like
        return None


def as_number(name: str, value: object, remedy: str = "give a number") -> float:
    """Return a real number."""
    if type(value) is float:
        return value
    number = _unwrap(value)
    if isinstance(number, bool) or not isinstance(number, Real):
        raise refusal(name, value, remedy)
    try:
        return float(number)
    except OverflowError as error:
        raise refusal(name, value, "give a number that fits into a float") from error
    except Exception as error:
        raise refusal(name, value, remedy) from error


def _unwrap(value: object) -> object:
    """Return the item of an array without axes, such as a number from an NPZ file; other values unchanged."""
    return value[()] if type(value) is np.ndarray and value.ndim == 0 else value


def as_length(name: str, value: object) -> float:
    """Return a finite number greater than 0."""
    length = as_number(name, value)
    if not 0 < length < np.inf:
        raise refusal(name, length, "give a finite number greater than 0")
    return length


def as_scale(name: str, value: object) -> tuple[float, float] | None:
    """Return the bounds of the scale; None if the scale is known."""
    if isinstance(value, bool | np.bool_):
        return (0.0, np.inf) if value else None
    remedy = "give True, or the least and the greatest scale that may be"
    bounds = as_items(name, value, remedy) if isinstance(value, tuple | list | np.ndarray) else []
    if len(bounds) != 2:
        raise refusal(name, value, remedy)
    low, high = (as_length(name, bound) for bound in bounds)
    if low > high:
        raise InputError(name, f"({low:g}, {high:g})", "give the least scale first")
    return low, high


def as_flag(name: str, value: object) -> bool:
    """Return a truth value."""
    if not isinstance(value, bool | np.bool_):
        raise refusal(name, value, "give True or False")
    return bool(value)


def as_choice(name: str, value: object, choices: Collection[str]) -> str:
    """Return one of a few words."""
    if not isinstance(value, str) or value not in choices:
        refuse_word(name, value, choices, guess_word(value, choices))
    return value


def refuse_word(
    name: str, value: object, choices: Collection[str], meant: str | None, otherwise: str = ""
) -> NoReturn:
    """Raise for a word that is not among the choices, with a suggestion."""
    guess = f"; did you mean {meant!r}?" if meant else ""
    raise refusal(name, value, f"choose one of {', '.join(choices)}{otherwise}{guess}")


def guess_word(value: object, choices: Collection[str], likeness: float = 0.6) -> str | None:
    """Return the choice that a wrong word resembles, or None."""
    import difflib  # noqa: PLC0415 - errors only

    word = value[:_LONGEST_WORD].casefold() if isinstance(value, str) else ""
    folded = {choice.casefold(): choice for choice in choices}
    near = difflib.get_close_matches(word, folded, n=1, cutoff=likeness)
    return folded[near[0]] if near else None


def as_word(name: str, value: object) -> str:
    """Return a printable text."""
    if not isinstance(value, str) or not value.isprintable():
        raise refusal(name, value, "give a text without control characters")
    return value


def as_function(name: str, value: object, takes: str) -> Callable[..., Any]:
    """Return a callable."""
    if not callable(value):
        raise refusal(name, value, f"give a function that takes {takes}")
    return value


def as_instance(name: str, value: object, kind: type[_Kind]) -> _Kind:
    """Return an instance of a class."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise refusal(name, value, f"give {article} {kind.__name__}")
    return value


def as_items(name: str, value: Any, remedy: str) -> list[Any]:  # noqa: ANN401 - whatever can be iterated
    """Return the items of an iterable."""
    try:
        return list(value)
    except Exception as error:
        raise refusal(name, value, remedy) from error


def as_named(name: str, value: object, remedy: str, *, may_be_empty: bool = False) -> Mapping[str, Any]:
    """Return a mapping whose keys are names."""
    if not isinstance(value, Mapping):
        raise refusal(name, value, remedy)
    for key in value:
        if not isinstance(key, str):
            raise InputError(name, f"the key {show(key)}, which is no text", remedy)
    if not (value or may_be_empty):
        raise InputError(name, "none", remedy)
    return value


def as_path(name: str, value: object) -> Path:
    """Return a path."""
    if not isinstance(value, str | os.PathLike):
        raise refusal(name, value, "give a path as str or pathlib.Path")
    try:
        path = Path(value)  # pyright: ignore[reportUnknownArgumentType]
    except Exception as error:
        raise refusal(name, value, "give a path as str or pathlib.Path") from error
    if "\0" in str(path):
        raise refusal(name, str(path), "a path can't hold a zero byte")
    return path


def refusal(name: str, value: object, remedy: str) -> InputError:
    """Return the error for an invalid value."""
    return InputError(escape(name), show(value), remedy)


class RunOptions(NamedTuple):
    """Threads, bytes for pairwise matrices, progress callback, seconds of a search; the core reads them."""

    threads: int | None
    max_memory: int
    progress: Callable[[float], Any] | None
    max_seconds: float | None


def run_options(
    threads: int | None = None,
    max_memory: int | None = None,
    progress: Callable[[float], Any] | None = None,
    max_seconds: float | None = None,
) -> RunOptions:
    """Check the run options of a computation."""
    if progress is not None:
        as_function("progress", progress, "the share of the work done")
    seconds = None if max_seconds is None else as_length("max_seconds", max_seconds)
    memory = 0 if max_memory is None else as_count("max_memory", max_memory, 0)
    return RunOptions(as_threads(threads), memory, progress, seconds)


def as_threads(threads: object) -> int | None:
    """Return a number of threads, None for all cores."""
    if threads is None:
        return None
    count = as_count("threads", threads, 1)
    if count > MOST_THREADS:
        raise InputError("threads", count, f"give at most {MOST_THREADS}")
    return count
