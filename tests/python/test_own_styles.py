"""Methods from outside look like none of the package's, nor like each other, also to colour-blind readers."""

from collections.abc import Callable
from io import BytesIO

import numpy as np
import pandas as pd
import pytest
from color_vision import VISIONS, ciede2000, lab
from matplotlib.figure import Figure
from matplotlib.markers import MarkerStyle

from cgroup import METHODS
from cgroup.plots.experiments import (
    draw_times,
    pairs_chart,
    pipelines_chart,
    rates_chart,
    scores_chart,
    trials_chart,
)
from cgroup.plots.style import METHOD_STYLES, OWN_COLORS, OWN_MARKERS, method_style, method_styles

OWN = [f"Own method {number}" for number in range(8)]
AWKWARD = ["_hidden", "50 % of $n$", r"$\foo$", "ÄÖ", "gtm 2"]


def test_the_distances_are_ciede2000() -> None:
    """Pairs 1, 5, 17 and 25 of Sharma, Wu, Dalal (2005), table 1."""
    first = np.array([[50, 2.6772, -79.7751], [50, 0, 0], [50, 2.5, 0], [60.2574, -34.0099, 36.2677]])
    second = np.array([[50, 0, -82.7485], [50, -1, 2], [73, 25, -18], [60.4626, -34.1751, 39.4387]])
    np.testing.assert_allclose(
        np.diag(ciede2000(first, second)), [2.0425, 2.3669, 27.1492, 1.2644], atol=1e-4
    )


@pytest.mark.parametrize("vision", VISIONS)
def test_own_colors_are_told_from_each_other_and_from_the_packages(vision: str) -> None:
    own, known = lab(list(OWN_COLORS), vision), lab([look.color for look in METHOD_STYLES.values()], vision)
    among = ciede2000(own, own)[~np.eye(len(own), dtype=bool)]
    assert among.min() >= 13
    assert ciede2000(own, known).min() >= 9
    lightness = lab(list(OWN_COLORS), "normal")[:, 0]
    assert lightness.max() < 80  # seen on white


def test_own_markers_are_none_of_the_packages() -> None:
    shapes = {MarkerStyle(marker).get_path().vertices.tobytes() for marker, *_ in OWN_MARKERS}
    known = {MarkerStyle(look.marker).get_path().vertices.tobytes() for look in METHOD_STYLES.values()}
    assert len(shapes) == len(OWN_MARKERS)
    assert not shapes & known
    symbols = [look.symbol for look in METHOD_STYLES.values()] + [symbol for _, symbol, _ in OWN_MARKERS]
    assert len(set(symbols)) == len(symbols)


def test_symbols_are_plotlys() -> None:
    scatter = pytest.importorskip("plotly.graph_objects", reason="plotly draws interactive pages").Scatter
    for look in method_styles([*METHODS, *OWN]).values():
        assert scatter(marker={"symbol": look.symbol}).marker.symbol == look.symbol


def test_own_methods_are_styled_by_order_of_appearance() -> None:
    looks = method_styles([*METHODS, *OWN])
    assert [looks[name] for name in METHODS] == list(METHOD_STYLES.values())
    assert [looks[name].color for name in OWN] == list(OWN_COLORS)
    assert [looks[name].label for name in OWN] == OWN
    assert len({look.color for look in looks.values()}) == len({look.symbol for look in looks.values()}) == 23
    reversed_looks = method_styles([*reversed(OWN), "gtm"])
    assert [look.color for look in reversed_looks.values()] == [*OWN_COLORS, METHOD_STYLES["gtm"].color]
    assert method_style("Mine") == method_styles(["gtm", "Mine", "gtm", "Mine"])["Mine"]


def test_many_own_methods_still_differ() -> None:
    looks = method_styles(f"variant {number}" for number in range(64))
    assert len({(look.color, look.symbol) for look in looks.values()}) == 64


def test_looks_that_are_chosen_stay() -> None:
    report = method_styles(OWN)
    figure = method_styles([OWN[3], "new", "gtm"], report)
    assert figure[OWN[3]] == report[OWN[3]]
    assert figure["gtm"] == METHOD_STYLES["gtm"]
    assert figure["new"].color == OWN_COLORS[0]
    assert figure["new"].symbol not in {look.symbol for look in report.values()} - {report[OWN[1]].symbol}


def frame() -> pd.DataFrame:
    """Records of own methods beside one of the package's, in an order that isn't that of the alphabet."""
    rng = np.random.default_rng(0)
    return pd.DataFrame(
        [
            {
                "method": method,
                "pair": str(pair),
                "x": float(level),
                "precision": rng.uniform(),
                "recall": rng.uniform(),
                "f_score": rng.uniform(),
                "registered": True,
                "right": True,
                "seconds": rng.uniform(0.01, 1),
            }
            for method in [*reversed(AWKWARD), "gtm"]
            for pair in range(3)
            for level in range(1, 4)
        ]
    )


def times(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.pivot_table(index="x", columns="method", values="seconds", aggfunc="mean")


def timing(rows: pd.DataFrame, title: str, **options) -> Figure:
    return draw_times(times(rows), {}, {}, title, **options)


def pair_by_pair(rows: pd.DataFrame, title: str, **options) -> Figure:
    return pairs_chart(rows, (AWKWARD[1], AWKWARD[2]), **options).draw(title)


def scores(rows: pd.DataFrame, title: str, **options) -> Figure:
    return scores_chart(rows, "x", **options).draw(title)


def rates(rows: pd.DataFrame, title: str, **options) -> Figure:
    return rates_chart(rows, "x", **options).draw(title)


def trials(rows: pd.DataFrame, title: str, **options) -> Figure:
    return trials_chart(rows, **options).draw(title)


FIGURES = (scores, rates, timing, pair_by_pair, trials)


def shown_labels(figure: Figure) -> list[str]:
    legend = figure.legends or figure.axes
    texts = [text.get_text() for each in legend for text in getattr(each, "texts", [])]
    return [text.replace(r"\$", "$") for text in texts]


@pytest.mark.parametrize("draw", FIGURES, ids=lambda draw: draw.__name__)
def test_figures_show_labels_as_they_are_given(draw: Callable) -> None:
    figure = draw(frame(), title="t")
    figure.savefig(BytesIO(), format="png", dpi=40)
    wanted = AWKWARD[1:3] if draw is pair_by_pair else [*AWKWARD, "GTM"]
    assert set(wanted) <= set(shown_labels(figure))


@pytest.mark.parametrize("draw", FIGURES, ids=lambda draw: draw.__name__)
def test_figures_take_the_looks_of_a_report(draw: Callable) -> None:
    looks = method_styles(["another", "and another", *AWKWARD])
    figure = draw(frame(), title="t", styles=looks)
    drawn = {
        str(artist.get_color()).upper() if hasattr(artist, "get_color") else style_of_points(artist)
        for axes in figure.axes
        for artist in [*axes.lines, *axes.collections]
    }
    wanted = AWKWARD[1:3] if draw is pair_by_pair else AWKWARD
    assert {looks[name].color for name in wanted} <= drawn
    assert looks["another"].color not in drawn


def style_of_points(points) -> str:
    return "#" + "".join(f"{round(255 * part):02X}" for part in points.get_facecolor()[0][:3])


def test_own_pipelines_are_colored_too() -> None:
    names = ["cgroup", "mymodule:first", "mymodule:second"]
    table = pd.DataFrame(
        [
            {"method": name, "name": name, "refined": False, "set": "a", "overlap": 0.5, "right": True}
            | {"seconds": 1.0, "kind": "related", "probability": 0.95}
            for name in names
            for _ in range(4)
        ]
    )
    figure = pipelines_chart(table).draw("t")
    for axes in figure.axes[:2]:  # by overlap, by probability
        colors = dict.fromkeys(line.get_color() for line in axes.lines)
        assert list(colors)[1:] == list(OWN_COLORS[:2])


def test_reliability_counts_unrelated_pairs_too() -> None:
    rows = [("related", True, 0.95)] * 3 + [("mirrored", False, 0.95), ("mixed", False, 0.2)]
    table = pd.DataFrame(
        [
            {"method": "cgroup", "name": "cgroup", "refined": False, "set": "a", "overlap": 0.5}
            | {"seconds": 1.0, "kind": kind, "right": right, "probability": chance}
            for kind, right, chance in rows
        ]
    )
    reliability = pipelines_chart(table).panels[1]
    assert reliability.at == pytest.approx([0.05, 0.2, 0.4, 0.6, 0.8, 0.95])
    (series,) = reliability.series
    np.testing.assert_allclose(series.y, [np.nan, 0, np.nan, np.nan, np.nan, 0.75])
    assert pipelines_chart(table.assign(probability=np.nan)).panels[1].title == "a"  # nobody tells any
