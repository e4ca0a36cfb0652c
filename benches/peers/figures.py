"""Time and peak memory over n on logarithmic axes, one panel per kind of method."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.colors import to_hex, to_rgb
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter

from cgroup.plots import style
from cgroup.plots.charts import MARKER_SIZE, finish, panels
from peers.catalogue import OURS, PEERS, Peer
from peers.scaling import LEAST_MIB, Curve, Quantity

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.path import Path

PANELS = {
    "GC": ("gc",),
    "RANSAC and other pose fits": ("ransac",),
    "ST": ("st",),
    "GTM": ("gtm",),
    "Voting: SI, CV, 3DHV": ("si", "cv", "3dhv"),
}

LIBRARY_COLORS = {
    "PCL": "#D55E00",
    "NumPy": "#0072B2",
    "SciPy": "#0072B2",
    "Open3D": "#E69F00",
    "GC-RANSAC": "#56B4E9",
    "KISS-Matcher": "#333333",
}
"""By the first word of a label."""

VARIANTS = (("o", 0.0), ("s", 0.35), ("^", 0.55), ("v", 0.15))
"""Marker and share of white of several peers from one library in a panel."""

LEAST_DRAWN = {"seconds": 1e-6, "mib": 0.1}
UNITS = {"seconds": "seconds per call", "mib": "peak memory of a call, MiB"}
TITLES = {"seconds": "Time", "mib": "Peak memory"}
LEGEND_FONT = 6.5
SIDE = 1.3  # room beside the first and the last n


class Look(NamedTuple):
    """How one peer is drawn."""

    color: str
    marker: str | Path
    size: float = 1.0


def scaling_figure(
    curves: Mapping[str, Curve], more_threads: Mapping[str, Curve], *, quantity: Quantity, share: float
) -> Figure:
    """Draw a quantity over n.

    Parameters
    ----------
    curves : mapping of str to Curve
        By peer, on one thread.
    more_threads : mapping of str to Curve
        Ours on more threads, drawn dashed; may be empty.
    quantity : {"seconds", "mib"}
        What the curves show.
    share : float
        Share of inliers, for the title.

    Returns
    -------
    Figure
        Ours in bold; the legends give fitted exponents.
    """
    threads = {curve.threads for curve in curves.values()} | {0}
    title = f"{TITLES[quantity]} over the number of matches n: {share:.0%} inliers, {_threads(max(threads))}"
    figure, axes = panels(len(PANELS) + 1, columns=2, title=title, extra=1.0)
    axes[-1].set_axis_off()
    sizes = sorted({n for curve in (*curves.values(), *more_threads.values()) for n in curve.sizes})
    for place, (name, methods) in zip(axes, PANELS.items(), strict=False):
        looks = panel_looks(methods)
        for peer in looks:
            if peer in more_threads:
                _draw(place, more_threads[peer], looks[peer], quantity, again=True)
        for peer in sorted(looks, key=is_ours):  # ours on top
            if peer in curves:
                _draw(place, curves[peer], looks[peer], quantity)
        _finish(place, name, quantity, sizes)
    _explain(axes[-1], more_threads)
    return figure


def panel_looks(methods: tuple[str, ...]) -> dict[str, Look]:
    """Colour by library, or by method for ours; shades and markers tell apart what comes from one library."""
    looks: dict[str, Look] = {}
    used: dict[str, int] = {}
    for peer in (peer for peer in PEERS.values() if peer.method in methods):
        own = style.method_style(peer.method)
        if is_ours(peer.name):
            looks[peer.name] = Look(own.color, own.marker, own.size)
        else:
            color = library_color(peer)
            marker, white = VARIANTS[used.get(color, 0) % len(VARIANTS)]
            used[color] = used.get(color, 0) + 1
            mixed = (1 - white) * np.array(to_rgb(color)) + white
            looks[peer.name] = Look(to_hex(mixed), marker)
    return looks


def library_color(peer: Peer) -> str:
    """Colour of the library that a peer comes from."""
    return next(color for name, color in LIBRARY_COLORS.items() if peer.label.startswith(name))


def is_ours(name: str) -> bool:
    """Tell our methods from the peers."""
    return name.startswith(OURS)


def _draw(axes: Axes, curve: Curve, look: Look, quantity: Quantity, *, again: bool = False) -> None:
    ours = is_ours(curve.peer)
    axes.plot(
        curve.sizes,
        np.maximum(curve.values, LEAST_DRAWN[quantity]),
        color=look.color,
        marker="" if again else look.marker,
        markersize=MARKER_SIZE * look.size * (1.1 if ours else 0.85),
        markeredgecolor="white",
        markeredgewidth=0.4,
        linestyle=(0, (2.5, 1.2)) if again else "-",
        linewidth=1.2 if again else 2.4 if ours else 0.9,
        alpha=0.8 if again else 1.0,
        label="" if again else _label(curve, quantity),
        zorder=4 if ours else 3,
    )


def _label(curve: Curve, quantity: Quantity) -> str:
    exponent = curve.exponent(least=LEAST_MIB if quantity == "mib" else 0.0)
    fitted = "" if np.isnan(exponent) else f"  $n^{{{exponent:.2f}}}$"
    return f"{PEERS[curve.peer].label}{fitted}"


def _finish(axes: Axes, name: str, quantity: Quantity, sizes: Sequence[int]) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    finish(axes, title=name, xlabel="n", ylabel=UNITS[quantity])
    if not axes.get_lines():
        axes.text(0.5, 0.5, "nothing recorded", ha="center", transform=axes.transAxes, color=style.QUIET_TEXT)
        return
    axes.set_xlim(sizes[0] / SIDE, sizes[-1] * SIDE)
    axes.xaxis.set_major_locator(FixedLocator(sizes))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda n, _: f"{n / 1000:g}k" if n >= 1000 else f"{n:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.xaxis.set_minor_locator(FixedLocator([]))
    axes.yaxis.set_major_locator(LogLocator(numticks=12))
    axes.yaxis.set_minor_formatter(NullFormatter())
    handles, labels = axes.get_legend_handles_labels()
    ours_first = sorted(zip(handles, labels, strict=True), key=lambda item: not item[1].startswith("cgroup"))
    axes.legend(
        *zip(*ours_first, strict=True),
        loc="upper center",
        bbox_to_anchor=(0.46, -0.18),
        ncols=2,
        frameon=False,
        fontsize=LEGEND_FONT,
        handlelength=1.8,
        columnspacing=1.0,
        handletextpad=0.5,
        labelspacing=0.3,
    )


def _explain(axes: Axes, more_threads: Mapping[str, Curve]) -> None:
    lines = ["Bold: cgroup. Thin: its peers."]
    count = max((curve.threads for curve in more_threads.values()), default=0)
    if count:
        lines.append(f"Dashed: cgroup, {_threads(count)}.")
    lines += [
        "Exponents: least squares over n ≥ 2,000.",
        "Colours: the method for cgroup,",
        "the library for its peers.",
    ]
    axes.text(
        0.08,
        0.9,
        "\n".join(lines),
        va="top",
        fontsize=8,
        color=style.TEXT,
        linespacing=1.6,
        transform=axes.transAxes,
    )


def _threads(count: int) -> str:
    return "1 thread" if count == 1 else f"{count} threads"
