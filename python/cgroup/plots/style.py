"""Colours, markers and labels, the same in every figure.

The colours of the paper's methods are Paul Tol's "muted" scheme, which is distinct for colour-blind readers;
individual-based methods are dashed. Methods from outside get other colours and markers, in order; the colours
are at least 13 apart from each other and 9 from the package's in CIEDE2000, also for simulated deuteranopia,
protanopia and tritanopia (Machado et al., 2009).
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from matplotlib.path import Path
from matplotlib.transforms import Affine2D
from matplotlib.typing import LineStyleType

from cgroup.registry import METHOD_INFO


class MethodStyle(NamedTuple):
    """Style of one method."""

    label: str
    color: str  # as #RRGGBB
    marker: str | Path  # matplotlib's
    symbol: str  # the same marker by plotly's name
    size: float = 1.0  # beside that of a disk: pointed markers look smaller than they are
    dashes: LineStyleType = "-"


SYMBOLS = {
    "o": "circle", "s": "square", "^": "triangle-up", "v": "triangle-down", "<": "triangle-left",
    ">": "triangle-right", "D": "diamond", "d": "diamond-tall", "P": "cross", "X": "x", "*": "star",
    "p": "pentagon", "h": "hexagon", "H": "hexagon2", "8": "octagon",
}  # fmt: skip
"""Markers by matplotlib's and by plotly's names."""

METHOD_STYLES = {
    info.name: MethodStyle(
        info.label, info.color, info.marker, SYMBOLS[info.marker],
        1.55 if info.marker == "*" else 1.0, (0, (4, 1.5)) if info.individual else "-",
    )
    for info in METHOD_INFO.values()
}  # fmt: skip
"""Those of the package."""

# Of methods from outside, in this order.
OWN_COLORS = ("#0000FF", "#D20F00", "#D2A5B4", "#784B4B", "#7878FF", "#78000F", "#B4C396", "#9687B4")


def _outline(*corners: tuple[float, float]) -> Path:
    return Path([*corners, corners[0]], closed=True)


OWN_MARKERS = (
    (Path.unit_regular_star(4, 0.4), "star-diamond", 1.6),
    (_outline((-0.9, -1), (0.9, -1), (-0.9, 1), (0.9, 1)), "hourglass", 1.1),
    (Path.unit_regular_star(6, 0.55), "hexagram", 1.35),
    (_outline((-1, -0.9), (-1, 0.9), (1, -0.9), (1, 0.9)), "bowtie", 1.1),
    (Path.unit_regular_star(3, 0.3), "star-triangle-up", 1.6),
    (_outline((-1.2, 0), (0, 0.65), (1.2, 0), (0, -0.65)), "diamond-wide", 1.3),
    (Path.unit_regular_star(4, 0.4).transformed(Affine2D().rotate_deg(45)), "star-square", 1.4),
    (_outline((-0.9, 0.9), (0.9, 0.9), (0.9, -0.9)), "triangle-ne", 1.0),
)
"""Of methods from outside: matplotlib's, plotly's, and sizes."""

# Correct matches: a bluish green, distinct from `WRONG` for all common kinds of colour vision.
CORRECT = "#009E73"
WRONG = "#D55E00"  # wrong matches: vermilion
MISSED = "#CC79A7"  # correct matches that were dropped: a reddish purple, of the same scheme
GROUPED = "#0072B2"  # matches of a group where it isn't known which are correct
# Clouds are shaded in these colours.
SOURCE_TINT = (0.93, 0.83, 0.62)
TARGET_TINT = (0.70, 0.80, 0.91)
# Distances from none to the greatest: a part of matplotlib's viridis, lighter with every step.
DISTANCE_COLORS = ("#414487", "#2f6c8e", "#21918c", "#2fb47c", "#7ad151", "#dfe318")
ALONE = "#bcbcbc"  # points without a counterpart in the other cloud
TEXT = "#222222"
QUIET_TEXT = "#666666"
GRID = "#e3e3e3"
DOTS_PER_INCH = 150
PRINT_WIDTH = 7.2  # inches: both columns of a page


def method_styles(
    methods: Iterable[str], chosen: Mapping[str, MethodStyle] | None = None
) -> dict[str, MethodStyle]:
    """Return the styles of all methods of a figure or a report."""
    # Methods of the package and those chosen already keep their looks; each of the others takes the next of
    # `OWN_COLORS` and `OWN_MARKERS`, and its name as the label.
    names = list(dict.fromkeys(methods))
    known = METHOD_STYLES | dict(chosen or {})
    own = own_styles((name for name in names if name not in known), len(known) - len(METHOD_STYLES))
    return {name: known.get(name) or own[name] for name in names}


def method_style(method: str) -> MethodStyle:
    """Return the style of a method; any method of the user's own gets the first of the other styles."""
    return method_styles([method])[method]


def as_it_is(text: str) -> str:
    """Return a text with escapes for matplotlib, which parses formulas between dollar signs."""
    return text.replace("$", r"\$")


def own_styles(names: Iterable[str], used: int = 0) -> dict[str, MethodStyle]:
    """Return styles for foreign methods after a number of others; the first 64 are all different."""
    colors = len(OWN_COLORS)
    return {
        name: MethodStyle(
            name, OWN_COLORS[place % colors], *OWN_MARKERS[(place + place // colors) % len(OWN_MARKERS)]
        )
        for place, name in enumerate(names, used)
    }
