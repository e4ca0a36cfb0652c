"""What the page shows of ways to register: a figure, and tables of answers, of trust, of errors and times."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from cgroup.benchmark.report.cells import MISSING, Cell, Table, number, words
from cgroup.benchmark.report.charts import PageChart, estimate_with_intervals
from cgroup.plots.experiments import pipelines_chart

if TYPE_CHECKING:
    import pandas as pd

    from cgroup.benchmark.report.pictures import PictureBook

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
"""Columns of times, with the last words of the stages that count to each."""

_ELLIPSOID = 12.59
"""95th percentile of chi-squared with 6 degrees of freedom."""


@dataclass(frozen=True)
class RegistrationSection:
    """Pipelines compared.

    Attributes
    ----------
    chart : PageChart
        Shares of right poses.
    answers, trust, calibration, details : Table
        How many poses are right; which are trusted, and how long they take; how well probabilities fit;
        errors and times by stage.
    """

    chart: PageChart
    answers: Table
    trust: Table
    calibration: Table
    details: Table


def make_registration_section(frame: pd.DataFrame, pictures: PictureBook) -> RegistrationSection | None:
    """Make the section of `load_registrations`; None where there are no records of related pairs."""
    if frame.empty or not (frame["kind"] == "related").any():
        return None
    good = frame[frame["error"] == ""]
    related = good[good["kind"] == "related"]
    counts = related.drop_duplicates(["set", "dataset", "pair"]).groupby("set", sort=False).size()
    title = ", ".join(f"{name} ({count})" for name, count in counts.items())
    chart = pipelines_chart(good, estimate_with_intervals)
    shares = related.groupby("pipeline")["right"].mean()
    alt = (
        f"Share of right poses of {len(shares)} pipelines by overlap, by the probability that they tell, and "
        f"over the time they take; over all pairs {shares.idxmax()} has the most, {shares.max():.2f}."
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
    """List how many poses are right, and how many accurate."""
    columns = [
        column
        for name in dict.fromkeys(related["set"])
        # The side with more overlap comes first.
        for column in sorted(related[related["set"] == name]["column"].unique(), reverse=True)
    ]
    sizes = related.drop_duplicates(["column", "dataset", "pair"]).groupby("column").size()
    rows: list[tuple[Cell, ...]] = []
    for name in dict.fromkeys(related["pipeline"]):
        mine = related[related["pipeline"] == name]
        rows.append((words(name), *(_count_right(mine[mine["column"] == column]) for column in columns)))
    headers = ("pipeline", *(f"{column} ({sizes[column]})" for column in columns))
    return Table("Right poses / accurate poses", headers, _mark_best(rows))


def trust_table(frame: pd.DataFrame) -> Table:
    """List how long pipelines take, and which of their poses they trust."""
    sets = list(dict.fromkeys(frame["set"]))
    rows: list[tuple[Cell, ...]] = []
    for name in dict.fromkeys(frame["pipeline"]):
        chosen = frame[frame["pipeline"] == name]
        mine = chosen[chosen["kind"] == "related"]
        rows.append(
            (
                words(name),
                *(number(float(mine[mine["set"] == each]["seconds"].median()), "{:.2f}") for each in sets),
                _share(~mine[mine["right"]]["ok"]),
                _share(mine[~mine["right"]]["ok"]),
                *(_share(chosen[chosen["kind"] == kind]["ok"]) for kind in ("mirrored", "mixed")),
            )
        )
    headers = (
        *("pipeline", *(f"s, {each}" for each in sets)),
        *("right refused", "wrong accepted", "mirrored accepted", "unrelated accepted"),
    )
    return Table("Median seconds per pair, and what is trusted", headers, rows)


def calibration_table(frame: pd.DataFrame) -> Table:
    """List by set what is accepted, and how well the probabilities fit.

    The calibration error is the distance between the mean probability and the share that is right, on average
    over ten classes of probability, weighted by their pairs. Errors of the accepted right poses, squared and
    normalized by their covariance (NEES), is 6 on average where that holds, and below 12.6 in 95 of 100.
    """
    rows: list[tuple[Cell, ...]] = []
    told = frame[frame["probability"].notna()]
    for (name, pipeline), chosen in told.groupby(["set", "pipeline"], sort=False):
        right, chance = chosen["right"].astype(float), chosen["probability"]
        classes = (right - chance).groupby((10 * chance).clip(0, 9).astype(int))
        error = float(classes.sum().abs().sum()) / len(chosen)
        nees = chosen[chosen["right"] & chosen["ok"]]["nees"].dropna()
        rows.append(
            (
                words(name),
                words(pipeline),
                _share(chosen[chosen["right"]]["ok"]),
                _share(chosen[~chosen["right"]]["ok"]),
                number(float(((right - chance) ** 2).mean()), "{:.3f}"),
                number(error, "{:.3f}"),
                number(float(nees.mean()), "{:.1f}"),
                _share(nees < _ELLIPSOID),
            )
        )
    headers = (
        *("set", "pipeline", "right accepted", "wrong accepted", "Brier score", "calibration error"),
        *("NEES", "in the 95 % ellipsoid"),
    )
    return Table("How far probabilities can be trusted, unrelated and mirrored pairs included", headers, rows)


def detail_table(related: pd.DataFrame) -> Table:
    """List errors and times."""
    rows: list[tuple[Cell, ...]] = []
    for (name, pipeline), chosen in related.groupby(["set", "pipeline"], sort=False):
        right = chosen[chosen["right"]]
        rows.append(
            (
                words(name),
                words(pipeline),
                number(len(right), "{:.0f}"),
                number(float(right["rotation_error"].median()), "{:.2f}"),
                number(float((right["translation_error"] / right["voxel"]).median()), "{:.2f}"),
                *(number(1e3 * _stage_median(chosen, stage), "{:.0f}") for stage in STAGES),
                number(1e3 * float(chosen["seconds"].median()), "{:.0f}"),
            )
        )
    headers = (
        *("set", "pipeline", "right", "rotation (degrees)", "translation (voxels)"),
        *(f"{stage} (ms)" for stage in STAGES),
        "total (ms)",
    )
    caption = "Median errors of right poses, and median times of all"
    return Table(caption, headers, rows)


def _stage_median(rows: pd.DataFrame, stage: str) -> float:
    """Median over pairs of the seconds of the stages that a column stands for; NaN if there are none."""
    endings = STAGES[stage]
    times = rows["stages"].map(lambda of_pair: [s for name, s in of_pair.items() if name.endswith(endings)])
    return float(times.map(sum).median()) if times.map(len).any() else float("nan")


def _count_right(rows: pd.DataFrame) -> Cell:
    if rows.empty:
        return Cell(MISSING, -1.0)
    right = int(rows["right"].sum())
    return Cell(f"{right} / {int((rows['right'] & rows['accurate']).sum())}", float(right))


def _share(flags: pd.Series) -> Cell:
    """Cell of how many of how many."""
    if flags.empty:
        return Cell(MISSING, -1.0)
    return Cell(f"{int(flags.sum())} of {len(flags)}", float(flags.mean()))


def _mark_best(rows: list[tuple[Cell, ...]]) -> list[tuple[Cell, ...]]:
    """Mark the highest count of each column but the first."""
    best = [max(cell.key for cell in column) for column in zip(*(row[1:] for row in rows), strict=True)]
    return [
        (row[0], *(cell._replace(best=cell.key == most) for cell, most in zip(row[1:], best, strict=True)))
        for row in rows
    ]
