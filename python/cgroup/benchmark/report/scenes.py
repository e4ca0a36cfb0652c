"""Section of the report on pipelines that register many scans."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cgroup.benchmark.report.cells import Cell, Table, median, number, tabulate
from cgroup.benchmark.report.charts import PageChart
from cgroup.benchmark.report.pictures import PictureBook
from cgroup.evaluation import ecdf
from cgroup.evaluation.scene_scores import ROTATION_LIMITS, TRANSLATION_LIMITS
from cgroup.plots.experiments import scenes_chart
from cgroup.types import FloatArray

if TYPE_CHECKING:  # slow to load
    import pandas as pd


class SceneSection(NamedTuple):
    """Chart of the shares of pairs of scans up to each error, and table of components, errors and costs."""

    chart: PageChart
    table: Table


def make_scene_section(frame: pd.DataFrame, pictures: PictureBook) -> SceneSection | None:
    """Make the section; None without results."""
    good = frame[frame["error"] == ""] if len(frame) else frame
    if good.empty:
        return None
    sizes = good.drop_duplicates(["set", "pair"]).groupby("set", sort=False)["scans"].sum()
    title = ", ".join(f"{name} ({size})" for name, size in sizes.items())
    chart = scenes_chart(good)
    shares = {
        name: ecdf(np.concatenate(rows["rotation"].tolist()), ROTATION_LIMITS[:1])[0]
        for name, rows in good.groupby("method", sort=False)
    }
    best = max(shares, key=lambda name: shares[name])
    alt = (
        f"Share of pairs of scans up to each error, of {len(shares)} pipelines for many scans; over all sets "
        f"{best} has the most within {ROTATION_LIMITS[0]:g} degrees, {shares[best]:.2f}."
    )
    file = pictures.save("scenes", chart.draw(f"Many scans: {title}", columns=2))
    return SceneSection(PageChart(file, alt, chart, (file,)), scene_table(good))


def scene_table(good: pd.DataFrame) -> Table:
    """Tabulate components, errors of every two scans of one place, and costs; seeds are taken together."""

    def fraction(rows: pd.DataFrame, part: str, whole: str) -> Cell:
        done, wanted = int(rows[part].sum()), int(rows[whole].sum())
        return Cell(f"{done} of {wanted}", done / max(wanted, 1))

    def errors(rows: pd.DataFrame, column: str) -> FloatArray:
        return np.concatenate(rows[column].tolist())

    def known(rows: pd.DataFrame, column: str) -> FloatArray:
        """Return the errors of pairs in one component."""
        every = errors(rows, column)
        finite = every[np.isfinite(every)]
        return finite if len(finite) else np.array([np.nan])

    def within(rows: pd.DataFrame, column: str, limits: tuple[float, ...]) -> Cell:
        shares = 100 * ecdf(errors(rows, column), limits)
        return Cell(" ".join(f"{share:.0f}" for share in shares), float(shares[0]))

    def limits_of(limits: tuple[float, ...]) -> str:
        return "/".join(f"{limit:g}" for limit in limits)

    columns = {
        "components right": lambda rows: fraction(rows, "right", "wanted"),
        "mixed": lambda rows: number(rows["mixed"].sum(), "{:.0f}"),
        "placed": lambda rows: fraction(rows, "placed", "scans"),
        "median degrees": lambda rows: number(float(np.median(known(rows, "rotation"))), "{:.3g}"),
        "largest degrees": lambda rows: number(float(known(rows, "rotation").max()), "{:.3g}"),
        "median shift": lambda rows: number(float(np.median(known(rows, "translation"))), "{:.3g}"),
        "largest shift": lambda rows: number(float(known(rows, "translation").max()), "{:.3g}"),
        f"% within {limits_of(ROTATION_LIMITS)} degrees": lambda rows: within(
            rows, "rotation", ROTATION_LIMITS
        ),
        f"% within {limits_of(TRANSLATION_LIMITS)} shift": lambda rows: within(
            rows, "translation", TRANSLATION_LIMITS
        ),
        "pairs tried": lambda rows: number(rows["tried"].sum(), "{:.0f}"),
        "s": median("seconds", "{:.1f}"),
    }
    caption = "Components, errors, registered pairs of scans, and seconds"
    return tabulate(caption, good, {"set": "set", "method": "solver"}, columns)
