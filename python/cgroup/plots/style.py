"""Colours, markers and labels, the same in every figure.

Method colours are Paul Tol's "muted" scheme, which stays distinct for colour-blind readers; the
markers tell the methods apart in print, and dashes the individual-based methods from the group-based.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from cgroup.registry import METHOD_INFO

if TYPE_CHECKING:
    from matplotlib.typing import LineStyleType


class MethodStyle(NamedTuple):
    """How one method is drawn."""

    label: str
    color: str
    marker: str
    dashes: LineStyleType = "-"


_INDIVIDUAL: LineStyleType = (0, (4, 1.5))

METHOD_STYLES = {
    info.name: MethodStyle(info.label, info.color, info.marker, _INDIVIDUAL if info.individual else "-")
    for info in METHOD_INFO.values()
}

_FURTHER_MARKERS = ("h", "p", "8", "d", ">", "H")

CORRECT = "#009E73"
"""Correct matches: a bluish green, told from `WRONG` by every common kind of colour vision."""

WRONG = "#D55E00"
"""Wrong matches: vermilion."""

MISSED = "#CC79A7"
"""Correct matches that were dropped: a reddish purple, of the same scheme."""

GROUPED = "#0072B2"
"""Matches of a group where it isn't known which are correct."""

SOURCE_TINT = (0.93, 0.83, 0.62)
TARGET_TINT = (0.70, 0.80, 0.91)
"""Clouds are shaded in these colours."""

TEXT = "#222222"
QUIET_TEXT = "#666666"
GRID = "#e3e3e3"
DOTS_PER_INCH = 150
PRINT_WIDTH = 7.2
"""Inches: both columns of a page."""


def method_style(method: str) -> MethodStyle:
    """Style of a method by its public name; grey for one that isn't known here, its marker by its name."""
    marker = _FURTHER_MARKERS[sum(method.encode()) % len(_FURTHER_MARKERS)]
    return METHOD_STYLES.get(method, MethodStyle(method.upper(), "#666666", marker))
