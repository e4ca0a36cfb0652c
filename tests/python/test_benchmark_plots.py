"""Figures of the benchmark: drawn without a display, one look per method, nothing hidden."""

import numpy as np
import pandas as pd
from benchmark_frames import METHODS, paper_frame, paper_timing
from matplotlib.lines import Line2D
from test_plots import drawn

from cgroup.benchmark.paper.evidence import Evidence, mean_times
from cgroup.benchmark.report.curves import draw_times, matches_chart, rates_chart, scores_chart
from cgroup.evaluation.protocols import LEAST_PAIRS
from cgroup.plots.style import METHOD_STYLES

LEVEL = "level (pr)"


def rows(experiment: str, place: str) -> pd.DataFrame:
    sample = Evidence(paper_frame(experiment), pd.DataFrame()).sample(experiment, place)
    assert sample is not None
    return sample.rows


def marked(axes) -> list[Line2D]:
    """Lines with markers, without those that connect them."""
    return [line for line in axes.lines if line.get_marker() != "None"]


def test_levels_of_few_pairs_are_hollow_and_no_solid_line_leads_there():
    found = rows("overlap", "U3M")
    sparse = found["x"] == found["x"].min()
    few = found["pair"].isin(found.loc[sparse, "pair"].unique()[: LEAST_PAIRS - 1])
    figure = scores_chart(found[~sparse | few], LEVEL, {}).draw("A title")
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
        text.get_text() for text in scores_chart(found, LEVEL, {}).draw("A title").legends[0].get_texts()
    }


def test_registration_has_a_panel_per_applicable_criterion():
    views = rows("overlap", "U3M").assign(**{"ok:kitti": None})
    figure = rates_chart(views, LEVEL, {}).draw("A title")
    titles = [axes.get_title(loc="left") for axes in figure.axes if axes.axison]
    assert titles == ["precision > 0.1 (the paper's)", "RMSE at most 5 pr"]
    assert drawn(figure)


def test_matches_are_counted_once_per_pair():
    figure = matches_chart(rows("density", "B3R"), LEVEL).draw("A title")
    counts, ratio = figure.axes
    np.testing.assert_allclose(marked(counts)[0].get_ydata(), 1200)
    assert "fewer than 5 pairs" in {text.get_text() for text in figure.legends[0].get_texts()}
    np.testing.assert_allclose(marked(ratio)[0].get_ydata(), 0.05 * np.arange(1, 10))
    assert drawn(figure)


def test_times_on_logarithmic_axes_with_both_exponents():
    times = mean_times(paper_timing())
    figure = draw_times(times, {"st": 2.5, "gtm": np.nan}, {"st": "n³"}, {}, "A title")
    (axes,) = figure.axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts[0] == "ST  measured n^2.50; paper n³"
    assert "GTM" in texts
    assert drawn(figure)
