"""Section of the report on grouping methods run alone on matches: rankings, levels, costs, and failures."""

import itertools
import math
from typing import Any

import pandas as pd

from cgroup.benchmark.problem import COMBINATIONS
from cgroup.benchmark.report.cells import (
    MISSING,
    Cell,
    Table,
    mean,
    method_cell,
    milliseconds,
    number,
    tabulate,
    words,
)
from cgroup.benchmark.report.charts import FigureFiles, Section
from cgroup.benchmark.report.curves import protocol_title, trials_chart
from cgroup.benchmark.stats import LEVEL, Interval, comparable, rank_methods

_BY = {"method": "method"}

_VARIED = {
    "scene": "wrong matches",
    "frames": "frames",
    "noise": "noise (pr)",
    "inliers": "share of correct ones",
    "size": "matches",
}
"""Columns that a grid may vary, with their names; the first that does is spread over columns."""

_OVERLAPS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)  # limits of the classes of overlap


def make_trial_sections(
    frame: pd.DataFrame, machines: pd.DataFrame, figures: FigureFiles | None
) -> list[Section]:
    """Make a section per set; without charts if `figures` is None."""
    if frame.empty:
        return []
    return [
        _make_section(str(name), rows, machines, figures) for name, rows in frame.groupby("set", sort=False)
    ]


def _make_section(
    name: str, rows: pd.DataFrame, machines: pd.DataFrame, figures: FigureFiles | None
) -> Section:
    first = with_fewest_threads(rows)
    related = comparable(first)
    chart = None
    if figures is not None and len(related):
        drawn = trials_chart(related, figures.styles)
        shares = related.groupby("method")["right"].mean()
        alt = (
            f"Share of registered problems of {len(shares)} methods over their median time; "
            f"{method_cell(shares.idxmax()).text} has the most, {shares.max():.2f}."
        )
        anchor = "".join(c if c.isalnum() else "-" for c in name).lower()
        title = f"{name}: registered problems over time"
        chart = figures.draw(f"trials-{anchor}", alt, drawn, title, columns=2)
    tables = (ranking(first), level_table(related), cost_table(rows), failure_table(first))
    shown = [table for table in tables if table is not None and table.rows]
    return Section(name, shown, chart, label=describe_set(rows, machines))


def with_fewest_threads(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the fewest threads; 0 means all cores."""
    counts = rows["threads"].unique()
    return rows[rows["threads"] == min(counts, key=lambda count: count or math.inf)]


def overview_table(frame: pd.DataFrame) -> Table:
    """Tabulate the fraction of registered problems and mean F of every method on every set."""
    ranks = {
        str(name): {rank.method: rank for rank in rank_methods(with_fewest_threads(rows))}
        for name, rows in frame.groupby("set", sort=False)
    }

    def show(rows: pd.DataFrame, name: str) -> Cell:
        rank = ranks[name].get(rows["method"].iloc[0])
        if rank is None:
            return Cell(MISSING, -math.inf)
        text = f"{rank.registered.mean:.2f} / {rank.f_score.mean:.2f}"
        return Cell(text, rank.registered.mean, rank.registered_tied)

    columns = {name: lambda rows, name=name: show(rows, name) for name, of_set in ranks.items() if of_set}
    return tabulate("Share of registered problems / mean F", frame, _BY, columns, name=method_cell)


def ranking(rows: pd.DataFrame) -> Table:
    """Rank the methods of a set, with intervals and ties with the first."""
    means = comparable(rows).groupby("method")[["precision", "recall", "accurate", "registered"]].mean()
    lines = [
        (
            Cell(str(place), float(place)),
            method_cell(rank.method),
            _show(rank.f_score, best=rank.f_tied),
            *(number(means.loc[rank.method, name]) for name in ("precision", "recall")),
            _show(rank.registered, best=rank.registered_tied),
            *(number(means.loc[rank.method, name]) for name in ("accurate", "registered")),
            words(
                ", ".join(itertools.compress(("F", "registered"), (rank.f_tied, rank.registered_tied)))
                or MISSING
            ),
        )
        for place, rank in enumerate(rank_methods(rows), start=1)
    ]
    headers = ("rank", "method", "F", "P", "R", "registered", "accurate", "P > 0.1", "tied with the first in")
    caption = f"Ranking by F, with {LEVEL:.0%} intervals (bootstrap over problems; ties: paired tests, Holm)"
    return Table(caption, headers, lines)


def _show(interval: Interval, *, best: bool) -> Cell:
    middle, low, high = interval
    return Cell(f"{middle:.3f} [{low:.2f}, {high:.2f}]", middle, best)


def cost_table(rows: pd.DataFrame) -> Table:
    """Tabulate time, memory, and calls that did not end."""

    def seconds(mine: pd.DataFrame, threads: int) -> Cell:
        return milliseconds(mine.loc[mine["threads"] == threads, "seconds"].median())

    def count(flags: pd.Series) -> Cell:
        return number(flags.sum(), "{:.0f}")

    def reasons(first: pd.DataFrame) -> Cell:
        return words("; ".join(sorted({why for why in first["skipped"] if why.startswith("needs")})))

    names = {0: "all cores", 1: "1 thread"}
    columns: dict[str, Any] = {}
    for threads in sorted(rows["threads"].unique(), key=lambda count: count or math.inf):
        header = f"median ms, {names.get(threads, f'{threads} threads')}"
        columns[header] = lambda mine, threads=threads: seconds(mine, threads)
    of_fewest = {
        "longest ms": lambda first: milliseconds(first["seconds"].max()),
        "median MiB": lambda first: number(first["mebibytes"].median(), "{:.1f}"),
        "most MiB": lambda first: number(first["mebibytes"].max(), "{:.0f}"),
        "cut short": lambda first: count(~first["complete"]),
        "given up": lambda first: count(first["skipped"].str.contains("longer")),
        "failed": lambda first: count(first["error"] != ""),
        "not run": reasons,
    }
    for header, make in of_fewest.items():
        columns[header] = lambda mine, make=make: make(with_fewest_threads(mine))
    caption = "Time and peak memory per call, and calls that did not end"
    return tabulate(caption, rows, _BY, columns, name=method_cell)


def failure_table(rows: pd.DataFrame) -> Table:
    """Tabulate reasons of failures, errors of the registered problems, and accepted unrelated ones."""
    unrelated = rows[rows["kind"] != "related"]

    def of_right(column: str, text: str) -> Any:  # noqa: ANN401 - makes a cell
        return lambda mine: mean(column, text)(mine[mine["right"]])

    def of_unrelated(mine: pd.DataFrame) -> pd.DataFrame:
        return unrelated[unrelated["method"] == mine["method"].iloc[0]]

    def judged(mine: pd.DataFrame, flags: pd.Series) -> Cell:
        """Return the fraction for methods that judge their answers."""
        return number(flags.mean() if mine["ok"].notna().any() else math.nan)

    columns = {
        "registered": mean("right"),
        "right pose offered, not chosen": lambda mine: number((~mine["right"] & mine["best_right"]).mean()),
        "no right pose offered": lambda mine: number((~mine["right"] & ~mine["best_right"]).mean()),
        "poses offered": mean("offered", "{:.1f}"),
        "rotation (degrees)": of_right("rotation_error", "{:.2f}"),
        "translation (unit)": of_right("translation_error", "{:.3g}"),
        "displacement (pr)": of_right("rmse_pr", "{:.2f}"),
        # `ok` is None for methods that don't judge their answers.
        "right refused": lambda mine: judged(mine, mine[mine["right"]]["ok"] == False),  # noqa: E712
        "unrelated accepted": lambda mine: judged(mine, of_unrelated(mine)["ok"] == True),  # noqa: E712
        "unrelated answered": lambda mine: number(of_unrelated(mine)["posed"].mean()),
    }
    caption = "Reasons of failures, errors (means over the registered), and answers on unrelated clouds"
    return tabulate(caption, comparable(rows), _BY, columns, name=method_cell)


def level_table(related: pd.DataFrame) -> Table | None:
    """Tabulate mean F by the varied parameter of a grid, or registered pairs by overlap; else None."""
    if related["scene"].notna().all() and len(related):
        varied = [name for name in _VARIED if len(set(related[name])) > 1]
        return _spread(related, varied[0], varied[1:]) if varied else None
    if related["overlap"].notna().any():
        return _by_overlap(related)
    return None


def _spread(related: pd.DataFrame, column: str, others: list[str]) -> Table:
    values = dict.fromkeys(related[column])
    levels = list(values) if column in {"scene", "frames"} else sorted(values)
    lines: list[tuple[Cell, ...]] = []
    able = related[~related["skipped"].str.startswith("needs ")]
    for key, mine in able.groupby(["method", *others], sort=False):
        method, *where = key
        means = mine.groupby(column)["f_score"].mean()
        shares = (number(means.get(level, math.nan), "{:.2f}") for level in levels)
        keys = (Cell(_name_level(each), each if isinstance(each, str) else float(each)) for each in where)
        lines.append((method_cell(method), *keys, *shares))
    headers = ("method", *(_VARIED[name] for name in others), *map(_name_level, levels))
    return Table(f"Mean F by {_VARIED[column]}", headers, lines)


def _by_overlap(related: pd.DataFrame) -> Table:
    columns: dict[str, Any] = {}
    for low, high in itertools.pairwise(_OVERLAPS):
        inside = related["overlap"].between(low, high, "both" if high == 1 else "left")
        if inside.any():
            header = f"{low:g} to {high:g} ({related.loc[inside, 'case'].nunique()})"
            columns[header] = lambda rows, inside=inside: mean("right", "{:.2f}")(rows[inside[rows.index]])
    return tabulate("Share of registered pairs by overlap", related, _BY, columns, name=method_cell)


def _name_level(value: object) -> str:
    return f"{value:,g}" if isinstance(value, (int, float)) else str(value)


def describe_set(rows: pd.DataFrame, machines: pd.DataFrame) -> str:
    """Return a sentence with all conditions of the numbers of a set."""
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
        f"{_name_matches(rows)}; mean n {related['n'].mean():,.0f}, mean share of correct matches "
        f"{related['inlier_ratio'].mean():.3g} within {within}; "
        f"registered by {protocol_title(known['loose'])}, "
        f"accurate by {protocol_title(known['strict'])}; preset {known['preset']}; {cpu}."
    )


def _name_matches(rows: pd.DataFrame) -> str:
    chosen = rows["voxel"].isna().all()
    voxels = "voxels chosen per pair" if chosen else f"voxels of {rows['voxel'].iloc[0]:g}"
    names = {"": "ready-made matches"} | {key: "+".join(two).upper() for key, two in COMBINATIONS.items()}
    return ", ".join(names.get(kind, f"FPFH {kind}, {voxels}") for kind in dict.fromkeys(rows["matches"]))
