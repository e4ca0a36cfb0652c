"""Two clouds in 3D with kept and dropped matches: a page, and a figure for notebooks."""

from __future__ import annotations

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
from cgroup.pages.page import chart_text, load_plotly, scale_html
from cgroup.pages.stage import Cloud, Stage, cloud_traces, place_clouds, scene_layout, stage_page
from cgroup.plots import style
from cgroup.plots.matches import spread
from cgroup.plots.shading import choose_rows, color_range, distances, face_broadside
from cgroup.rigid import apply
from cgroup.types import BoolArray, Correspondences, FloatArray, Grouping, IndexArray

MAX_POINTS = 20_000  # displayed points of a cloud; larger clouds are sampled at random
MAX_LINES = 300  # lines of one kind in a figure
_STOPS = np.array([0.0, 0.25, 0.5, 0.75, 1.0])  # of a line: where the mouse finds it
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


def line_vertices(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the vertices (6n,3) of lines, with a gap after each."""
    between = start[:, None] + _STOPS[:, None] * (end - start)[:, None]
    gaps = np.full((len(start), 1, 3), np.nan)
    return np.concatenate([between, gaps], axis=1).reshape(-1, 3)


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
    stage = Stage(
        title=view.title,
        label=f"Two point clouds in three dimensions, and lines between matched points: {view.title}",
        lead=view.lead,
        clouds=pair.clouds,
        data=_data(view, pair, rows, kinds),
        script="matches.js",
        side=f"{_methods(view)}{_switches(view, kinds)}{_about(view, rows)}",
        below="",
        help=_HELP,
        facts=view.facts,
        start=view.start,
        traces=[
            *({**line, "line": {"width": 3.0 if _is_shown(kind) else 2.0}} for kind in kinds),
            {**line, "line": {"width": 9}, "hoverinfo": "skip"},
        ],
        controls=_controls(view),
    )
    return stage_page(stage)


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
    own = [
        None if colors is None else _packed(colors[rows])
        for colors, rows in zip(view.colors, pair.rows, strict=True)
    ]
    whole = apply(view.pose, view.source), view.target
    off = [
        distances(cloud[rows], drawn.planes, other, end)
        for cloud, rows, drawn, other in zip(whole, pair.rows, pair.clouds, whole[::-1], strict=True)
    ]
    levels = [
        np.where(np.isnan(each), 255, np.clip(254 * each / end, 0, 254)).astype(np.uint8) for each in off
    ]
    ramp = {"stops": style.DISTANCE_COLORS, "alone": style.ALONE}
    return {"own": own, "distance": [_packed(each) for each in levels], **ramp}


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


def _is_shown(kind: Kind) -> bool:
    return kind.name != "dropped"


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
    return (
        f'<div class="bar"><label>colours <select id="colors" disabled>{choices}</select></label></div>'
        f'<div class="legend" id="legend" hidden>{scale}'
        f'<div><span class="swatch dot" style="--color: {style.ALONE}"></span> no counterpart</div>'
        '<div class="quiet">Distance to the other cloud under the pose, in the clouds\' unit</div></div>'
        '<div class="tip" id="tip" role="status" hidden></div>'
    )


_HELP = (
    "Colours “by distance” show where the clouds agree under the pose.",
    "Point at a line to see its match and why it was kept or dropped; a click keeps it selected.",
)


def _methods(view: View) -> str:
    if len(view.selections) == 1:
        return ""
    head = "".join(f'<th scope="col">{html.escape(column)}</th>' for column in view.columns)
    lines = ""
    for k, selection in enumerate(view.selections):
        cells = "".join(f"<td>{html.escape(number)}</td>" for number in selection.numbers)
        state = " checked" if k == view.first else ""
        lines += (
            f'<tr><th scope="row"><label><input type="radio" name="method" value="{k}"{state} disabled>'
            f"{html.escape(selection.label)}</label></th>{cells}</tr>"
        )
    table = f"<thead><tr><th></th>{head}</tr></thead><tbody>{lines}</tbody>"
    return (
        '<fieldset><legend>Method</legend><div class="scroll">'
        f'<table class="methods">{table}</table></div></fieldset>'
    )


def _switches(view: View, kinds: list[Kind]) -> str:
    clouds = [("source", "source", True, " dot"), ("target", "target", True, " dot")]
    is_apart = view.start == "apart"
    lines = [(kind.name, kind.text, is_apart and _is_shown(kind), "") for kind in kinds]
    boxes = "".join(
        f'<label><input type="checkbox" id="show-{name}"{" checked" if shown else ""} disabled>'
        f'<span class="swatch{shape}" style="--color: var(--{name})"></span>{text}'
        f'<span class="count" id="count-{name}"></span></label>'
        for name, text, shown, shape in (*clouds, *lines)
    )
    return f'<fieldset class="show"><legend>Show</legend>{boxes}</fieldset>'


def _about(view: View, rows: IndexArray) -> str:
    every = len(view.matches)
    held = "" if len(rows) == every else f"This page holds {len(rows):,} of {every:,} matches."
    return (
        '<section class="match"><label>Match number '
        f'<input type="number" id="number" min="0" max="{max(every - 1, 0)}" disabled></label>'
        f'<div id="about" aria-live="polite"></div><p class="quiet">{held}</p></section>'
    )


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
    x, y, z = line_vertices(start + source.apart, end + target.apart).astype(np.float32).T
    texts = _hover_texts(drawing, drawn.tolist())
    name = "dropped" if kind.name == "dropped" else kind.text.replace("kept", "selected")
    count = str(len(rows)) if len(drawn) == len(rows) else f"{len(drawn)} of {len(rows)} shown"
    return {
        "type": "scatter3d",
        "mode": "lines",
        "name": f"{name} ({count})",
        "x": x,
        "y": y,
        "z": z,
        "line": {"color": kind.color, "width": 3},
        "hoverinfo": "text",
        "hovertext": [text for text in texts for _ in range(len(_STOPS) + 1)],
        "visible": True if kind.text.startswith("kept") else "legendonly",
    }


def _hover_texts(drawing: Drawing, rows: Sequence[int]) -> list[str]:
    if drawing.grouping is None:
        return [f"match {row}" for row in rows]
    reasons = [chart_text(each.reason) for each in explain_matches(drawing.grouping, rows)]
    wrapped = [textwrap.wrap(text, _LINE, break_long_words=False, break_on_hyphens=False) for text in reasons]
    return [f"match {row}: {'<br>'.join(lines)}" for row, lines in zip(rows, wrapped, strict=True)]
