"""The page of a scene: its scans in a 3D view, the graph of their edges, and a table of the edges."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, to_hex

from cgroup._checks.values import as_instance
from cgroup._show.words import counted
from cgroup.pages.matches import MAX_POINTS
from cgroup.pages.page import scale_html, table_html
from cgroup.pages.stage import Stage, place_clouds
from cgroup.plots import style
from cgroup.plots.scans import LEAST_RANGE, MOST_NAMED, look_at, place_nodes
from cgroup.plots.shading import choose_rows
from cgroup.rigid.se3 import deviations_at
from cgroup.scenes import Edge, Scene
from cgroup.scenes.scene import cloud_of, scan_colors
from cgroup.types import FloatArray

_POINTS = 150_000  # points of all scans that are drawn
_GRAPH = 300.0  # sides of a graph, in pixels
_RESIDUALS = LinearSegmentedColormap.from_list("residuals", style.DISTANCE_COLORS)


def scene_page(scene: Scene, *, title: str | None = None) -> str:
    """Return the page of a scene: scans in a 3D view, the graph, a table of edges.

    Parameters
    ----------
    scene : Scene
        Result of `cgroup.scenes.register_all`. Scans given as paths are read again; at most 150,000 points
        of all scans are drawn.
    title : str, optional
        Plain text; the names of the scans by default.

    Returns
    -------
    str
        HTML, for `write_page`.

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
    if title is None:
        more = f" and {len(scene.names) - 3} more scans" if len(scene.names) > 3 else ""
        title = ", ".join(scene.names[:3]) + more
    as_instance("title", title, str)
    clouds = _posed(scene)
    colors = [to_hex(color / 255) for color in scan_colors(len(scene.scans))]
    axes = look_at([clouds[row] for row in scene.components[0]]).axes
    placed = place_clouds(clouds, axes, scene.names, colors, scene.components)
    return Stage(
        kind="scans",
        title=title,
        label=f"{len(placed)} scans in three dimensions, each in its colour",
        lead=_lead(scene),
        clouds=placed,
        data={"rows": [*clouds], "edges": [[edge.source, edge.target] for edge in scene.edges]},
        side=f"{_legend(scene, colors)}{_graphs(scene, clouds, axes, colors)}",
        below=_table(scene),
        facts=_facts(scene, clouds),
        is_named=True,
    ).page()


def _posed(scene: Scene) -> dict[int, FloatArray]:
    rows = [row for component in scene.components for row in component]
    most = min(MAX_POINTS, _POINTS // len(rows))
    posed: dict[int, FloatArray] = {}
    for row in rows:
        cloud = cloud_of(scene, row)
        few = cloud.points[choose_rows(cloud.points, most)]
        posed[row] = few @ scene.poses[row, :3, :3].T + scene.poses[row, :3, 3]
    return posed


def _lead(scene: Scene) -> str:
    several = [rows for rows in scene.components if len(rows) > 1]
    placed = sum(map(len, several))
    kept = sum(edge.kept for edge in scene.edges)
    sentence = f"{placed} of {len(scene.scans)} scans connected, {counted(len(several), 'component')}."
    edges = f"{kept} of {len(scene.edges)} edges kept."
    return f'<p class="lead quiet">{sentence} {edges}</p>'


def _legend(scene: Scene, colors: Sequence[str]) -> str:
    parts, chances = "", ["" if np.isnan(chance) else f"{chance:.3f}" for chance in scene.probability]
    for k, rows in enumerate(scene.components):
        if len(rows) > 1 or k == 0 or len(scene.components[k - 1]) > 1:
            heading = f"Component {k + 1}" if len(rows) > 1 else "Alone"
            parts += f"<h3>{heading}</h3>"
        parts += "".join(
            f'<label><input type="checkbox" data-row="{row}" checked disabled>'
            f'<span class="swatch dot" style="--color: {colors[row]}"></span>{html.escape(scene.names[row])}'
            f'<span class="count">{chances[row] if len(rows) > 1 else ""}</span></label>'
            for row in rows
        )
    return (
        f'<fieldset class="scans"><legend>Scans, and probability of their poses</legend>{parts}</fieldset>'
        '<button type="button" id="all" disabled>Show all</button>'
    )


def _scale(scene: Scene) -> float:
    return max([LEAST_RANGE, *(edge.residual for edge in scene.edges if edge.kept)])


def _color(edge: Edge, end: float) -> str:
    return to_hex(_RESIDUALS(min(edge.residual / end, 1.0))) if np.isfinite(edge.residual) else "#8a8f98"


def _graphs(scene: Scene, clouds: dict[int, FloatArray], axes: FloatArray, colors: Sequence[str]) -> str:
    several = [rows for rows in scene.components if len(rows) > 1]
    if not several:
        return ""
    end = _scale(scene)
    drawn = ""
    for rows in several:
        places = place_nodes([clouds[row] for row in rows], axes) * [1.0, -1.0]
        drawn += _graph(scene, dict(zip(rows, places, strict=True)), colors, end)
    return (
        f'<section class="graphs"><h2>Edges</h2>{drawn}{scale_html(style.DISTANCE_COLORS, end)}'
        '<p class="quiet">Residual of each edge in standard deviations; dashed: dropped.</p></section>'
    )


def _graph(scene: Scene, places: dict[int, FloatArray], colors: Sequence[str], end: float) -> str:
    low, size = np.min([*places.values()], axis=0), np.ptp([*places.values()], axis=0)
    scale = (_GRAPH - 40) / max(float(size.max()), 1e-300)
    spots = {row: (20 + scale * (place - low)).round(1) for row, place in places.items()}
    wide, high = (40 + scale * size).round(1)
    lines = ""
    for number, edge in sorted(enumerate(scene.edges), key=lambda one: one[1].kept):  # those kept on top
        if edge.source in spots and edge.target in spots:
            (x1, y1), (x2, y2) = spots[edge.source], spots[edge.target]
            dashes = "" if edge.kept else ' stroke-dasharray="5 4"'
            pair = f"{scene.names[edge.source]} on {scene.names[edge.target]}"
            residual = f", residual {edge.residual:.2f}" if np.isfinite(edge.residual) else ""
            state = "kept" if edge.kept else f"dropped, {edge.reason}"
            title = html.escape(f"{pair}{residual}: {state}")
            lines += (
                f'<line data-edge="{number}" x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" '
                f'stroke="{_color(edge, end)}"{dashes}><title>{title}</title></line>'
            )
    radius = 7 if len(spots) <= MOST_NAMED else 4
    dots = "".join(
        f'<circle cx="{x}" cy="{y}" r="{radius}" fill="{colors[row]}">'
        f"<title>{html.escape(scene.names[row])}</title></circle>"
        for row, (x, y) in spots.items()
    )
    label = f"Graph of {len(spots)} scans and the edges between them"
    return f'<svg viewBox="0 0 {wide} {high}" role="img" aria-label="{label}">{lines}{dots}</svg>'


def _table(scene: Scene) -> str:
    if not scene.edges:
        return ""
    end = _scale(scene)
    ordered = sorted(  # dropped ones first, then by residual
        enumerate(scene.edges), key=lambda one: (one[1].kept, -np.nan_to_num(one[1].residual))
    )
    lines = "".join(_line(scene, number, edge, end) for number, edge in ordered)
    columns = ("source", "target", "probability", "overlap", "residual", "state")
    table = table_html(columns, lines, label="Edges")
    return f'<section class="edges"><h2>Residual per edge</h2>{table}</section>'


def _line(scene: Scene, number: int, edge: Edge, end: float) -> str:
    residual = f"{edge.residual:.2f}" if np.isfinite(edge.residual) else ""
    dashed = "" if edge.kept else " dashed"
    swatch = f'<span class="swatch{dashed}" style="--color: {_color(edge, end)}"></span>'
    cells = "".join(f"<td>{html.escape(scene.names[row])}</td>" for row in (edge.source, edge.target))
    state = "kept" if edge.kept else f"dropped: {html.escape(edge.reason)}"
    return (
        f'<tr data-edge="{number}" tabindex="0">{cells}<td>{edge.probability:.3f}</td>'
        f"<td>{100 * edge.fitness:.0f} %, {100 * edge.target_fitness:.0f} %</td>"
        f'<td><span class="residual">{swatch}{residual}</span></td><td>{state}</td></tr>'
    )


def _facts(scene: Scene, clouds: dict[int, FloatArray]) -> list[tuple[str, str]]:
    joined = [row for rows in scene.components for row in rows if len(rows) > 1]
    middles = [(scene.covariance[row], clouds[row].mean(axis=0)) for row in joined]
    degrees, length = np.max([deviations_at(*one) for one in middles] or [(0.0, 0.0)], axis=0)
    accuracy = f"up to {length:.2g} at a scan's middle, {degrees:.2g} degrees (standard deviations)"
    return [
        *([("accuracy", accuracy)] if joined else []),
        ("pairs tried", f"{scene.tried:,}"),
        ("voxel", f"{scene.voxel:.4g} (all lengths are in the unit of the files)"),
        ("time", f"{sum(scene.seconds.values()):.2f} s"),
        *(("note", html.escape(note)) for note in scene.notes),
    ]
