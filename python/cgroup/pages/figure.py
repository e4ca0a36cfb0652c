"""Matches between two clouds in 3D: their kinds, and a plotly figure to rotate in a notebook."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.colors import to_hex

from cgroup._explain import explain_matches
from cgroup._show.drawing import Drawing
from cgroup.pages.page import chart_text, load_plotly
from cgroup.pages.stage import Cloud, cloud_traces, place_clouds, scene_layout
from cgroup.plots import style
from cgroup.plots.agreement import thin
from cgroup.plots.scene import spread
from cgroup.plots.shading import face_broadside
from cgroup.rigid import apply
from cgroup.types import BoolArray, Correspondences, FloatArray, IndexArray

MAX_POINTS = 20_000
"""Points of a cloud that are drawn: a random part where there are more."""

MAX_LINES = 300
"""Lines of one kind in a figure."""

_STOPS = np.array([0.0, 0.25, 0.5, 0.75, 1.0])  # of a line: where the mouse finds it
_LINE = 60  # letters of a line of a hover text


class Pair(NamedTuple):
    """Source and target as drawn, under a pose; their rows in the whole clouds, and the viewer's axes."""

    clouds: list[Cloud]
    rows: tuple[IndexArray, IndexArray]
    axes: FloatArray
    pose: FloatArray

    def ends_of(self, matches: Correspondences, rows: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Return the ends (k,3) of some matches, from the middle of their cloud."""
        source, target = apply(self.pose, matches.source[rows]), apply(np.eye(4), matches.target[rows])
        return (
            source @ self.axes.T - self.clouds[0].middle,
            target @ self.axes.T - self.clouds[1].middle,
        )


def draw_pair(source: FloatArray, target: FloatArray, pose: FloatArray) -> Pair:
    """Downsample two clouds and place them in the view that shows most of the target."""
    rows = thin(source, MAX_POINTS), thin(target, MAX_POINTS)
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
    """Divide matches into kept and dropped ones, and, if known, into correct and wrong ones."""
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
