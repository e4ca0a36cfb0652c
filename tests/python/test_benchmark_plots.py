"""Figures of the benchmark: drawn without a display, one look per method, nothing hidden."""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pytest
from benchmark_frames import METHODS, paper_frame, paper_timing
from matplotlib.colors import to_hex
from matplotlib.lines import Line2D

from cgroup.benchmark.paper.evidence import Evidence, mean_times
from cgroup.evaluation.bins import LEAST_PAIRS
from cgroup.plots.experiments import draw_times, matches_chart, pairs_chart, rates_chart, scores_chart
from cgroup.plots.style import METHOD_STYLES, PRINT_WIDTH

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEVEL = "level (pr)"


def rows(experiment: str, place: str) -> pd.DataFrame:
    sample = Evidence(paper_frame(experiment), pd.DataFrame()).sample(experiment, place)
    assert sample is not None
    return sample.rows


def drawn(figure: Figure) -> bytes:
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=40)
    return buffer.getvalue()


def curves(axes) -> dict[str, np.ndarray]:
    """Heights of the curves by color."""
    return {to_hex(line.get_color()).upper(): line.get_ydata() for line in axes.lines}


def marked(axes) -> list[Line2D]:
    """Lines with markers, without those that connect them."""
    return [line for line in axes.lines if line.get_marker() != "None"]


def test_scores_are_the_means_in_each_methods_color() -> None:
    noise = rows("noise", "B3R")
    figure = scores_chart(noise, LEVEL).draw("A title")
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["F", "precision", "recall"]
    found = curves(figure.axes[2])
    assert set(found) == {METHOD_STYLES[method].color.upper() for method in METHODS}
    expected = noise[noise["method"] == "si"].groupby("x")["recall"].mean()
    np.testing.assert_allclose(found[METHOD_STYLES["si"].color.upper()], expected)
    assert figure.get_figwidth() == PRINT_WIDTH
    assert drawn(figure)


def test_legend_names_every_method_below_the_panels() -> None:
    figure = scores_chart(rows("overlap", "U3M"), LEVEL).draw("A title")
    drawn(figure)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [METHOD_STYLES[name].label for name in METHODS]
    box = legend.get_window_extent()
    for axes in figure.axes:
        assert box.y1 <= axes.get_window_extent().y0


def test_names_have_no_order_and_nothing_connects_them() -> None:
    figure = scores_chart(rows("combinations", "U3OR"), LEVEL).draw("A title")
    axes = figure.axes[0]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["C1", "C2", "C3", "C4", "C5", "C6"]
    assert {line.get_linestyle() for line in axes.lines} == {"None"}
    # Side by side, so that equal scores don't hide each other.
    assert len({line.get_xdata()[0] for line in axes.lines}) == len(METHODS)
    assert drawn(figure)


def test_levels_of_few_pairs_are_hollow_and_no_solid_line_leads_there() -> None:
    found = rows("overlap", "U3M")
    sparse = found["x"] == found["x"].min()
    few = found["pair"].isin(found.loc[sparse, "pair"].unique()[: LEAST_PAIRS - 1])
    figure = scores_chart(found[~sparse | few], LEVEL).draw("A title")
    filled, hollow = (
        [line for line in marked(figure.axes[0]) if line.get_markerfacecolor() == face]
        for face in (METHOD_STYLES["gtm"].color, "white")
    )
    assert filled[0].get_markevery() == [1, 2, 3, 4, 5, 6]
    assert [line.get_markevery() for line in hollow] == [[0]] * len(METHODS)
    solid = next(line for line in figure.axes[0].lines if line.get_color() == METHOD_STYLES["gtm"].color)
    assert np.isnan(solid.get_ydata()[1])
    assert "fewer than 5 pairs" in {text.get_text() for text in figure.legends[0].get_texts()}
    assert drawn(figure)
    assert "fewer than 5 pairs" not in {
        text.get_text() for text in scores_chart(found, LEVEL).draw("A title").legends[0].get_texts()
    }


def test_registration_has_a_panel_per_applicable_criterion() -> None:
    views = rows("overlap", "U3M").assign(**{"ok:kitti": None})
    figure = rates_chart(views, LEVEL).draw("A title")
    titles = [axes.get_title(loc="left") for axes in figure.axes if axes.axison]
    assert titles == ["precision > 0.1 (the paper's)", "RMSE at most 5 pr"]
    assert drawn(figure)


def test_registration_leaves_out_what_is_not_judged() -> None:
    views = rows("overlap", "U3M")
    judged = views.assign(
        **{"ok:rmse<=5pr": views["ok:rmse<=5pr"].astype(object).where(views["overlap"] > 0.5)}
    )
    figure = rates_chart(judged, LEVEL).draw("A title")
    assert np.isfinite(marked(figure.axes[0])[0].get_ydata()).sum() == 7
    assert np.isfinite(marked(figure.axes[1])[0].get_ydata()).sum() == 5


def test_matches_are_counted_once_per_pair() -> None:
    figure = matches_chart(rows("density", "B3R"), LEVEL).draw("A title")
    counts, ratio = figure.axes
    np.testing.assert_allclose(marked(counts)[0].get_ydata(), 1200)
    assert "fewer than 5 pairs" in {text.get_text() for text in figure.legends[0].get_texts()}
    np.testing.assert_allclose(marked(ratio)[0].get_ydata(), 0.05 * np.arange(1, 10))
    assert drawn(figure)


def test_pairs_are_sorted_by_the_second_method() -> None:
    scenes = rows("clutter", "U3OR")
    figure = pairs_chart(scenes, ("gc", "ransac")).draw("A title")
    ransac = curves(figure.axes[0])[METHOD_STYLES["ransac"].color]
    assert (np.diff(ransac) >= 0).all()
    assert len(ransac) == scenes["pair"].nunique()
    assert drawn(figure)


def test_times_on_logarithmic_axes_with_both_exponents() -> None:
    times = mean_times(paper_timing())
    figure = draw_times(times, {"st": 2.5, "gtm": np.nan}, {"st": "n³"}, "A title")
    (axes,) = figure.axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts[0] == "ST  measured n^2.50; paper n³"
    assert "GTM" in texts
    assert drawn(figure)


def test_one_level_and_one_method_are_enough() -> None:
    one = rows("noise", "B3R").query("method == 'gtm' and x == 0.05")
    for make in (scores_chart, rates_chart, matches_chart):
        assert drawn(make(one, LEVEL).draw("A title"))


@pytest.mark.parametrize("method", METHODS)
def test_individual_based_methods_are_dashed(method: str) -> None:
    assert (METHOD_STYLES[method].dashes != "-") == (method in {"ss", "nnsr", "si", "cv"})
