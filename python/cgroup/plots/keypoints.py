"""Keypoints on a shaded cloud."""

# Parts of matplotlib's methods are untyped.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from cgroup._checks.arrays import as_points, as_rows
from cgroup.plots import style
from cgroup.plots.scene import caption, show
from cgroup.plots.shading import face_broadside, find_front, shade

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

_COLUMNS = 2
_PANEL = 5  # inches


def keypoints_figure(
    points: ArrayLike,
    keypoints: Mapping[str, ArrayLike],
    *,
    title: str,
    viewpoint: tuple[float, float, float] = (0, 0, 0),
) -> Figure:
    """Draw where detectors found keypoints, one panel each.

    Parameters
    ----------
    points : (N,3) array_like of float
        Whole cloud.
    keypoints : mapping of str to (m,) array_like of int
        Rows of the cloud, by the name of the detector.
    title : str
        Shown on top.
    viewpoint : (float, float, float)
        Where the scanner stood; the cloud is seen from that side.

    Returns
    -------
    Figure
        Keypoints on the far side are left out, and counted below the panel.

    Raises
    ------
    IndexError
        For keypoints that are no rows of the points.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.plots import keypoints_figure
    >>> from cgroup.registration import detect
    >>> scan = standin_pair(pixels=60).source
    >>> found = {name: detect(scan, detector=name) for name in ("h3d", "iss")}
    >>> figure = keypoints_figure(scan.points, found, title="Two detectors")
    >>> [axes.get_title(loc="left") for axes in figure.axes]
    ['h3d', 'iss']
    >>> figure.savefig("keypoints.png")
    """
    cloud = as_points("points", points)
    projected = face_broadside(cloud, viewpoint).project(cloud)
    picture, visible = shade(projected, style.TARGET_TINT), find_front(projected)
    left, right, bottom, top = picture.extent
    columns = min(_COLUMNS, len(keypoints))
    rows = -(-len(keypoints) // columns)
    height = float(np.clip(_PANEL * (top - bottom) / (right - left), 2, 9)) + 0.4
    size = (columns * _PANEL, rows * height + 0.5)
    figure = Figure(figsize=size, dpi=style.DOTS_PER_INCH, layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).reshape(-1)
    for axes in panels:
        axes.set_axis_off()
        axes.set_aspect("equal", anchor="N")
    for axes, (name, found) in zip(panels, keypoints.items(), strict=False):
        show(axes, picture)
        rows_shown = as_rows(name, found)
        seen = projected[rows_shown[visible[rows_shown]]]
        axes.scatter(seen[:, 0], seen[:, 1], s=9, color=style.WRONG, edgecolors="white", linewidths=0.3)
        caption(axes, name, f"{len(rows_shown)} keypoints, {len(seen)} on this side")
    figure.suptitle(title, color=style.TEXT)
    return figure
