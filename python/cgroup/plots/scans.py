"""Many scans in one frame, and the graph of the edges between them."""

# Parts of matplotlib's methods are untyped.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure

from cgroup.plots import style
from cgroup.plots.agreement import thin
from cgroup.plots.scene import caption, show
from cgroup.plots.shading import Picture, face_broadside, paint

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from cgroup.plots.shading import View
    from cgroup.types import FloatArray

MOST_NAMED = 24
"""Scans that are named in a figure; more names hide each other."""

_MOST_POINTS = 300_000
_APART = 0.08
"""Of the graph's width, between nodes and their nearest ones: nearer, they are put on a circle."""

_RESIDUALS = LinearSegmentedColormap.from_list("residuals", style.DISTANCE_COLORS)
LEAST_RANGE = 3.0
"""Standard deviations that the colours reach to at the least."""


def scans_figure(
    clouds: Sequence[FloatArray],
    names: Sequence[str],
    colors: FloatArray,
    edges: Sequence[tuple[int, int, float, bool]],
) -> Figure:
    """Draw posed scans in their colours, beside the graph.

    Edges are rows of two scans, a residual in standard deviations, and whether the edge was kept.
    """
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
    """Look along the thinnest direction; at a map from above."""
    few = np.concatenate([cloud[thin(cloud, _MOST_POINTS // len(clouds))] for cloud in clouds])
    above = few.mean(axis=0)
    above[2] += 1e3 * float(np.ptp(few, axis=0).max())
    return face_broadside(few, above)


def _draw_scans(axes: Axes, clouds: Sequence[FloatArray], colors: FloatArray, view: View) -> None:
    few = [view.project(cloud[thin(cloud, _MOST_POINTS // len(clouds))]) for cloud in clouds]
    every, sizes = np.concatenate(few), [len(cloud) for cloud in few]
    parts = [
        paint(every, np.repeat(colors[:, part], sizes), lambda mean: np.repeat(mean[..., None], 3, axis=-1))
        for part in range(3)
    ]
    channels = [picture.rgba[..., part] for part, picture in enumerate(parts)]
    picture = Picture(np.stack([*channels, parts[0].rgba[..., 3]], axis=-1), parts[0].extent)
    picture.rgba[np.isnan(picture.rgba)] = 0.0  # of cells without a point, which are transparent
    show(axes, picture)
    axes.set_axis_off()


def place_nodes(clouds: Sequence[FloatArray], axes: FloatArray) -> FloatArray:
    """Return places of the scans in the plane: those of their middles, or on a circle where these crowd."""
    places = np.array([cloud.mean(axis=0) for cloud in clouds]) @ axes[:2].T
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    apart[np.diag_indices(len(places))] = np.inf
    if len(places) > MOST_NAMED or np.median(apart.min(axis=0)) > _APART * np.ptp(places, axis=0).max():
        return places
    angles = np.pi / 2 - 2 * np.pi * np.arange(len(places)) / len(places)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _draw_graph(
    axes: Axes,
    places: FloatArray,
    names: Sequence[str],
    colors: FloatArray,
    edges: Sequence[tuple[int, int, float, bool]],
) -> ScalarMappable:
    kept = [edge[2] for edge in edges if edge[3]]
    scale = ScalarMappable(Normalize(0.0, max([LEAST_RANGE, *kept])), _RESIDUALS)
    for wanted, dashes in ((False, (0, (3, 2))), (True, "-")):
        chosen = [edge for edge in edges if edge[3] == wanted]
        lines = [places[[source, target]] for source, target, *_ in chosen]
        values = scale.to_rgba([edge[2] for edge in chosen])
        axes.add_collection(LineCollection(lines, colors=values, linewidths=1.6, linestyles=[dashes]))
    size = 60 if len(places) <= MOST_NAMED else 14
    axes.scatter(*places.T, s=size, color=colors, edgecolors="white", linewidths=0.8, zorder=3)
    if len(places) <= MOST_NAMED:
        middle = places.mean(axis=0)
        for place, name in zip(places, names, strict=True):
            side = place[0] >= middle[0]
            axes.annotate(
                style.as_it_is(name),
                place,
                (7 if side else -7, 0),
                textcoords="offset points",
                ha="left" if side else "right",
                va="center",
                fontsize=8,
                color=style.TEXT,
            )
    axes.margins(0.3, 0.12)
    axes.set_aspect("equal")
    axes.set_axis_off()
    return scale
