"""Numbers, lengths and poses as text, and notebook tables of results for light and dark pages."""

import math
from collections.abc import Iterable
from html import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup._checks.arrays import FloatArray
from cgroup.rigid.transforms import axis_of

_FEWEST_DIGITS, _MOST_DIGITS = 3, 17
_EXACT = 1e-9  # part of its extent by which a printed pose may move a cloud elsewhere
_FAR = 10  # extents away from the origin beyond which poses are printed exactly
_NARROWEST = 12  # columns of a number of a pose
_LEAST_TURN = 0.005  # degrees below which a rotation has no axis


def number(value: float) -> str:
    """Format a number with three digits, or an integer with all."""
    if float(value).is_integer() and abs(value) < 1e6:
        return f"{value:.0f}"
    return f"{value:.{_FEWEST_DIGITS}g}"


def counted(count: int, noun: str) -> str:
    """Format a count with its noun: "1 scan", "3 scans"."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def told_apart(one: float, other: float) -> tuple[str, str]:
    """Format two different numbers with as many digits as needed to distinguish them."""
    digits = _FEWEST_DIGITS
    while digits < _MOST_DIGITS and one != other and f"{one:.{digits}g}" == f"{other:.{digits}g}":
        digits += 1
    return f"{one:.{digits}g}", f"{other:.{digits}g}"


def lengths(one: float, other: float, resolution: float | None) -> tuple[str, str]:
    """Format two lengths, in resolutions if that unit is known."""
    if resolution is None or not resolution > 0.0:
        return told_apart(one, other)
    texts = told_apart(one / resolution, other / resolution)
    return f"{texts[0]} pr", f"{texts[1]} pr"


def length(value: float, resolution: float | None) -> str:
    """Format one length."""
    return lengths(value, value, resolution)[0]


def one_of(count: int, whole: str, total: int) -> str:
    """Format a part: "none of the 41 others", "3 of the 41 others", "all of the 41 others"."""
    some = "all" if count == total and total else str(count or "none")
    return f"{some} of {whole.format(total)}"


def say_direction(vector: NDArray[np.float64]) -> str:
    """Write a direction as a unit vector of two decimals."""
    x, y, z = np.round(vector / np.linalg.norm(vector), 2) + 0.0  # no -0.00
    return f"({x:.2f}, {y:.2f}, {z:.2f})"


def say_placement(pose: NDArray[np.float64], middle: NDArray[np.float64]) -> str:
    """Describe a pose by where it moves the middle of a cloud, and its rotation."""
    x, y, z = (
        np.format_float_positional(value, precision=4, unique=False, fractional=False, trim="-")
        for value in middle
    )
    sine = float(np.linalg.norm(pose[:3, :3] - np.eye(3))) / math.sqrt(8)
    angle = math.degrees(2 * math.asin(min(1.0, sine)))
    turned = f"rotated by {angle:.3g} degrees about the axis {say_direction(axis_of(pose))}"
    return f"middle at ({x}, {y}, {z}), {turned if angle > _LEAST_TURN else 'not rotated'}"


def pose_lines(pose: ArrayLike, middle: ArrayLike | None = None, extent: float | None = None) -> list[str]:
    """Format a (4,4) transform row by row.

    The decimals move points with this mean to within 1e-9 of `extent`, the diagonal of their box. Numbers are
    exact without one, and if the points or the translation are over ten extents away, as in georeferencing.
    """
    matrix = np.asarray(pose, dtype=float)
    turning = shifting = None
    away = 0.0 if middle is None else float(np.linalg.norm(np.asarray(middle, dtype=float)))
    is_far = max(away, np.linalg.norm(matrix[:3, 3])) > _FAR * (extent or math.inf)
    if middle is not None and extent and not is_far:
        reach = away + extent
        allowed = _EXACT * extent * float(np.linalg.norm(matrix[:3, 0]))
        # Half a unit of the last decimal moves a point by up to 3 reach / 2, and by sqrt(3) / 2.
        turning, shifting = _decimals(3 * reach / allowed), _decimals(math.sqrt(3) / allowed)
    rows = [
        [_show(number, shifting if k == 3 else turning) for k, number in enumerate(row)] for row in matrix
    ]
    width = max(_NARROWEST, *(len(number) for row in rows for number in row))
    return [" ".join(f"{number:>{width}}" for number in row) for row in rows]


def _decimals(ratio: float) -> int | None:
    """Return the number of decimals at which the rounding error is small enough."""
    return max(0, math.ceil(math.log10(ratio))) if 0 < ratio < math.inf else None


def _show(number: float, decimals: int | None) -> str:
    """Format a number with the shortest exact notation, or with a maximum number of decimals."""
    if decimals is None or not math.isfinite(number):
        return repr(float(number)).removesuffix(".0")
    text = np.format_float_positional(number, precision=decimals, unique=True, trim="-")
    return "0" if text == "-0" else text


_BAR = 120  # pixels
_KEPT = "#0072B2"
_CELL = "text-align: left; padding: .1em .9em .1em 0; vertical-align: top; background: none; border: 0"


def result_table(title: str, share: float | None, rows: Iterable[tuple[str, str]]) -> str:
    """Return a table: a title, a bar for a fraction in [0,1], and names with values.

    Values are plain text, or what `pose_html` returned; rows without a value are left out.
    """
    lines = "".join(_row(name, value) for name, value in rows if value)
    bar = "" if share is None else _bar(share)
    return (
        '<div style="font-size: .95em; line-height: 1.4">'
        f'<div style="margin-bottom: .3em"><b>{escape(title)}</b>{bar}</div>'
        f'<table style="border-collapse: collapse; border: 0; margin: 0">{lines}</table></div>'
    )


def _row(name: str, value: str) -> str:
    shown = value if isinstance(value, _Html) else escape(value)
    return (
        f'<tr style="background: none"><th scope="row" style="{_CELL}; font-weight: normal; opacity: .7">'
        f'{escape(name)}</th><td style="{_CELL}">{shown}</td></tr>'
    )


class _Html(str):
    """A text in HTML."""

    __slots__ = ()


def pose_html(pose: FloatArray) -> str:
    """Write a transform as lines of exact numbers of one width."""
    lines = "\n".join(pose_lines(pose))
    return _Html(
        f'<pre style="margin: 0; padding: 0; background: none; color: inherit; border: 0">{lines}</pre>'
    )


def _bar(share: float) -> str:
    width = round(_BAR * min(max(share, 0.0), 1.0), 1)
    return (
        f' <svg width="{_BAR}" height="10" role="img" aria-label="{100 * share:.0f} %"'
        ' style="margin-left: .5em">'
        f'<rect width="{_BAR}" height="10" rx="2" fill="currentColor" opacity=".15"/>'
        f'<rect width="{width}" height="10" rx="2" fill="{_KEPT}"/></svg>'
    )
