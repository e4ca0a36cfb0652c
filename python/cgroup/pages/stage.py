"""Clouds on a page: seen from one side, and movable between side by side and joined."""

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgroup.pages.page import chart_html, chart_text, data_html, facts_html, fill, page_html, part
from cgroup.plots.shading import AMBIENT, LIGHT, planes
from cgroup.types import FloatArray

LEVELS = 255  # levels of light
_TO_LIGHT = LIGHT / np.linalg.norm(LIGHT)

_SIZES = ((60_000, 1.6), (4_000, 2.2), (0, 3.5))  # pixels of a point, by how many more than that are drawn
_GAP = 0.15  # gap between clouds side by side, in sides of a square as large as their average box
_WIDE = 1.5  # width over height of the layout side by side
_HEIGHT = "min(68vh, 46rem)"  # of the view on the page
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
    traces: list[dict[str, Any]] = []
    for cloud in clouds:
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
        points = coordinates(cloud.points + getattr(cloud, place))
        look = {"mode": "markers", "name": chart_text(cloud.name), "marker": marker, **hover}
        traces.append({"type": "scatter3d", **points, **look})
    return traces


def coordinates(points: FloatArray) -> dict[str, Any]:
    """Return points as a trace of plotly takes them."""
    return dict(zip("xyz", points.astype(np.float32).T, strict=True))


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
    """A page of clouds; texts except `title`, `label` and `kind` are HTML."""

    kind: str  # of page: name of its script and help
    title: str
    label: str  # of the chart, for readers of the screen
    lead: str
    clouds: Sequence[Cloud]
    data: dict[str, Any]  # for the page's own script
    side: str
    facts: Sequence[tuple[str, str]]
    below: str = ""
    start: str = "joined"
    is_named: bool = False  # whether clouds show their names when pointed at
    traces: Sequence[dict[str, Any]] = ()
    controls: str = ""

    def page(self) -> str:
        """Return the page: clouds and controls, side and bottom panels, facts and help."""
        layout = {"scene": scene_layout(), "margin": {"l": 0, "r": 0, "t": 0, "b": 0}, "showlegend": False}
        traces = [*cloud_traces(self.clouds, self.start, is_named=self.is_named), *self.traces]
        half = np.array([cloud.size for cloud in self.clouds]) / 2
        data: dict[str, Any] = {"start": self.start, "boxes": {}, "sizes": (2 * half).tolist(), **self.data}
        for name in ("joined", "apart"):
            places = np.array([getattr(cloud, name) for cloud in self.clouds])
            data[name] = places.tolist()
            data["boxes"][name] = [(places - half).min(axis=0).tolist(), (places + half).max(axis=0).tolist()]
        body = fill(
            "stage.html",
            title=html.escape(self.title),
            lead=self.lead,
            chart=chart_html("scene", {"data": traces, "layout": layout}, label=self.label, height=_HEIGHT),
            share=100 if self.start == "joined" else 0,
            controls=self.controls,
            side=self.side,
            below=self.below,
            facts=facts_html(self.facts),
            help=part(f"{self.kind}_help.html"),
            data=data_html("stage-data", data),
        )
        script = part("stage.js") + part(f"{self.kind}.js")
        return page_html(self.title, body, css=part("viewer.css"), script=script)
