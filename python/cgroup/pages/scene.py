"""Two clouds and lines between them in 3D, drawn by plotly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup._explain import explain_matches
from cgroup.errors import InputError
from cgroup.features import normals
from cgroup.pages.page import NEEDS_PLOTLY, chart_text
from cgroup.plots import style
from cgroup.plots.scene import spread
from cgroup.plots.shading import face_broadside
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
_NEIGHBORS = 16
_LIGHT = np.array([-0.45, 0.55, 0.70])  # as in the figures: upper left, in front
_AMBIENT = 0.35
_LEVELS = 255
_STOPS = np.array([0.0, 0.25, 0.5, 0.75, 1.0])  # of a line: where the mouse finds it
_DISTANCE = 1.05  # of the camera, in sizes of the scene
_LINE = 60  # letters of a line of a hover text


@dataclass(frozen=True, eq=False)
class SceneCloud:
    """A part of a cloud about its own centre, and how much light each point gets."""

    points: FloatArray  # (k,3)
    light: NDArray[np.uint8]  # (k,)
    center: FloatArray  # (3,) in the data


@dataclass(frozen=True, eq=False)
class Scene:
    """Two clouds, about the target's centre, and where the source may stand.

    Attributes
    ----------
    source, target : SceneCloud
        Each about its own centre.
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
    """Thin and shade two clouds, and find where the source may stand.

    Parameters
    ----------
    source, target : (N,3) array of float64
        Whole clouds.
    pose : (4,4) array of float64
        Lays the source on the target.
    """
    source, target = _thinned(source), _thinned(target)
    centers = source.mean(axis=0), target.mean(axis=0)
    axes = face_broadside(target).axes
    placed = _shifted(-centers[1]) @ pose @ _shifted(centers[0])
    there, here = ((points @ axes.T)[:, 0] for points in (apply(pose, source), target))
    gap = _GAP * max(np.ptp(there), np.ptp(here))
    aside = (here.min() - there.max() - gap) * axes[0]
    return Scene(
        SceneCloud(source - centers[0], _light(apply(pose, source), axes), centers[0]),
        SceneCloud(target - centers[1], _light(target, axes), centers[1]),
        given=_shifted(centers[0] - centers[1]),
        apart=_shifted(aside) @ placed,
        placed=placed,
        right=axes[0],
        up=axes[1],
        towards=axes[2],
    )


def _thinned(points: FloatArray) -> FloatArray:
    if len(points) <= MAX_POINTS:
        return points
    rows = np.random.default_rng(0).choice(len(points), MAX_POINTS, replace=False)
    return points[np.sort(rows)]


def _shifted(by: FloatArray) -> FloatArray:
    shift = np.eye(4)
    shift[:3, 3] = by
    return shift


def _light(points: FloatArray, axes: FloatArray) -> NDArray[np.uint8]:
    """(k,) how much light falls on the plane about each point, whichever side faces the viewer."""
    if len(points) < _NEIGHBORS:
        return np.full(len(points), _LEVELS, dtype=np.uint8)
    facing = np.nan_to_num(normals(points, neighbors=_NEIGHBORS)) @ axes.T
    facing *= np.where(facing[:, 2:] < 0.0, -1.0, 1.0)
    lit = np.clip(facing @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.0, 1.0)
    return np.round(_LEVELS * lit).astype(np.uint8)


def cloud_trace(cloud: SceneCloud, pose: FloatArray, name: str, tint: tuple[float, float, float]) -> Any:  # noqa: ANN401
    """Return plotly's trace of a cloud."""
    x, y, z = apply(pose, cloud.points).astype(np.float32).T
    dark = tuple(_AMBIENT * part for part in tint)
    return {
        "type": "scatter3d",
        "mode": "markers",
        "name": name,
        "x": x,
        "y": y,
        "z": z,
        "hoverinfo": "skip",
        "marker": {
            "size": 2.2 if len(cloud.points) > 2_000 else 3.5,
            "color": cloud.light,
            "cmin": 0,
            "cmax": _LEVELS,
            "colorscale": [[0, _css(dark)], [1, _css(tint)]],
            "showscale": False,
            "line": {"width": 0},
        },
    }


def _css(color: tuple[float, ...]) -> str:
    return f"rgb({', '.join(str(round(255 * part)) for part in color)})"


def line_vertices(start: FloatArray, end: FloatArray) -> FloatArray:
    """(6n,3) vertices of lines, with a gap after each."""
    between = start[:, None] + _STOPS[:, None] * (end - start)[:, None]
    gaps = np.full((len(start), 1, 3), np.nan)
    return np.concatenate([between, gaps], axis=1).reshape(-1, 3)


def camera_of(scene: Scene) -> dict[str, Any]:
    """Return plotly's camera of the viewer who sees most of the target."""
    eye = _DISTANCE * scene.towards
    return {"eye": dict(zip("xyz", eye, strict=True)), "up": dict(zip("xyz", scene.up, strict=True))}


def bare_axes() -> dict[str, Any]:
    """Return plotly's axes of a scene, none of which is to be seen."""
    hidden = {"visible": False, "showspikes": False}
    return {"xaxis": hidden, "yaxis": hidden, "zaxis": hidden}


def figure_of(drawing: Drawing) -> Any:  # noqa: ANN401 - plotly has no types
    """Draw what a result is made of, side by side, to be turned around."""
    try:
        from plotly.graph_objects import Figure  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        raise InputError(NEEDS_PLOTLY) from error
    scene = scene_of(drawing.source, drawing.target, drawing.pose)
    traces = [
        cloud_trace(scene.source, scene.apart, "source", style.SOURCE_TINT),
        cloud_trace(scene.target, np.eye(4), "target", style.TARGET_TINT),
        *_line_traces(drawing, scene),
    ]
    layout = {
        "scene": {**bare_axes(), "aspectmode": "data", "camera": camera_of(scene)},
        "title": {"text": chart_text(drawing.title)},
        "legend": {"orientation": "h", "itemsizing": "constant"},
        "margin": {"l": 0, "r": 0, "t": 40, "b": 0},
        "template": "none",
    }
    return Figure(data=traces, layout=layout)


def _line_traces(drawing: Drawing, scene: Scene) -> list[dict[str, Any]]:
    mask, correct = drawing.mask, drawing.correct
    kinds: list[tuple[str, BoolArray, str, bool]] = []
    if correct is None:
        kinds.append(("selected", mask, style.GROUPED, True))
    else:
        kinds += [
            ("selected, correct", mask & correct, style.CORRECT, True),
            ("selected, wrong", mask & ~correct, style.WRONG, True),
            ("dropped, correct", ~mask & correct, style.MISSED, False),
        ]
    dropped = ~mask if correct is None else ~mask & ~correct
    kinds.append(("dropped", dropped, style.QUIET_TEXT, False))
    return [
        _line_trace(drawing, scene, name, np.flatnonzero(rows), color, shown=shown)
        for name, rows, color, shown in kinds
        if rows.any()
    ]


def _line_trace(
    drawing: Drawing, scene: Scene, name: str, rows: IndexArray, color: str, *, shown: bool
) -> dict[str, Any]:
    drawn = spread(rows, MAX_LINES)
    start = apply(scene.apart, drawing.matches.source[drawn] - scene.source.center)
    x, y, z = line_vertices(start, drawing.matches.target[drawn] - scene.target.center).astype(np.float32).T
    texts = [_hover_text(drawing, int(row)) for row in drawn]
    count = str(len(rows)) if len(drawn) == len(rows) else f"{len(drawn)} of {len(rows)} shown"
    return {
        "type": "scatter3d",
        "mode": "lines",
        "name": f"{name} ({count})",
        "x": x,
        "y": y,
        "z": z,
        "line": {"color": color, "width": 3},
        "hoverinfo": "text",
        "hovertext": [text for text in texts for _ in range(len(_STOPS) + 1)],
        "visible": True if shown else "legendonly",
    }


def _hover_text(drawing: Drawing, row: int) -> str:
    if drawing.grouping is None:
        return f"match {row}"
    reason = explain_matches(drawing.grouping, [row])[0].reason
    return f"match {row}: {_broken(chart_text(reason))}"


def _broken(text: str) -> str:
    """Break a text into lines of HTML."""
    lines, words = [""], text.split(" ")
    for word in words:
        if len(lines[-1]) + len(word) > _LINE:
            lines.append("")
        lines[-1] += word + " "
    return "<br>".join(line.rstrip() for line in lines)
