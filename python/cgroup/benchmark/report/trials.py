"""What the page shows of grouping methods on matches of any kind: per set a ranking, costs, and failures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from cgroup.benchmark.problem import COMBINATIONS
from cgroup.benchmark.report.cells import Table, method_cell
from cgroup.benchmark.report.charts import PageChart, estimate_with_intervals
from cgroup.benchmark.report.trial_tables import (
    cost_table,
    failure_table,
    level_table,
    ranking,
    with_fewest_threads,
)
from cgroup.benchmark.stats import comparable
from cgroup.plots.experiments import protocol_title, trials_chart

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd

    from cgroup.benchmark.report.pictures import PictureBook


@dataclass(frozen=True)
class TrialSection:
    """Methods compared on one set of problems.

    Attributes
    ----------
    title, label : str
        Name of the set, and all that its numbers depend on.
    chart : PageChart or None
        Registered problems beside time; None without problems that have an answer.
    ranking, costs, failures : Table
        How good the methods are; what they cost; why problems aren't registered, and what is claimed of
        clouds that share nothing.
    levels : Table or None
        F by what a grid varies, or registered pairs by overlap.
    """

    title: str
    label: str
    chart: PageChart | None
    ranking: Table
    costs: Table
    failures: Table
    levels: Table | None


def make_trial_sections(
    frame: pd.DataFrame, machines: pd.DataFrame, pictures: PictureBook | None
) -> list[TrialSection]:
    """Make a section of each set in `load_trials`; without pictures if there is no book for them."""
    if frame.empty:
        return []
    return [
        _make_section(str(name), rows, machines, pictures) for name, rows in frame.groupby("set", sort=False)
    ]


def _make_section(
    name: str, rows: pd.DataFrame, machines: pd.DataFrame, pictures: PictureBook | None
) -> TrialSection:
    first = with_fewest_threads(rows)
    related = comparable(first)
    label = describe_set(rows, machines)
    chart = None
    if pictures is not None and len(related):
        drawn = trials_chart(related, pictures.styles, estimate_with_intervals)
        shares = related.groupby("method")["right"].mean()
        alt = (
            f"Share of registered problems of {len(shares)} methods over their median time; "
            f"{method_cell(shares.idxmax()).text} has the most, {shares.max():.2f}."
        )
        anchor = "".join(c if c.isalnum() else "-" for c in name).lower()
        figure = drawn.draw(f"{name}: registered problems over time", columns=2)
        file = pictures.save(f"trials-{anchor}", figure)
        chart = PageChart(file, alt, drawn, (file,))
    return TrialSection(
        name, label, chart, ranking(first), cost_table(rows), failure_table(first), level_table(related)
    )


def as_markdown(overview: Table, sections: Sequence[TrialSection]) -> str:
    """Write an overview and sections as Markdown: what they are about, and their tables."""
    parts = ["## All sets", _table_as_markdown(overview)]
    for section in sections:
        parts += [f"## {section.title}", section.label]
        tables = (section.ranking, section.levels, section.costs, section.failures)
        parts += [_table_as_markdown(table) for table in tables if table is not None]
    return "\n\n".join(parts) + "\n"


def _table_as_markdown(table: Table) -> str:
    rows = [table.headers, tuple("---" for _ in table.headers)]
    rows += [tuple(f"**{cell.text}**" if cell.best else cell.text for cell in row) for row in table.rows]
    return "\n".join([f"{table.caption}:", "", *(f"| {' | '.join(row)} |" for row in rows)])


def describe_set(rows: pd.DataFrame, machines: pd.DataFrame) -> str:
    """Say all that the numbers of a set depend on."""
    problems = rows.drop_duplicates("case")
    related = problems[problems["kind"] == "related"]
    known = rows.iloc[0]
    whole = known["whole"]
    part = f" of the {whole:,.0f} of the test set" if whole and len(related) < whole else ""
    within = f"{known['epsilon']:g} times the resolution"
    if len(set(related["resolution"].round(12))) == 1:
        within += f" ({known['epsilon'] * known['resolution']:g} in the data's unit)"
    cpu = ", ".join(machines.loc[machines["id"].isin(rows["machine"]), "cpu"])
    return (
        f"{', '.join(dict.fromkeys(rows['dataset']))}: {len(related):,} problems{part}, "
        f"{_name_matches(rows)}; mean n {related['n'].mean():,.0f}, mean share of right matches "
        f"{related['inlier_ratio'].mean():.3g} within {within}; "
        f"registered by {protocol_title(known['loose'])}, "
        f"accurate by {protocol_title(known['strict'])}; preset {known['preset']}; {cpu}."
    )


def _name_matches(rows: pd.DataFrame) -> str:
    voxels = (
        "voxels chosen per pair" if rows["voxel"].isna().all() else f"voxels of {rows['voxel'].iloc[0]:g}"
    )
    kinds = dict.fromkeys(rows["matches"])
    return ", ".join(
        "ready-made matches"
        if not kind
        else "+".join(COMBINATIONS[kind]).upper()
        if kind in COMBINATIONS
        else f"FPFH {kind}, {voxels}"
        for kind in kinds
    )
