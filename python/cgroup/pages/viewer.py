"""A page with two clouds to turn around, and the matches that methods kept and dropped."""

from __future__ import annotations

import base64
import html
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup._explain import explain_matches
from cgroup.pages.page import chart_html, data_html, page_html
from cgroup.pages.page import part as part_of
from cgroup.pages.scene import cloud_traces, kinds_of, scene_layout, scene_of
from cgroup.plots import style
from cgroup.plots.agreement import color_range, distances
from cgroup.plots.scene import spread
from cgroup.rigid import apply

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from cgroup.pages.scene import Kind, Scene
    from cgroup.types import BoolArray, Correspondences, FloatArray, Grouping, IndexArray

MAX_MATCHES = 800
"""Matches that a page holds; of more, an even part of those kept and of the others."""

_KEPT_SHARE = 0.75

_HINT = "Point at a line, or tap it, or type the number of a match."


@dataclass(frozen=True, eq=False)
class Selection:
    """What one method kept."""

    label: str
    grouping: Grouping
    numbers: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class View:
    """What a page shows."""

    title: str  # plain text
    lead: str  # HTML below the title
    source: FloatArray  # whole clouds
    target: FloatArray
    matches: Correspondences
    colors: tuple[NDArray[np.uint8] | None, NDArray[np.uint8] | None]  # their own, (N,3)
    pose: FloatArray  # lays the source on the target
    correct: BoolArray | None  # which matches are correct, and the true pose, where that is known
    truth: FloatArray | None
    selections: Sequence[Selection]
    first: int = 0  # the selection that is shown first
    columns: tuple[str, ...] = ()  # heads of the selections' numbers
    facts: Sequence[tuple[str, str]] = ()  # names and HTML, below the view


def view_html(view: View) -> str:
    """Put a page together."""
    scene = scene_of(view.source, view.target, view.pose)
    rows = _rows(view)
    kinds = kinds_of(view.selections[0].grouping.mask, view.correct)
    data = data_html("viewer-data", _data(view, scene, rows, kinds))
    body = (
        f"<main><h1>{html.escape(view.title)}</h1>{view.lead}"
        f'<div class="viewer"><div class="stage">{_chart(view, scene, kinds)}{_controls(view)}</div>'
        f'<aside class="side">{_methods(view)}{_switches(kinds)}{_about(view, rows)}</aside></div>'
        f"{_facts(view.facts)}{_HELP}</main>{data}"
    )
    return page_html(view.title, body, css=part_of("viewer.css"), script=part_of("viewer.js"))


def _rows(view: View) -> IndexArray:
    """Return the matches that the page holds."""
    interesting = np.zeros(len(view.matches), dtype=bool) if view.correct is None else view.correct.copy()
    for selection in view.selections:
        interesting |= selection.grouping.mask
    first, others = np.flatnonzero(interesting), np.flatnonzero(~interesting)
    room = max(round(_KEPT_SHARE * MAX_MATCHES), MAX_MATCHES - len(others))
    first = spread(first, room)
    return np.sort(np.concatenate([first, spread(others, MAX_MATCHES - len(first))]))


def _data(view: View, scene: Scene, rows: IndexArray, kinds: list[Kind]) -> dict[str, Any]:
    resolution = view.matches.resolution
    source = apply(np.eye(4), view.matches.source[rows]) - scene.source.center
    target = apply(np.eye(4), view.matches.target[rows]) - scene.target.center
    size = float(np.ptp(scene.target.points, axis=0).max()) or 1.0
    digits = 5 - int(np.floor(np.log10(size)))  # to a hundred-thousandth of the scene
    matches = {
        "index": rows.tolist(),
        "source": np.round(source, digits).tolist(),
        "target": np.round(target, digits).tolist(),
    }
    if view.truth is not None:
        off = apply(view.truth, view.matches.source[rows]) - view.matches.target[rows]
        matches["error"] = _short(np.linalg.norm(off, axis=1) / (resolution or 1.0))
    return {
        "count": len(view.matches),
        "unit": " pr" if resolution else "",
        "hint": _HINT,
        "kinds": [{"id": kind.name, "name": kind.text} for kind in kinds],
        "poses": {
            name: getattr(scene, name)[:3].reshape(-1).tolist() for name in ("given", "apart", "placed")
        },
        "camera": {name: getattr(scene, name).tolist() for name in ("right", "up", "towards")},
        "matches": matches,
        "colors": _colors(view, scene),
        "methods": [_method(each.grouping, view.correct, rows) for each in view.selections],
    }


def _colors(view: View, scene: Scene) -> dict[str, Any]:
    """Return what clouds are coloured by, as bytes: three of each point's own colour, one of its distance."""
    end = color_range(view.matches, view.target)
    own = [
        None if colors is None else _packed(colors[cloud.rows])
        for colors, cloud in zip(view.colors, (scene.source, scene.target), strict=True)
    ]
    posed = apply(view.pose, view.source)
    off = [
        distances(cloud[drawn.rows], drawn.planes, other, end)
        for cloud, drawn, other in ((posed, scene.source, view.target), (view.target, scene.target, posed))
    ]
    levels = [
        np.where(np.isnan(each), 255, np.clip(254 * each / end, 0, 254)).astype(np.uint8) for each in off
    ]
    ramp = {"stops": style.DISTANCE_COLORS, "alone": style.ALONE}
    return {"own": own, "distance": [_packed(each) for each in levels], **ramp}


def _packed(values: NDArray[np.uint8]) -> str:
    return base64.b64encode(values.tobytes()).decode("ascii")


def _method(grouping: Grouping, correct: BoolArray | None, rows: IndexArray) -> dict[str, Any]:
    """Return what is known of each match by one method."""
    kinds = kinds_of(grouping.mask, correct)
    said = explain_matches(grouping, rows.tolist())
    unit = (said[0].resolution if said else None) or 1.0

    def known(name: str) -> list[Any] | None:
        values = [getattr(each, name) for each in said]
        return values if said and values[0] is not None else None

    scores, residuals = known("score"), known("residual")
    return {
        "score": scores and _short(np.array(scores)),
        "rank": scores and known("rank"),
        "residual": residuals and _short(np.array(residuals) / unit),
        "agreeing": known("agreeing"),
        "agreeing_in_group": known("agreeing_in_group"),
        "kind": np.argmax([kind.rows[rows] for kind in kinds], axis=0).tolist(),
        "counts": [int(kind.rows.sum()) for kind in kinds],
        "why": [each.reason for each in said],
    }


def _short(values: FloatArray) -> list[float | None]:
    """Round to four digits; what isn't finite is left out."""
    return [float(f"{value:.4g}") if np.isfinite(value) else None for value in values]


def _chart(view: View, scene: Scene, kinds: list[Kind]) -> str:
    lines = {"type": "scatter3d", "mode": "lines", "x": [], "y": [], "z": [], "hoverinfo": "none"}
    figure = {
        "data": [
            *cloud_traces(scene),
            *({**lines, "line": {"width": 3.0 if _is_shown(kind) else 2.0}} for kind in kinds),
            {**lines, "line": {"width": 9}, "hoverinfo": "skip"},
        ],
        "layout": {
            "scene": {**scene_layout(scene), "dragmode": "orbit"},
            "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
            "showlegend": False,
        },
    }
    label = f"Two point clouds in three dimensions, and lines between matched points: {view.title}"
    tip = '<div class="tip" id="tip" role="status" hidden></div>'
    return chart_html("scene", figure, label=label, height="min(68vh, 46rem)") + tip


def _is_shown(kind: Kind) -> bool:
    return kind.name != "dropped"


def _legend(view: View) -> str:
    """Return the colours of distances, shown while the clouds have them."""
    end = color_range(view.matches, view.target)
    ramp = f"linear-gradient(90deg, {', '.join(style.DISTANCE_COLORS)})"
    return (
        '<div class="legend" id="legend" hidden>'
        f'<div class="scale"><div style="background: {ramp}"></div>'
        f"<span>0</span><span>{end / 2:.2g}</span><span>≥ {end:.2g}</span></div>"
        f'<div><span class="swatch dot" style="--color: {style.ALONE}"></span> no counterpart</div>'
        '<div class="quiet">Distance to the other cloud under the pose, in the clouds\' unit</div></div>'
    )


def _controls(view: View) -> str:
    named = {"scan": "by cloud", "distance": "by distance", "own": "as scanned"}
    if all(colors is None for colors in view.colors):
        del named["own"]
    choices = "".join(f'<option value="{name}">{text}</option>' for name, text in named.items())
    return f"""
<div class="bar" role="group" aria-label="Place of the source">
<button type="button" id="play" disabled>Place it</button>
<label>from <select id="start" disabled>
<option value="apart">side by side</option><option value="given">as in the files</option></select></label>
<label style="flex: 1 1 14rem">to where the pose lays it
<input type="range" id="place" min="0" max="100" value="0" disabled></label>
</div>
<div class="bar" role="group" aria-label="Colours and camera">
<label>colours <select id="colors" disabled>{choices}</select></label>
<button type="button" id="reset" disabled>Reset the view</button>
<label><input type="checkbox" id="perspective" checked disabled> perspective</label>
</div>
{_legend(view)}"""


_HELP = """
<details><summary>What to press</summary>
<ul>
<li>Drag to turn, scroll or pinch to zoom, drag with the right button (or two fingers) to shift.</li>
<li>“Place it” moves the source onto the target; the slider stops it anywhere on the way.</li>
<li>Colours “by distance” show where the clouds agree once the pose is applied, and where they don't.</li>
<li>Point at a line to see which match it is and why it was kept or dropped; a click keeps it.</li>
<li>The file holds everything that it shows, and fetches nothing: it can be sent as it is.</li>
</ul>
</details>
"""


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


def _switches(kinds: list[Kind]) -> str:
    clouds = [("source", "source", True, " dot"), ("target", "target", True, " dot")]
    lines = [(kind.name, kind.text, _is_shown(kind), "") for kind in kinds]
    boxes = "".join(
        f'<label><input type="checkbox" id="show-{name}"{" checked" if shown else ""} disabled>'
        f'<span class="swatch{shape}" style="--color: var(--{name})"></span>{text}'
        f'<span class="count" id="count-{name}"></span></label>'
        for name, text, shown, shape in (*clouds, *lines)
    )
    return f'<fieldset class="show"><legend>Show</legend>{boxes}</fieldset>'


def _about(view: View, rows: IndexArray) -> str:
    every = len(view.matches)
    held = "" if len(rows) == every else f"{len(rows):,} of {every:,} matches are in this page."
    return (
        '<section class="match"><label>Match number '
        f'<input type="number" id="number" min="0" max="{max(every - 1, 0)}" disabled></label>'
        f'<div id="about" aria-live="polite"></div><p class="quiet">{held}</p></section>'
    )


def _facts(facts: Sequence[tuple[str, str]]) -> str:
    if not facts:
        return ""
    lines = "".join(f"<dt>{html.escape(name)}</dt><dd>{value}</dd>" for name, value in facts)
    return f'<dl class="facts">{lines}</dl>'
