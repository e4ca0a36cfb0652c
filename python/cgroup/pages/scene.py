"""Two clouds and lines between them in 3D, drawn by plotly."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cgroup._explain import explain_matches
from cgroup.pages.page import chart_text, load_plotly
from cgroup.plots import style
from cgroup.plots.agreement import planes, thin
from cgroup.plots.scene import spread
from cgroup.plots.shading import AMBIENT, LIGHT, face_broadside
from cgroup.rigid import apply

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cgroup._show.drawing import Drawing
    from cgroup.types import BoolArray, FloatArray, IndexArray

MAX_POINTS = 20_000
"""Points of a cloud that are drawn: a random part where there are more."""

MAX_LINES = 300
"""Lines of one kind in a figure."""

_GAP = 0.25  # between the two clouds, in widths of the wider one
LEVELS = 255
_TO_LIGHT = LIGHT / np.linalg.norm(LIGHT)
_STOPS = np.array([0.0, 0.25, 0.5, 0.75, 1.0])  # of a line: where the mouse finds it
_DISTANCE = 1.05  # of the camera, in sizes of the scene
_LINE = 60  # letters of a line of a hover text


@dataclass(frozen=True, eq=False)
class SceneCloud:
    """A part of a cloud about its own centre, and how much light each point gets."""

    rows: IndexArray  # (k,) of the cloud
    points: FloatArray  # (k,3)
    planes: FloatArray  # (k,3) normals once the pose is applied
    light: NDArray[np.uint8]  # (k,)
    center: FloatArray  # (3,) in the data


@dataclass(frozen=True, eq=False)
class Scene:
    """Two clouds, about the target's centre, and where the source may stand.

    Attributes
    ----------
    given, apart, placed : (4,4) array of float64
        Poses of the centred source in the scene: as in the data, beside the target and turned as in the
        pose, and where the pose lays it.
    right, up, towards : (3,) array of float64
        The directions of the viewer who sees most of the target.
    """

    source: SceneCloud
    target: SceneCloud
    given: FloatArray
    apart: FloatArray
    placed: FloatArray
    right: FloatArray
    up: FloatArray
    towards: FloatArray


def scene_of(source: FloatArray, target: FloatArray, pose: FloatArray) -> Scene:
    """Thin and shade two whole clouds, and find where the source may stand."""
    rows = thin(source, MAX_POINTS), thin(target, MAX_POINTS)
    source, target = source[rows[0]], target[rows[1]]
    centers = source.mean(axis=0), target.mean(axis=0)
    axes = face_broadside(target).axes
    placed = _shifted(-centers[1]) @ pose @ _shifted(centers[0])
    posed = apply(pose, source)
    there, here = ((points @ axes.T)[:, 0] for points in (posed, target))
    gap = _GAP * max(np.ptp(there), np.ptp(here))
    aside = (here.min() - there.max() - gap) * axes[0]
    faces = planes(posed), planes(target)
    return Scene(
        SceneCloud(rows[0], source - centers[0], faces[0], lit(faces[0], axes), centers[0]),
        SceneCloud(rows[1], target - centers[1], faces[1], lit(faces[1], axes), centers[1]),
        given=_shifted(centers[0] - centers[1]),
        apart=_shifted(aside) @ placed,
        placed=placed,
        right=axes[0],
        up=axes[1],
        towards=axes[2],
    )


def _shifted(by: FloatArray) -> FloatArray:
    shift = np.eye(4)
    shift[:3, 3] = by
    return shift


def lit(planes: FloatArray, axes: FloatArray) -> NDArray[np.uint8]:
    """(k,) how much light falls on the plane about each point, whichever side faces the viewer."""
    facing = np.where(planes.any(axis=1, keepdims=True), planes @ axes.T, _TO_LIGHT)
    facing *= np.where(facing[:, 2:] < 0.0, -1.0, 1.0)
    return np.round(LEVELS * np.clip(facing @ _TO_LIGHT, 0.0, 1.0)).astype(np.uint8)


def cloud_traces(scene: Scene) -> list[dict[str, Any]]:
    """Return plotly's traces of the two clouds, side by side."""
    return [
        _cloud_trace(scene.source, scene.apart, "source", style.SOURCE_TINT),
        _cloud_trace(scene.target, np.eye(4), "target", style.TARGET_TINT),
    ]


def _cloud_trace(
    cloud: SceneCloud, pose: FloatArray, name: str, tint: tuple[float, float, float]
) -> dict[str, Any]:
    x, y, z = apply(pose, cloud.points).astype(np.float32).T
    marker = {
        "size": 2.2 if len(cloud.points) > 2_000 else 3.5,
        "color": cloud.light,
        "cmin": 0,
        "cmax": LEVELS,
        "colorscale": [[end, _css(part * np.array(tint))] for end, part in ((0, AMBIENT), (1, 1.0))],
        "showscale": False,
        "line": {"width": 0},
    }
    drawn = {"type": "scatter3d", "mode": "markers", "name": name, "x": x, "y": y, "z": z}
    return {**drawn, "hoverinfo": "skip", "marker": marker}


def _css(color: FloatArray) -> str:
    return f"rgb({', '.join(str(round(255 * part)) for part in color)})"


def line_vertices(start: FloatArray, end: FloatArray) -> FloatArray:
    """(6n,3) vertices of lines, with a gap after each."""
    between = start[:, None] + _STOPS[:, None] * (end - start)[:, None]
    gaps = np.full((len(start), 1, 3), np.nan)
    return np.concatenate([between, gaps], axis=1).reshape(-1, 3)


def scene_layout(scene: Scene) -> dict[str, Any]:
    """Return plotly's layout of a scene without axes, as the viewer has it who sees most of the target."""
    hidden = {"visible": False, "showspikes": False}
    eye, up = (dict(zip("xyz", way, strict=True)) for way in (_DISTANCE * scene.towards, scene.up))
    axes = {"xaxis": hidden, "yaxis": hidden, "zaxis": hidden}
    return {**axes, "aspectmode": "data", "camera": {"eye": eye, "up": up}}


def figure_of(drawing: Drawing) -> Any:  # noqa: ANN401 - plotly has no types
    """Draw what a result is made of, side by side, to be turned around."""
    make = load_plotly("graph_objects").Figure
    scene = scene_of(drawing.source, drawing.target, drawing.pose)
    kinds = kinds_of(drawing.mask, drawing.correct)
    lines = [_line_trace(drawing, scene, kind) for kind in kinds if kind.rows.any()]
    traces = [*cloud_traces(scene), *lines]
    layout = {
        "scene": scene_layout(scene),
        "title": {"text": chart_text(drawing.title)},
        "legend": {"orientation": "h", "itemsizing": "constant"},
        "margin": {"l": 0, "r": 0, "t": 40, "b": 0},
        "template": "none",
    }
    return make(data=traces, layout=layout)


class Kind(NamedTuple):
    """A kind of matches: what it is called in pages and shown as, which it has, and its colour."""

    name: str
    text: str
    rows: BoolArray
    color: str


def kinds_of(mask: BoolArray, correct: BoolArray | None) -> list[Kind]:
    """Tell matches apart by whether they were kept and, where that is known, whether they are correct."""
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


def _line_trace(drawing: Drawing, scene: Scene, kind: Kind) -> dict[str, Any]:
    rows = np.flatnonzero(kind.rows)
    drawn = spread(rows, MAX_LINES)
    start = apply(scene.apart, drawing.matches.source[drawn] - scene.source.center)
    x, y, z = line_vertices(start, drawing.matches.target[drawn] - scene.target.center).astype(np.float32).T
    texts = [_hover_text(drawing, int(row)) for row in drawn]
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


def _hover_text(drawing: Drawing, row: int) -> str:
    if drawing.grouping is None:
        return f"match {row}"
    reason = chart_text(explain_matches(drawing.grouping, [row])[0].reason)
    lines = textwrap.wrap(reason, _LINE, break_long_words=False, break_on_hyphens=False)
    return f"match {row}: {'<br>'.join(lines)}"
