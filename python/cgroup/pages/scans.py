"""The page of a scene: many scans to turn around, the graph of their edges, and a table of these."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, to_hex

from cgroup._checks.values import as_instance
from cgroup.pages.page import chart_html, chart_text, data_html, page_html
from cgroup.pages.page import part as part_of
from cgroup.pages.scene import LEVELS, MAX_POINTS, lit
from cgroup.plots import style
from cgroup.plots.agreement import planes, thin
from cgroup.plots.scans import LEAST_RANGE, MOST_NAMED, look_at, place_nodes
from cgroup.plots.shading import AMBIENT
from cgroup.scenes import Scene
from cgroup.scenes.scene import cloud_of
from cgroup.scenes.scene_files import scan_colors

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from cgroup.scenes import Edge
    from cgroup.types import FloatArray

_POINTS = 150_000
"""Points of all scans together that are drawn."""

_SIZES = ((60_000, 1.6), (4_000, 2.2), (0, 3.5))
"""Pixels of a point, by how many more than that are drawn."""

_GAP = 0.15
"""Between what lies side by side, in sides of a square as large as the average of them."""

_WIDE = 1.5
"""Sides of what is laid out: width over height."""

_GRAPH = 300.0
"""Sides of a graph, in pixels."""

_RESIDUALS = LinearSegmentedColormap.from_list("residuals", style.DISTANCE_COLORS)


class _Placed(NamedTuple):
    """A scan as it is drawn: right, up and towards the viewer, from the middle of its box."""

    row: int
    points: FloatArray
    light: NDArray[np.uint8]
    size: FloatArray  # (3,) of its box
    joined: FloatArray  # (3,) places of the middle
    apart: FloatArray


def scene_page(scene: Scene, *, title: str = "Scene") -> str:
    """Make the page of a scene: scans to turn around, the graph, a table of edges.

    Parameters
    ----------
    scene : Scene
        What `cgroup.scenes.register_all` returned. Scans given as paths are read again; at most 150,000
        points of all are drawn.
    title : str
        Plain text.

    Returns
    -------
    str
        HTML, for `write_page`.

    Raises
    ------
    InputError
        If plotly isn't installed, a file can't be read again, or an argument doesn't fit.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.pages import scene_page
    >>> from cgroup.scenes import register_all
    >>> pair = standin_pair(pixels=60)
    >>> page = scene_page(register_all([pair.source, pair.target]))
    >>> page.startswith("<!doctype html>")
    True
    """
    as_instance("scene", scene, Scene)
    as_instance("title", title, str)
    clouds = _posed(scene)
    colors = [to_hex(color / 255) for color in scan_colors(len(scene.scans))]
    first = [clouds[row] for row in scene.components[0]]
    axes = look_at(first).axes
    placed = _place(scene, clouds, axes)
    rows = [each.row for each in placed]
    data = {
        "rows": rows,
        "joined": [each.joined.tolist() for each in placed],
        "apart": [each.apart.tolist() for each in placed],
        "boxes": {name: _box(placed, name) for name in ("joined", "apart")},
        "edges": [[edge.source, edge.target] for edge in scene.edges],
    }
    body = (
        f"<main><h1>{html.escape(title)}</h1>{_lead(scene)}"
        f'<div class="viewer"><div class="stage">{_chart(placed, scene, colors)}{_CONTROLS}</div>'
        f'<aside class="side">{_legend(scene, colors)}{_graphs(scene, clouds, axes, colors)}</aside></div>'
        f"{_table(scene)}{_facts(scene)}{_HELP}</main>{data_html('scene-data', data)}"
    )
    css = part_of("viewer.css") + part_of("scans.css")
    return page_html(title, body, css=css, script=part_of("scans.js"))


def _posed(scene: Scene) -> dict[int, FloatArray]:
    """Return some points of each scan in the frame of its component."""
    rows = [row for component in scene.components for row in component]
    most = min(MAX_POINTS, _POINTS // len(rows))
    posed: dict[int, FloatArray] = {}
    for row in rows:
        cloud = cloud_of(scene, row)
        few = cloud.points[thin(cloud.points, most)]
        posed[row] = few @ scene.poses[row, :3, :3].T + scene.poses[row, :3, 3]
    return posed


def _place(scene: Scene, clouds: dict[int, FloatArray], axes: FloatArray) -> list[_Placed]:
    """Lay components side by side, and scans."""
    seen = {row: points @ axes.T for row, points in clouds.items()}
    bounds = {row: _bounds(points) for row, points in seen.items()}
    middles = {row: (low + high) / 2 for row, (low, high) in bounds.items()}
    sizes = {row: high - low for row, (low, high) in bounds.items()}
    boxes = [
        (np.min([bounds[row][0] for row in rows], axis=0), np.max([bounds[row][1] for row in rows], axis=0))
        for rows in scene.components
    ]
    together = _lay_out([high - low for low, high in boxes])
    alone = dict(zip(sizes, _lay_out(list(sizes.values())), strict=True))
    placed: list[_Placed] = []
    for rows, (low, high), center in zip(scene.components, boxes, together, strict=True):
        for row in rows:
            light = lit(planes(clouds[row]), axes)
            joined = middles[row] - (low + high) / 2 + center
            placed.append(_Placed(row, seen[row] - middles[row], light, sizes[row], joined, alone[row]))
    return placed


def _bounds(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the box about a scan, without the one point in 500 that lies far out on either side."""
    low, high = np.quantile(points, (0.002, 0.998), axis=0)
    room = 0.05 * (high - low).max()
    return np.maximum(low - room, points.min(axis=0)), np.minimum(high + room, points.max(axis=0))


def _lay_out(sizes: Sequence[FloatArray]) -> list[FloatArray]:
    """Return middles of boxes that lie in lines below each other, none of which hides another."""
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


def _box(placed: Sequence[_Placed], name: str) -> list[list[float]]:
    places = np.array([getattr(each, name) for each in placed])
    half = np.array([each.size for each in placed]) / 2
    return [(places - half).min(axis=0).tolist(), (places + half).max(axis=0).tolist()]


def _chart(placed: Sequence[_Placed], scene: Scene, colors: Sequence[str]) -> str:
    hidden = {"visible": False, "showspikes": False}
    count = sum(len(each.points) for each in placed)
    size = next(size for least, size in _SIZES if count > least)
    figure = {
        "data": [_trace(each, chart_text(scene.names[each.row]), colors[each.row], size) for each in placed],
        "layout": {
            "scene": {
                **dict.fromkeys(("xaxis", "yaxis", "zaxis"), hidden),
                "aspectmode": "manual",
                "dragmode": "orbit",
                "camera": {"eye": {"x": 0, "y": 0, "z": 1.6}, "up": {"x": 0, "y": 1, "z": 0}},
            },
            "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
            "showlegend": False,
        },
    }
    label = f"{len(placed)} scans in three dimensions, each in its colour"
    return chart_html("scene", figure, label=label, height="min(68vh, 46rem)")


def _trace(each: _Placed, name: str, color: str, size: float) -> dict[str, Any]:
    x, y, z = (each.points + each.joined).astype(np.float32).T
    dark = [round(AMBIENT * int(color[k : k + 2], 16)) for k in (1, 3, 5)]
    marker = {
        "size": size,
        "color": each.light,
        "cmin": 0,
        "cmax": LEVELS,
        "colorscale": [[0, f"rgb({', '.join(map(str, dark))})"], [1, color]],
        "showscale": False,
        "line": {"width": 0},
    }
    drawn = {"type": "scatter3d", "mode": "markers", "name": name, "x": x, "y": y, "z": z}
    return {**drawn, "hovertemplate": "%{fullData.name}<extra></extra>", "marker": marker}


_CONTROLS = """
<div class="bar" role="group" aria-label="Place of the scans">
<button type="button" id="play" disabled>Take apart</button>
<label style="flex: 1 1 14rem">apart <input type="range" id="place" min="0" max="100" value="100" disabled
 aria-label="from apart to joined"> joined</label>
<button type="button" id="reset" disabled>Reset the view</button>
</div>
"""


def _lead(scene: Scene) -> str:
    several = [rows for rows in scene.components if len(rows) > 1]
    placed = sum(map(len, several))
    kept = sum(edge.kept for edge in scene.edges)
    named = "component" if len(several) == 1 else "components"
    sentence = f"{placed} of {len(scene.scans)} scans hang together, in {len(several)} {named}."
    edges = f"Of {len(scene.edges)} edges, {kept} were kept."
    return f'<p class="lead quiet">{sentence} {edges}</p>'


def _legend(scene: Scene, colors: Sequence[str]) -> str:
    parts = ""
    for k, rows in enumerate(scene.components):
        if len(rows) > 1 or k == 0 or len(scene.components[k - 1]) > 1:
            heading = f"Component {k + 1}" if len(rows) > 1 else "Alone"
            parts += f"<h3>{heading}</h3>"
        parts += "".join(
            f'<label><input type="checkbox" data-row="{row}" checked disabled>'
            f'<span class="swatch dot" style="--color: {colors[row]}"></span>{html.escape(scene.names[row])}'
            f'<span class="count">{_chance(scene.probability[row])}</span></label>'
            for row in rows
        )
    return (
        f'<fieldset class="scans"><legend>Scans, and how sure their places are</legend>{parts}</fieldset>'
        '<button type="button" id="all" disabled>Show all</button>'
    )


def _chance(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.3f}"


def _scale(scene: Scene) -> float:
    return max([LEAST_RANGE, *(edge.residual for edge in scene.edges if edge.kept)])


def _color(edge: Edge, end: float) -> str:
    return to_hex(_RESIDUALS(min(edge.residual / end, 1.0))) if np.isfinite(edge.residual) else "#8a8f98"


def _graphs(scene: Scene, clouds: dict[int, FloatArray], axes: FloatArray, colors: Sequence[str]) -> str:
    several = [rows for rows in scene.components if len(rows) > 1]
    if not several:
        return ""
    end = _scale(scene)
    drawn = "".join(_graph(scene, rows, [clouds[row] for row in rows], axes, colors, end) for rows in several)
    ramp = f"linear-gradient(90deg, {', '.join(style.DISTANCE_COLORS)})"
    return (
        f'<section class="graphs"><h2>Edges</h2>{drawn}'
        f'<div class="scale"><div style="background: {ramp}"></div>'
        f"<span>0</span><span>{end / 2:.2g}</span><span>≥ {end:.2g}</span></div>"
        '<p class="quiet">Residual of each edge in standard deviations; dashed: dropped.</p></section>'
    )


def _graph(
    scene: Scene,
    rows: Sequence[int],
    clouds: Sequence[FloatArray],
    axes: FloatArray,
    colors: Sequence[str],
    end: float,
) -> str:
    """Draw the graph of a component as SVG."""
    places = place_nodes(clouds, axes) * [1.0, -1.0]
    low, size = places.min(axis=0), np.ptp(places, axis=0)
    scale = (_GRAPH - 40) / max(float(size.max()), 1e-300)
    spots = {row: (20 + scale * (place - low)).round(1) for row, place in zip(rows, places, strict=True)}
    wide, high = (40 + scale * size).round(1)
    lines = ""
    ordered = sorted(enumerate(scene.edges), key=lambda one: one[1].kept)  # those kept on top
    for number, edge in ordered:
        if edge.source in spots and edge.target in spots:
            (x1, y1), (x2, y2) = spots[edge.source], spots[edge.target]
            dashes = "" if edge.kept else ' stroke-dasharray="5 4"'
            said = html.escape(_say_edge(scene, edge))
            lines += (
                f'<line data-edge="{number}" x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" '
                f'stroke="{_color(edge, end)}"{dashes}><title>{said}</title></line>'
            )
    radius = 7 if len(rows) <= MOST_NAMED else 4
    dots = "".join(
        f'<circle cx="{x}" cy="{y}" r="{radius}" fill="{colors[row]}">'
        f"<title>{html.escape(scene.names[row])}</title></circle>"
        for row, (x, y) in spots.items()
    )
    label = f"Graph of {len(rows)} scans and the edges between them"
    return f'<svg viewBox="0 0 {wide} {high}" role="img" aria-label="{label}">{lines}{dots}</svg>'


def _say_edge(scene: Scene, edge: Edge) -> str:
    pair = f"{scene.names[edge.source]} on {scene.names[edge.target]}"
    residual = f", residual {edge.residual:.2f}" if np.isfinite(edge.residual) else ""
    return f"{pair}{residual}: {'kept' if edge.kept else f'dropped, {edge.reason}'}"


def _table(scene: Scene) -> str:
    if not scene.edges:
        return ""
    end = _scale(scene)
    ordered = sorted(  # dropped ones first, then by residual
        enumerate(scene.edges), key=lambda one: (one[1].kept, -np.nan_to_num(one[1].residual))
    )
    lines = "".join(_line(scene, number, edge, end) for number, edge in ordered)
    names = ("source", "target", "probability", "overlap", "residual", "")
    head = "".join(f'<th scope="col">{name}</th>' for name in names)
    return (
        '<section class="edges"><h2>Residual per edge</h2><div class="scroll"><table class="methods">'
        f"<thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table></div></section>"
    )


def _line(scene: Scene, number: int, edge: Edge, end: float) -> str:
    residual = f"{edge.residual:.2f}" if np.isfinite(edge.residual) else ""
    dashed = "" if edge.kept else " dashed"
    swatch = f'<span class="swatch{dashed}" style="--color: {_color(edge, end)}"></span>'
    names = (html.escape(scene.names[row]) for row in (edge.source, edge.target))
    cells = "".join(f"<td>{name}</td>" for name in names)
    state = "kept" if edge.kept else f"dropped: {html.escape(edge.reason)}"
    return (
        f'<tr data-edge="{number}" tabindex="0">{cells}<td>{edge.probability:.3f}</td>'
        f"<td>{100 * edge.fitness:.0f} %, {100 * edge.target_fitness:.0f} %</td>"
        f'<td><span class="residual">{swatch}{residual}</span></td><td>{state}</td></tr>'
    )


def _facts(scene: Scene) -> str:
    facts = [
        ("pairs tried", f"{scene.tried:,}"),
        ("voxel", f"{scene.voxel:.4g}"),
        ("time", f"{sum(scene.seconds.values()):.2f} s"),
        *(("note", html.escape(note)) for note in scene.notes),
    ]
    lines = "".join(f"<dt>{name}</dt><dd>{value}</dd>" for name, value in facts)
    return f'<dl class="facts">{lines}</dl>'


_HELP = """
<details><summary>What to press</summary>
<ul>
<li>Drag to turn, scroll or pinch to zoom, drag with the right button (or two fingers) to shift.</li>
<li>The slider moves the scans from side by side to where their poses lay them; components stay apart.</li>
<li>Click an edge of the graph or a line of the table to see its two scans alone.</li>
<li>The file holds everything that it shows, and fetches nothing: it can be sent as it is.</li>
</ul>
</details>
"""
