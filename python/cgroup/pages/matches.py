"""Two clouds in 3D with kept and dropped matches: a page, and a figure for notebooks."""

import base64
import html
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from cgroup._explain import explain_matches
from cgroup._show.drawing import Drawing
from cgroup.pages.page import chart_text, fill, load_plotly, scale_html, table_html
from cgroup.pages.stage import Cloud, Stage, cloud_traces, coordinates, place_clouds, scene_layout
from cgroup.plots import style
from cgroup.plots.matches import spread
from cgroup.plots.shading import choose_rows, color_range, distances, face_broadside
from cgroup.rigid import apply
from cgroup.types import BoolArray, Correspondences, FloatArray, Grouping, IndexArray

MAX_POINTS = 20_000  # displayed points of a cloud; larger clouds are sampled at random
MAX_LINES = 300  # lines of one kind in a figure
_STOPS = np.array([0.0, 0.25, 0.5, 0.75, 1.0, np.nan])  # of a line: where the mouse finds it, and a gap
_LINE = 60  # letters of a line of a hover text

MAX_MATCHES = 800  # matches that a page holds; of more, an even part of the kept ones and of the others
_KEPT_SHARE = 0.75

_HINT = "Point at a line, or tap it, or type the number of a match."


class Pair(NamedTuple):
    """Displayed source and target under a pose, their rows in the whole clouds, and the viewer's axes."""

    clouds: list[Cloud]
    rows: tuple[IndexArray, IndexArray]
    axes: FloatArray
    pose: FloatArray

    def ends_of(self, matches: Correspondences, rows: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Return the ends (k,3) of some matches, relative to the centre of their cloud."""
        source, target = apply(self.pose, matches.source[rows]), apply(np.eye(4), matches.target[rows])
        return (source @ self.axes.T - self.clouds[0].middle, target @ self.axes.T - self.clouds[1].middle)


def draw_pair(source: FloatArray, target: FloatArray, pose: FloatArray) -> Pair:
    """Downsample two clouds and place them in the view that shows most of the target."""
    rows = choose_rows(source, MAX_POINTS), choose_rows(target, MAX_POINTS)
    posed = {0: apply(pose, source[rows[0]]), 1: target[rows[1]]}
    axes = face_broadside(posed[1]).axes
    tints = to_hex(style.SOURCE_TINT), to_hex(style.TARGET_TINT)
    return Pair(place_clouds(posed, axes, ("source", "target"), tints, [[0, 1]]), rows, axes, pose)


class Kind(NamedTuple):
    """A kind of matches: key, name on pages, rows, and colour."""

    name: str
    text: str
    rows: BoolArray
    color: str


def kinds_of(mask: BoolArray, correct: BoolArray | None) -> list[Kind]:
    """Divide matches into kept and dropped ones, and into correct and wrong ones if known."""
    if correct is None:
        return [
            Kind("group", "kept", mask, style.GROUPED),
            Kind("dropped", "dropped", ~mask, style.QUIET_TEXT),
        ]
    return [
        Kind("correct", "kept, correct", mask & correct, style.CORRECT),
        Kind("wrong", "kept, wrong", mask & ~correct, style.WRONG),
        Kind("missed", "dropped, correct", ~mask & correct, style.MISSED),
        Kind("dropped", "dropped, wrong", ~mask & ~correct, style.QUIET_TEXT),
    ]


@dataclass(frozen=True, eq=False)
class Selection:
    """The group of one method."""

    label: str
    grouping: Grouping
    numbers: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class View:
    """Content of a page."""

    title: str  # plain text
    lead: str  # HTML below the title
    source: FloatArray  # whole clouds
    target: FloatArray
    matches: Correspondences
    colors: tuple[NDArray[np.uint8] | None, NDArray[np.uint8] | None]  # their own, (N,3)
    pose: FloatArray  # of the source in the target's frame
    correct: BoolArray | None  # which matches are correct, and the true pose, if known
    truth: FloatArray | None
    selections: Sequence[Selection]
    first: int = 0  # the selection that is shown first
    columns: tuple[str, ...] = ()  # heads of the selections' numbers
    facts: Sequence[tuple[str, str]] = ()  # names and HTML, below the view
    start: str = "apart"  # with lines; or "joined", coloured by distance, without


def view_page(view: View) -> str:
    """Return the page of a view."""
    pair = draw_pair(view.source, view.target, view.pose)
    rows = _rows(view)
    kinds = kinds_of(view.selections[0].grouping.mask, view.correct)
    line = {"type": "scatter3d", "mode": "lines", "x": [], "y": [], "z": [], "hoverinfo": "none"}
    return Stage(
        kind="matches",
        title=view.title,
        label=f"Two point clouds in three dimensions, and lines between matched points: {view.title}",
        lead=view.lead,
        clouds=pair.clouds,
        data=_data(view, pair, rows, kinds),
        side=_side(view, rows, kinds),
        facts=view.facts,
        start=view.start,
        traces=[
            *({**line, "line": {"width": 2.0 if kind.name == "dropped" else 3.0}} for kind in kinds),
            {**line, "line": {"width": 9}, "hoverinfo": "skip"},
        ],
        controls=_controls(view),
    ).page()


def _rows(view: View) -> IndexArray:
    interesting = np.zeros(len(view.matches), dtype=bool) if view.correct is None else view.correct.copy()
    for selection in view.selections:
        interesting |= selection.grouping.mask
    first, others = np.flatnonzero(interesting), np.flatnonzero(~interesting)
    room = max(round(_KEPT_SHARE * MAX_MATCHES), MAX_MATCHES - len(others))
    first = spread(first, room)
    return np.sort(np.concatenate([first, spread(others, MAX_MATCHES - len(first))]))


def _data(view: View, pair: Pair, rows: IndexArray, kinds: list[Kind]) -> dict[str, Any]:
    resolution = view.matches.resolution
    size = float(pair.clouds[1].size.max()) or 1.0
    digits = 5 - int(np.floor(np.log10(size)))  # to a hundred-thousandth of the scene
    source, target = (np.round(ends, digits).tolist() for ends in pair.ends_of(view.matches, rows))
    matches = {"index": rows.tolist(), "source": source, "target": target}
    if view.truth is not None:
        off = apply(view.truth, view.matches.source[rows]) - view.matches.target[rows]
        matches["error"] = _short(np.linalg.norm(off, axis=1) / (resolution or 1.0))
    return {
        "count": len(view.matches),
        "unit": " pr" if resolution else "",
        "hint": _HINT,
        "kinds": [{"id": kind.name, "name": kind.text} for kind in kinds],
        "matches": matches,
        "colors": _colors(view, pair),
        "methods": [_method(each.grouping, view.correct, rows) for each in view.selections],
    }


def _colors(view: View, pair: Pair) -> dict[str, Any]:
    """Return the colours of clouds as bytes: three for each point's own colour, one for its distance."""
    end = color_range(view.matches, view.target)
    source, target = apply(view.pose, view.source), view.target
    shown: dict[str, Any] = {"own": [], "distance": [], "stops": style.DISTANCE_COLORS, "alone": style.ALONE}
    clouds = (source, target), (target, source), pair.rows, pair.clouds, view.colors
    for cloud, other, rows, drawn, colors in zip(*clouds, strict=True):
        off = distances(cloud[rows], drawn.planes, other, end)
        levels = np.where(np.isnan(off), 255, np.clip(254 * off / end, 0, 254))
        shown["own"].append(None if colors is None else _packed(colors[rows]))
        shown["distance"].append(_packed(levels.astype(np.uint8)))
    return shown


def _packed(values: NDArray[np.uint8]) -> str:
    return base64.b64encode(values.tobytes()).decode("ascii")


def _method(grouping: Grouping, correct: BoolArray | None, rows: IndexArray) -> dict[str, Any]:
    """Return scores, ranks, kinds and reasons of matches by one method."""
    kinds = kinds_of(grouping.mask, correct)
    explained = explain_matches(grouping, rows.tolist())
    unit = (explained[0].resolution if explained else None) or 1.0

    def known(name: str) -> list[Any] | None:
        values = [getattr(each, name) for each in explained]
        return values if explained and values[0] is not None else None

    scores, residuals = known("score"), known("residual")
    return {
        "score": scores and _short(np.array(scores)),
        "rank": scores and known("rank"),
        "residual": residuals and _short(np.array(residuals) / unit),
        "agreeing": known("agreeing"),
        "agreeing_in_group": known("agreeing_in_group"),
        "kind": np.argmax([kind.rows[rows] for kind in kinds], axis=0).tolist(),
        "counts": [int(kind.rows.sum()) for kind in kinds],
        "why": [each.reason for each in explained],
    }


def _short(values: FloatArray) -> list[float | None]:
    """Round to four digits; None if not finite."""
    return [float(f"{value:.4g}") if np.isfinite(value) else None for value in values]


def _controls(view: View) -> str:
    """Return the HTML of the colour menu, the distance scale, and the tooltip of a line."""
    named = {"scan": "by cloud", "distance": "by distance", "own": "as scanned"}
    if all(colors is None for colors in view.colors):
        del named["own"]
    first = "own" if "own" in named else "distance" if view.start == "joined" else "scan"
    choices = "".join(
        f'<option value="{name}"{" selected" if name == first else ""}>{text}</option>'
        for name, text in named.items()
    )
    scale = scale_html(style.DISTANCE_COLORS, color_range(view.matches, view.target))
    return fill("matches_controls.html", choices=choices, scale=scale, alone=style.ALONE)


def _side(view: View, rows: IndexArray, kinds: list[Kind]) -> str:
    """Return the HTML of the choices of a method, of clouds and kinds of lines, and of a match."""
    clouds = [("source", "source", True, " dot"), ("target", "target", True, " dot")]
    shown = view.start == "apart"
    lines = [(kind.name, kind.text, shown and kind.name != "dropped", "") for kind in kinds]
    boxes = "".join(
        f'<label><input type="checkbox" id="show-{name}"{" checked" if shown else ""} disabled>'
        f'<span class="swatch{shape}" style="--color: var(--{name})"></span>{text}'
        f'<span class="count" id="count-{name}"></span></label>'
        for name, text, shown, shape in (*clouds, *lines)
    )
    every = len(view.matches)
    held = "" if len(rows) == every else f"This page holds {len(rows):,} of {every:,} matches."
    last = max(every - 1, 0)
    return fill("matches_side.html", methods=_methods(view), boxes=boxes, last=last, held=held)


def _methods(view: View) -> str:
    if len(view.selections) == 1:
        return ""
    lines = ""
    for k, selection in enumerate(view.selections):
        cells = "".join(f"<td>{html.escape(number)}</td>" for number in selection.numbers)
        state = " checked" if k == view.first else ""
        lines += (
            f'<tr><th scope="row"><label><input type="radio" name="method" value="{k}"{state} disabled>'
            f"{html.escape(selection.label)}</label></th>{cells}</tr>"
        )
    table = table_html(("", *view.columns), lines, label="Methods")
    return f"<fieldset><legend>Method</legend>{table}</fieldset>"


def figure_of(drawing: Drawing) -> Any:  # noqa: ANN401 - plotly has no types
    """Draw two clouds side by side, and lines between matched points."""
    make = load_plotly("graph_objects").Figure
    pair = draw_pair(drawing.source, drawing.target, drawing.pose)
    kinds = kinds_of(drawing.mask, drawing.correct)
    lines = [_line_trace(drawing, pair, kind) for kind in kinds if kind.rows.any()]
    layout = {
        "scene": scene_layout(),
        "title": {"text": chart_text(drawing.title)},
        "legend": {"orientation": "h", "itemsizing": "constant"},
        "margin": {"l": 0, "r": 0, "t": 40, "b": 0},
        "template": "none",
    }
    return make(data=[*cloud_traces(pair.clouds, "apart"), *lines], layout=layout)


def _line_trace(drawing: Drawing, pair: Pair, kind: Kind) -> dict[str, Any]:
    rows = np.flatnonzero(kind.rows)
    drawn = spread(rows, MAX_LINES)
    start, end = pair.ends_of(drawing.matches, drawn)
    source, target = pair.clouds
    start, end = start + source.apart, end + target.apart
    points = start[:, None] + _STOPS[:, None] * (end - start)[:, None]
    texts = _hover_texts(drawing, drawn.tolist())
    name = "dropped" if kind.name == "dropped" else kind.text.replace("kept", "selected")
    count = str(len(rows)) if len(drawn) == len(rows) else f"{len(drawn)} of {len(rows)} shown"
    return {
        "type": "scatter3d",
        "mode": "lines",
        "name": f"{name} ({count})",
        **coordinates(points.reshape(-1, 3)),
        "line": {"color": kind.color, "width": 3},
        "hoverinfo": "text",
        "hovertext": [text for text in texts for _ in _STOPS],
        "visible": True if kind.text.startswith("kept") else "legendonly",
    }


def _hover_texts(drawing: Drawing, rows: Sequence[int]) -> list[str]:
    if drawing.grouping is None:
        return [f"match {row}" for row in rows]
    reasons = [chart_text(each.reason) for each in explain_matches(drawing.grouping, rows)]
    wrapped = [textwrap.wrap(text, _LINE, break_long_words=False, break_on_hyphens=False) for text in reasons]
    return [f"match {row}: {'<br>'.join(lines)}" for row, lines in zip(rows, wrapped, strict=True)]
