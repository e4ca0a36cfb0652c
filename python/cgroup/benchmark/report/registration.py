"""Section of the report on pipelines that register two clouds."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cgroup.benchmark.report.cells import MISSING, Cell, Table, median, number, share, tabulate
from cgroup.benchmark.report.charts import PageChart, estimate_with_intervals
from cgroup.benchmark.report.pictures import PictureBook
from cgroup.plots.experiments import pipelines_chart

if TYPE_CHECKING:  # slow to load
    import pandas as pd

STAGES = {
    "features": (
        *("features", "size", "voxels", "normals", "frames", "descriptors", "surface"),
        *("resolution", "keypoints"),
    ),
    "matching": ("matching",),
    "pose": ("pose", "grouping"),
    "verification": ("verification",),
    "refinement": ("refinement",),
}
"""Columns of times, and the last words of the stages in each."""

_ELLIPSOID = 12.59
"""95th percentile of chi-squared with 6 degrees of freedom."""

_BY = {"method": "pipeline"}
_BY_SET = {"set": "set", "method": "pipeline"}


class RegistrationSection(NamedTuple):
    """Chart and tables that compare pipelines."""

    chart: PageChart
    answers: Table
    trust: Table
    calibration: Table
    details: Table


def make_registration_section(frame: pd.DataFrame, pictures: PictureBook) -> RegistrationSection | None:
    """Make the section; None without results on related pairs."""
    if frame.empty or not (frame["kind"] == "related").any():
        return None
    good = frame[frame["error"] == ""]
    related = good[good["kind"] == "related"]
    counts = related.drop_duplicates(["set", "dataset", "pair"]).groupby("set", sort=False).size()
    title = ", ".join(f"{name} ({count})" for name, count in counts.items())
    chart = pipelines_chart(good, estimate_with_intervals)
    shares = related.groupby("method")["right"].mean()
    alt = (
        f"Share of correct poses of {len(shares)} pipelines by overlap, by reported probability, and over "
        f"time; over all pairs {shares.idxmax()} has the most, {shares.max():.2f}."
    )
    file = pictures.save("registration", chart.draw(f"Registered pairs: {title}"))
    return RegistrationSection(
        PageChart(file, alt, chart, (file,)),
        answer_table(related),
        trust_table(good),
        calibration_table(good),
        detail_table(related),
    )


def answer_table(related: pd.DataFrame) -> Table:
    """Tabulate the numbers of correct and of accurate poses."""
    names = [
        column
        for name in dict.fromkeys(related["set"])
        # The side with more overlap comes first.
        for column in sorted(related[related["set"] == name]["column"].unique(), reverse=True)
    ]
    sizes = related.drop_duplicates(["column", "dataset", "pair"]).groupby("column").size()

    def count(rows: pd.DataFrame, name: str) -> Cell:
        chosen = rows[rows["column"] == name]
        if chosen.empty:
            return Cell(MISSING, -1.0)
        right = int(chosen["right"].sum())
        return Cell(f"{right} / {int((chosen['right'] & chosen['accurate']).sum())}", float(right))

    columns = {f"{name} ({sizes[name]})": lambda rows, name=name: count(rows, name) for name in names}
    return tabulate("Correct poses / accurate poses", related, _BY, columns, best=True)


def trust_table(frame: pd.DataFrame) -> Table:
    """Tabulate seconds, and the accepted poses."""

    def related(rows: pd.DataFrame) -> pd.DataFrame:
        return rows[rows["kind"] == "related"]

    def seconds(rows: pd.DataFrame, name: str) -> Cell:
        chosen = related(rows)
        return number(float(chosen[chosen["set"] == name]["seconds"].median()), "{:.2f}")

    columns = {
        **{f"s, {name}": lambda rows, name=name: seconds(rows, name) for name in dict.fromkeys(frame["set"])},
        "right refused": lambda rows: share(~related(rows[rows["right"]])["ok"]),
        "wrong accepted": lambda rows: share(related(rows[~rows["right"]])["ok"]),
        "mirrored accepted": lambda rows: share(rows[rows["kind"] == "mirrored"]["ok"]),
        "unrelated accepted": lambda rows: share(rows[rows["kind"] == "mixed"]["ok"]),
    }
    return tabulate("Median seconds per pair, and accepted poses", frame, _BY, columns)


def calibration_table(frame: pd.DataFrame) -> Table:
    """Tabulate accepted poses and the calibration of the probabilities by set.

    The calibration error is the mean distance between probability and share of correct poses over ten classes
    of probability, weighted by their pairs. NEES is the squared error of accepted correct poses normalized by
    their covariance: 6 on average and below 12.6 for 95 of 100 if the covariance is right.
    """

    def calibration(rows: pd.DataFrame) -> Cell:
        chance = rows["probability"]
        classes = (rows["right"] - chance).groupby((10 * chance).clip(0, 9).astype(int))
        return number(float(classes.sum().abs().sum()) / len(rows), "{:.3f}")

    def nees(rows: pd.DataFrame) -> pd.Series:
        return rows[rows["right"] & rows["ok"]]["nees"].dropna()

    columns = {
        "right accepted": lambda rows: share(rows[rows["right"]]["ok"]),
        "wrong accepted": lambda rows: share(rows[~rows["right"]]["ok"]),
        "Brier score": lambda rows: number(float(((rows["right"] - rows["probability"]) ** 2).mean())),
        "calibration error": calibration,
        "NEES": lambda rows: number(float(nees(rows).mean()), "{:.1f}"),
        "in the 95 % ellipsoid": lambda rows: share(nees(rows) < _ELLIPSOID),
    }
    known = frame[frame["probability"].notna()].astype({"right": bool})
    caption = "Calibration of the probabilities, unrelated and mirrored pairs included"
    return tabulate(caption, known, _BY_SET, columns)


def detail_table(related: pd.DataFrame) -> Table:
    """Tabulate errors and times."""

    def stage_median(rows: pd.DataFrame, stage: str) -> Cell:
        """Return the median of the summed seconds of the stages in a column."""
        endings = STAGES[stage]
        times = [
            [seconds for name, seconds in of_pair.items() if name.endswith(endings)]
            for of_pair in rows["stages"]
        ]
        return number(1e3 * float(np.median([sum(each) for each in times])) if any(times) else None, "{:.0f}")

    def right(rows: pd.DataFrame) -> pd.DataFrame:
        return rows[rows["right"]].assign(shift=lambda chosen: chosen["translation_error"] / chosen["voxel"])

    columns = {
        "right": lambda rows: number(len(right(rows)), "{:.0f}"),
        "rotation (degrees)": lambda rows: median("rotation_error", "{:.2f}")(right(rows)),
        "translation (voxels)": lambda rows: median("shift", "{:.2f}")(right(rows)),
        **{f"{stage} (ms)": lambda rows, stage=stage: stage_median(rows, stage) for stage in STAGES},
        "total (ms)": median("seconds", "{:.0f}", 1e3),
    }
    return tabulate("Median errors of correct poses, and median times of all", related, _BY_SET, columns)
