"""Clouds on a page: seen from one side, and movable between side by side and joined."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgroup.pages.page import chart_html, chart_text, data_html, facts_html, page_html, part
from cgroup.plots.shading import AMBIENT, LIGHT, planes
from cgroup.types import FloatArray

LEVELS = 255  # levels of light
_TO_LIGHT = LIGHT / np.linalg.norm(LIGHT)

_SIZES = ((60_000, 1.6), (4_000, 2.2), (0, 3.5))  # pixels of a point, by how many more than that are drawn
_GAP = 0.15  # gap between clouds side by side, in sides of a square as large as their average box
_WIDE = 1.5  # width over height of the layout side by side
_RIM = 0.002  # share of the points on either side that a box may leave out, as far outliers


@dataclass(frozen=True, eq=False)
class Cloud:
    """A displayed cloud: right, up and towards the viewer, from the centre of its bounding box."""

    name: str
    color: str  # #rrggbb
    points: FloatArray  # (k,3)
    planes: FloatArray  # (k,3) normals in the data's axes
    light: NDArray[np.uint8]  # (k,)
    middle: FloatArray  # (3,) of the box, once posed
    size: FloatArray  # (3,) of the box
    joined: FloatArray  # (3,) positions of the middle
    apart: FloatArray


def place_clouds(
    posed: Mapping[int, FloatArray],
    axes: FloatArray,
    names: Sequence[str],
    colors: Sequence[str],
    groups: Sequence[Sequence[int]],
) -> list[Cloud]:
    """Place posed clouds, in the order of `groups`: joined in groups, and all side by side."""
    boxes = {row: _box(points @ axes.T) for row, points in posed.items()}
    around = [
        (np.min([boxes[row][0] for row in rows], axis=0), np.max([boxes[row][1] for row in rows], axis=0))
        for rows in groups
    ]
    order = [row for rows in groups for row in rows]
    together = arrange([high - low for low, high in around])
    alone = dict(zip(order, arrange([boxes[row][1] - boxes[row][0] for row in order]), strict=True))
    clouds: list[Cloud] = []
    for rows, (first, last), center in zip(groups, around, together, strict=True):
        for row in rows:
            low, high = boxes[row]
            middle, faces = (low + high) / 2, planes(posed[row])
            joined = middle - (first + last) / 2 + center
            points = posed[row] @ axes.T - middle
            look = names[row], colors[row], points, faces, _lit(faces, axes)
            clouds.append(Cloud(*look, middle, high - low, joined, alone[row]))
    return clouds


def _box(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    low, high = np.quantile(points, (_RIM, 1 - _RIM), axis=0)
    room = 0.05 * (high - low).max()
    return np.maximum(low - room, points.min(axis=0)), np.minimum(high + room, points.max(axis=0))


def arrange(sizes: Sequence[FloatArray]) -> list[FloatArray]:
    """Return the centres of boxes in rows without overlap."""
    gap = _GAP * float(np.sqrt(np.mean([size[0] * size[1] for size in sizes])))
    widths = np.cumsum([size[0] + gap for size in sizes])
    layouts = [_fill_lines(sizes, gap, width) for width in widths]

    def side(layout: FloatArray) -> float:
        ends = layout[:, :2] + np.array(sizes)[:, :2] / 2 * [1, -1]
        return max(ends[:, 0].max() / _WIDE, -ends[:, 1].min())

    return list(min(layouts, key=side))


def _fill_lines(sizes: Sequence[FloatArray], gap: float, width: float) -> FloatArray:
    middles: list[tuple[float, float, float]] = []
    left = top = height = 0.0
    for wide, high, _ in sizes:
        if left and left + wide > width:
            left, top, height = 0.0, top - height - gap, 0.0
        middles.append((left + wide / 2, top - high / 2, 0.0))
        left, height = left + wide + gap, max(height, high)
    return np.array(middles)


def _lit(planes: FloatArray, axes: FloatArray) -> NDArray[np.uint8]:
    """Return the brightness (k,) of the plane about each point, for either orientation."""
    facing = np.where(planes.any(axis=1, keepdims=True), planes @ axes.T, _TO_LIGHT)
    facing *= np.where(facing[:, 2:] < 0.0, -1.0, 1.0)
    return np.round(LEVELS * np.clip(facing @ _TO_LIGHT, 0.0, 1.0)).astype(np.uint8)


def cloud_traces(clouds: Sequence[Cloud], place: str, *, is_named: bool = False) -> list[dict[str, Any]]:
    """Return plotly's traces of clouds, `joined` or `apart`, with or without hover texts."""
    count = sum(len(cloud.points) for cloud in clouds)
    size = next(size for least, size in _SIZES if count > least)
    hover = {"hovertemplate": "%{fullData.name}<extra></extra>"} if is_named else {"hoverinfo": "skip"}
    return [{**_trace(cloud, getattr(cloud, place), size), **hover} for cloud in clouds]


def _trace(cloud: Cloud, at: FloatArray, size: float) -> dict[str, Any]:
    x, y, z = (cloud.points + at).astype(np.float32).T
    dark = [round(AMBIENT * int(cloud.color[k : k + 2], 16)) for k in (1, 3, 5)]
    marker = {
        "size": size,
        "color": cloud.light,
        "cmin": 0,
        "cmax": LEVELS,
        "colorscale": [[0, f"rgb({', '.join(map(str, dark))})"], [1, cloud.color]],
        "showscale": False,
        "line": {"width": 0},
    }
    name = chart_text(cloud.name)
    return {"type": "scatter3d", "mode": "markers", "name": name, "x": x, "y": y, "z": z, "marker": marker}


def scene_layout() -> dict[str, Any]:
    """Return plotly's layout of a scene without axes, seen from the front."""
    hidden = {"visible": False, "showspikes": False}
    return {
        **dict.fromkeys(("xaxis", "yaxis", "zaxis"), hidden),
        "aspectmode": "data",
        "dragmode": "orbit",
        "camera": {"eye": {"x": 0, "y": 0, "z": 1.6}, "up": {"x": 0, "y": 1, "z": 0}},
    }


@dataclass(frozen=True, eq=False)
class Stage:
    """A page of clouds; all fields except `title`, `label` and `data` are HTML."""

    title: str
    label: str  # of the chart, for readers of the screen
    lead: str
    clouds: Sequence[Cloud]
    data: dict[str, Any]  # for the page's own script
    script: str
    side: str
    below: str
    help: Sequence[str]
    facts: Sequence[tuple[str, str]]
    start: str = "joined"
    is_named: bool = False  # whether clouds show their names when pointed at
    traces: Sequence[dict[str, Any]] = ()
    controls: str = ""


def stage_page(stage: Stage) -> str:
    """Return the page: clouds and controls, side and bottom panels, facts and help."""
    layout = {"scene": scene_layout(), "margin": {"l": 0, "r": 0, "t": 0, "b": 0}, "showlegend": False}
    traces = [*cloud_traces(stage.clouds, stage.start, is_named=stage.is_named), *stage.traces]
    figure = {"data": traces, "layout": layout}
    chart = chart_html("scene", figure, label=stage.label, height="min(68vh, 46rem)")
    places = {name: [getattr(cloud, name).tolist() for cloud in stage.clouds] for name in ("joined", "apart")}
    boxes = {name: _bounds(stage.clouds, name) for name in places}
    sizes = [cloud.size.tolist() for cloud in stage.clouds]
    data = {"start": stage.start, **places, "boxes": boxes, "sizes": sizes, **stage.data}
    share = 100 if stage.start == "joined" else 0
    listed = "".join(f"<li>{line}</li>" for line in (*_HELP, *stage.help))
    body = (
        f"<main><h1>{html.escape(stage.title)}</h1>{stage.lead}"
        f'<div class="viewer"><div class="stage">{chart}{_CONTROLS.format(share=share)}{stage.controls}</div>'
        f'<aside class="side">{stage.side}</aside></div>{stage.below}{facts_html(stage.facts)}'
        f"<details><summary>Controls</summary><ul>{listed}</ul></details></main>"
        f"{data_html('stage-data', data)}"
    )
    return page_html(stage.title, body, css=part("viewer.css"), script=part("stage.js") + part(stage.script))


def _bounds(clouds: Sequence[Cloud], place: str) -> list[list[float]]:
    places = np.array([getattr(cloud, place) for cloud in clouds])
    half = np.array([cloud.size for cloud in clouds]) / 2
    return [(places - half).min(axis=0).tolist(), (places + half).max(axis=0).tolist()]


_CONTROLS = """
<div class="bar" role="group" aria-label="Position of the clouds">
<button type="button" id="play" disabled>Join</button>
<label style="flex: 1 1 14rem">apart <input type="range" id="place" min="0" max="100" value="{share}" disabled
 aria-label="from apart to joined"> joined</label>
<button type="button" id="reset" disabled>Reset the view</button>
</div>
"""

_HELP = (
    "Drag to rotate, scroll or pinch to zoom, drag with the right button (or two fingers) to pan.",
    "The slider moves the clouds from side by side to their poses.",
    "The file is self-contained: it loads nothing from the network.",
)
