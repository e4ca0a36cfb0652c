"""Numbers and lengths as sentences show them."""

from __future__ import annotations

_FEWEST_DIGITS = 3
_MOST_DIGITS = 17


def number(value: float) -> str:
    """Write a number in three digits, or a whole one in all."""
    if float(value).is_integer() and abs(value) < 1e6:
        return f"{value:.0f}"
    return f"{value:.{_FEWEST_DIGITS}g}"


def counted(count: int, noun: str) -> str:
    """Write "1 scan", "3 scans"."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def told_apart(one: float, other: float) -> tuple[str, str]:
    """Write two numbers, which differ, in as many digits as show it."""
    digits = _FEWEST_DIGITS
    while digits < _MOST_DIGITS and one != other and f"{one:.{digits}g}" == f"{other:.{digits}g}":
        digits += 1
    return f"{one:.{digits}g}", f"{other:.{digits}g}"


def lengths(one: float, other: float, resolution: float | None) -> tuple[str, str]:
    """Write two lengths: in resolutions where that unit is known."""
    if resolution is None or not resolution > 0.0:
        return told_apart(one, other)
    texts = told_apart(one / resolution, other / resolution)
    return f"{texts[0]} pr", f"{texts[1]} pr"


def length(value: float, resolution: float | None) -> str:
    """Write one length."""
    return lengths(value, value, resolution)[0]


def one_of(count: int, whole: str, total: int) -> str:
    """Write "none of the 41 others", "3 of the 41 others", "all of the 41 others"."""
    some = "all" if count == total and total else str(count or "none")
    return f"{some} of {whole.format(total)}"
