"""What the page shows of ways to register many scans: distributions of errors, and a table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.report.cells import Cell, Table, number, words
from cgroup.benchmark.report.charts import PageChart
from cgroup.evaluation import ecdf
from cgroup.evaluation.scenes import ROTATION_LIMITS, TRANSLATION_LIMITS
from cgroup.plots.experiments import scenes_chart

if TYPE_CHECKING:
    import pandas as pd

    from cgroup.benchmark.report.pictures import PictureBook
    from cgroup.types import FloatArray


@dataclass(frozen=True)
class SceneSection:
    """Ways to register many scans, compared.

    Attributes
    ----------
    chart : PageChart
        Shares of pairs of scans up to each error.
    table : Table
        Components, errors, and what they cost.
    """

    chart: PageChart
    table: Table


def make_scene_section(frame: pd.DataFrame, pictures: PictureBook) -> SceneSection | None:
    """Make the section of scenes; None where there are no records."""
    good = frame[frame["error"] == ""] if len(frame) else frame
    if good.empty:
        return None
    sizes = good.drop_duplicates(["set", "pair"]).groupby("set", sort=False)["scans"].sum()
    title = ", ".join(f"{name} ({size})" for name, size in sizes.items())
    chart = scenes_chart(good)
    shares = {
        name: ecdf(np.concatenate(rows["rotation"].tolist()), ROTATION_LIMITS[:1])[0]
        for name, rows in good.groupby("solver", sort=False)
    }
    best = max(shares, key=lambda name: shares[name])
    alt = (
        f"Share of pairs of scans up to each error, of {len(shares)} ways to register many scans; over "
        f"all sets {best} has the most within {ROTATION_LIMITS[0]:g} degrees, {shares[best]:.2f}."
    )
    file = pictures.save("scenes", chart.draw(f"Many scans: {title}", columns=2))
    return SceneSection(PageChart(file, alt, chart, (file,)), scene_table(good))


def scene_table(good: pd.DataFrame) -> Table:
    """List components, errors of every two scans of one place, and costs; seeds are taken together."""
    rows: list[tuple[Cell, ...]] = []
    for (name, solver), chosen in good.groupby(["set", "solver"], sort=False):
        total = chosen[["right", "wanted", "mixed", "placed", "scans", "tried"]].sum()
        errors = [np.concatenate(chosen[column].tolist()) for column in ("rotation", "translation")]
        rows.append(
            (
                words(name),
                words(solver),
                Cell(f"{total['right']} of {total['wanted']}", total["right"] / max(total["wanted"], 1)),
                number(total["mixed"], "{:.0f}"),
                Cell(f"{total['placed']} of {total['scans']}", total["placed"] / total["scans"]),
                *(cell for each in errors for cell in _median_and_largest(each)),
                _shares(errors[0], ROTATION_LIMITS),
                _shares(errors[1], TRANSLATION_LIMITS),
                number(total["tried"], "{:.0f}"),
                number(float(chosen["seconds"].median()), "{:.1f}"),
            )
        )
    limits = ("/".join(f"{limit:g}" for limit in each) for each in (ROTATION_LIMITS, TRANSLATION_LIMITS))
    headers = (
        *("set", "solver", "components right", "mixed", "placed"),
        *(f"{which} {what}" for what in ("degrees", "shift") for which in ("median", "largest")),
        *(f"% within {each} {unit}" for each, unit in zip(limits, ("degrees", "shift"), strict=True)),
        *("pairs tried", "s"),
    )
    return Table("Components, errors, pairs of scans that were registered, and seconds", headers, rows)


def _median_and_largest(errors: FloatArray) -> tuple[Cell, Cell]:
    """Cells of errors of those pairs that are in one component."""
    known = errors[np.isfinite(errors)]
    median, largest = (np.median(known), known.max()) if len(known) else (np.nan, np.nan)
    return number(float(median), "{:.3g}"), number(float(largest), "{:.3g}")


def _shares(errors: FloatArray, limits: tuple[float, ...]) -> Cell:
    shares = 100 * ecdf(errors, limits)
    return Cell(" ".join(f"{share:.0f}" for share in shares), float(shares[0]))
