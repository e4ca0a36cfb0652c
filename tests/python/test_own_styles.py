"""Methods from outside look like none of the package's, nor like each other."""

import numpy as np
import pandas as pd
import pytest

from cgroup import METHODS
from cgroup.benchmark.report.curves import pipelines_chart
from cgroup.plots.style import METHOD_STYLES, OWN_COLORS, method_style, method_styles

OWN = [f"Own method {number}" for number in range(8)]


def test_own_methods_are_styled_by_order_of_appearance() -> None:
    looks = method_styles([*METHODS, *OWN])
    assert [looks[name] for name in METHODS] == list(METHOD_STYLES.values())
    assert [looks[name].color for name in OWN] == list(OWN_COLORS)
    assert [looks[name].label for name in OWN] == OWN
    assert len({look.color for look in looks.values()}) == len({look.symbol for look in looks.values()}) == 23
    reversed_looks = method_styles([*reversed(OWN), "gtm"])
    assert [look.color for look in reversed_looks.values()] == [*OWN_COLORS, METHOD_STYLES["gtm"].color]
    assert method_style("Mine") == method_styles(["gtm", "Mine", "gtm", "Mine"])["Mine"]


def test_looks_that_are_chosen_stay() -> None:
    report = method_styles(OWN)
    figure = method_styles([OWN[3], "new", "gtm"], report)
    assert figure[OWN[3]] == report[OWN[3]]
    assert figure["gtm"] == METHOD_STYLES["gtm"]
    assert figure["new"].color == OWN_COLORS[0]
    assert figure["new"].symbol not in {look.symbol for look in report.values()} - {report[OWN[1]].symbol}


def test_reliability_counts_unrelated_pairs_too() -> None:
    rows = [("related", True, 0.95)] * 3 + [("mirrored", False, 0.95), ("mixed", False, 0.2)]
    table = pd.DataFrame(
        [
            {"method": "cgroup", "name": "cgroup", "refined": False, "set": "a", "overlap": 0.5}
            | {"seconds": 1.0, "kind": kind, "right": right, "probability": chance}
            | {"dataset": "own", "pair": str(number)}
            for number, (kind, right, chance) in enumerate(rows)
        ]
    )
    reliability = pipelines_chart(table).panels[1]
    assert reliability.at == pytest.approx([0.05, 0.2, 0.4, 0.6, 0.8, 0.95])
    (series,) = reliability.series
    np.testing.assert_allclose(series.y, [np.nan, 0, np.nan, np.nan, np.nan, 0.75])
    assert pipelines_chart(table.assign(probability=np.nan)).panels[1].title == "a"  # nobody tells any
