"""Many scans in one frame, and the graph of the edges between them."""

# Parts of matplotlib's methods are untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure

from cgroup.plots import style
from cgroup.plots.matches import caption, show
from cgroup.plots.shading import View, choose_rows, face_broadside, paint
from cgroup.types import FloatArray

MOST_NAMED = 24  # largest number of scans that are named in a figure
_MOST_POINTS = 300_000
_APART = 0.06  # least distance of nodes, in widths of the graph; if nearer, all nodes are placed on a circle
_HOLE = 0.75  # grey of cells that are filled from their neighbours
_RESIDUALS = LinearSegmentedColormap.from_list("residuals", style.DISTANCE_COLORS)
_Edge = tuple[int, int, float, bool]  # two scans, residual in standard deviations, whether it was kept
LEAST_RANGE = 3.0  # least end of the colour scale, in standard deviations


def scans_figure(
    clouds: Sequence[FloatArray], names: Sequence[str], colors: FloatArray, edges: Sequence[_Edge]
) -> Figure:
    """Draw posed scans in their colours, beside the graph."""
    figure = Figure(figsize=(11, 5.2), dpi=style.DOTS_PER_INCH, layout="constrained")
    left, right = figure.subplots(1, 2)
    view = look_at(clouds)
    points = sum(map(len, clouds))
    _draw_scans(left, clouds, colors, view)
    caption(left, "merged", f"{len(clouds)} scans, {points:,} points")
    kept = sum(edge[3] for edge in edges)
    shown = _draw_graph(right, place_nodes(clouds, view.axes), names, colors, edges)
    caption(right, "edges", f"{kept} kept, {len(edges) - kept} dropped")
    if edges:
        bar = figure.colorbar(shown, ax=right, shrink=0.6, pad=0.02)
        bar.set_label("residual, standard deviations", fontsize=9, color=style.QUIET_TEXT)
        bar.outline.set_visible(False)
    return figure


def look_at(clouds: Sequence[FloatArray]) -> View:
    """Return the view along the thinnest direction, for a map from above."""
    few = np.concatenate([cloud[choose_rows(cloud, _MOST_POINTS // len(clouds))] for cloud in clouds])
    above = few.mean(axis=0)
    above[2] += 1e3 * float(np.ptp(few, axis=0).max())
    return face_broadside(few, above)


def _draw_scans(axes: Axes, clouds: Sequence[FloatArray], colors: FloatArray, view: View) -> None:
    """Draw each cell in the colour of the scan that is nearest to the viewer there."""
    # Many scans cover each other: then that of the scan whose middle is nearest.
    few = [view.project(cloud[choose_rows(cloud, _MOST_POINTS // len(clouds))]) for cloud in clouds]
    every, scan = np.concatenate(few), np.repeat(np.arange(len(few)), [len(cloud) for cloud in few])
    picture = paint(every, np.zeros(len(every)), lambda mean: np.ones((*mean.shape, 3)))
    height, width = picture.rgba.shape[:2]
    left, right, bottom, top = picture.extent
    column = ((every[:, 0] - left) / (right - left) * width).astype(np.int64)
    row = ((every[:, 1] - bottom) / (top - bottom) * height).astype(np.int64)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    nearness = every[:, 2]
    if len(few) > MOST_NAMED:
        middles = np.array([np.median(cloud[:, :2], axis=0) for cloud in few])
        nearness = -np.linalg.norm(every[:, :2] - middles[scan], axis=1)
    order = np.flatnonzero(inside)[np.argsort(nearness[inside], kind="stable")]  # the nearest last
    tints = np.full((height, width, 3), _HOLE)
    tints[row[order], column[order]] = colors[scan[order]]
    picture.rgba[..., :3] *= tints
    show(axes, picture)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_axis_off()


def place_nodes(clouds: Sequence[FloatArray], axes: FloatArray) -> FloatArray:
    """Return positions of the scans in the plane: their centres, or a circle if these are too close."""
    places = np.array([cloud.mean(axis=0) for cloud in clouds]) @ axes[:2].T
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    apart[np.diag_indices(len(places))] = np.inf
    if len(places) > MOST_NAMED or apart.min() > _APART * np.ptp(places, axis=0).max():
        return places
    angles = np.pi / 2 - 2 * np.pi * np.arange(len(places)) / len(places)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _draw_graph(
    axes: Axes, places: FloatArray, names: Sequence[str], colors: FloatArray, edges: Sequence[_Edge]
) -> ScalarMappable:
    kept = [edge[2] for edge in edges if edge[3]]
    scale = ScalarMappable(Normalize(0.0, max([LEAST_RANGE, *kept])), _RESIDUALS)
    for wanted, dashes in ((False, (0, (3, 2))), (True, "-")):
        chosen = [edge for edge in edges if edge[3] == wanted]
        lines = [places[[source, target]] for source, target, *_ in chosen]
        values = scale.to_rgba(np.array([edge[2] for edge in chosen]))
        axes.add_collection(LineCollection(lines, colors=values, linewidths=1.6, linestyles=[dashes]))
    size = 60 if len(places) <= MOST_NAMED else 14
    axes.scatter(*places.T, s=size, color=colors, edgecolors="white", linewidths=0.8, zorder=3)
    if len(places) <= MOST_NAMED:
        middle = places.mean(axis=0)
        for place, name in zip(places, names, strict=True):
            side = place[0] >= middle[0]
            axes.annotate(
                style.as_it_is(name), place, (7 if side else -7, 0), textcoords="offset points",
                ha="left" if side else "right", va="center", fontsize=8, color=style.TEXT,
            )  # fmt: skip
    axes.margins(0.3, 0.12)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_axis_off()
    return scale
