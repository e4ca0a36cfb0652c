"""Tables of grouping methods on matches of any kind: rankings, levels, costs, and failures."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

from cgroup.benchmark.report.cells import MISSING, Cell, Table, method_cell, number, words
from cgroup.benchmark.stats import LEVEL, comparable, rank_methods

if TYPE_CHECKING:
    from collections.abc import Hashable

    import pandas as pd

    from cgroup.benchmark.stats import Interval

_VARIED = {
    "scene": "wrong matches",
    "frames": "frames",
    "noise": "noise (pr)",
    "inliers": "share of right ones",
    "size": "matches",
}
"""What a grid may vary, with names for people; the first that does is spread over columns."""

_OVERLAPS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
"""Pairs are sorted into these classes of overlap."""


def overview_table(frame: pd.DataFrame) -> Table:
    """List what share of the problems of each set every method registers, and its mean F."""
    ranks = {
        str(name): {rank.method: rank for rank in rank_methods(with_fewest_threads(rows))}
        for name, rows in frame.groupby("set", sort=False)
    }
    ranks = {name: of_set for name, of_set in ranks.items() if of_set}
    lines: list[tuple[Cell, ...]] = []
    for method in dict.fromkeys(frame["method"]):
        found = [of_set.get(method) for of_set in ranks.values()]
        lines.append(
            (
                method_cell(method),
                *(
                    Cell(
                        f"{rank.registered.mean:.2f} / {rank.f_score.mean:.2f}",
                        rank.registered.mean,
                        rank.registered_tied,
                    )
                    if rank
                    else Cell(MISSING, -math.inf)
                    for rank in found
                ),
            )
        )
    return Table("Share of registered problems / mean F", ("method", *ranks), lines)


def ranking(rows: pd.DataFrame) -> Table:
    """Rank the methods of a set, with intervals and what can't be told from the first."""
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
                "F, registered"
                if rank.f_tied and rank.registered_tied
                else _tie(rank.f_tied, rank.registered_tied)
            ),
        )
        for place, rank in enumerate(rank_methods(rows), start=1)
    ]
    headers = ("rank", "method", "F", "P", "R", "registered", "accurate", "P > 0.1", "tied with the first in")
    caption = f"Ranking by F, with {LEVEL:.0%} intervals (bootstrap over problems; ties: paired tests, Holm)"
    return Table(caption, headers, lines)


def cost_table(rows: pd.DataFrame) -> Table:
    """List time, memory, and what wasn't run to its end."""
    threads = sorted(rows["threads"].unique(), key=lambda count: count or math.inf)
    lines: list[tuple[Cell, ...]] = []
    for method, mine in rows.groupby("method", sort=False):
        first = with_fewest_threads(mine)
        by_threads = {count: mine.loc[mine["threads"] == count, "seconds"] for count in threads}
        lines.append(
            (
                method_cell(str(method)),
                *(_milliseconds(seconds.median()) for seconds in by_threads.values()),
                _milliseconds(first["seconds"].max()),
                number(first["mebibytes"].median(), "{:.1f}"),
                number(first["mebibytes"].max(), "{:.0f}"),
                number((~first["complete"]).sum(), "{:.0f}"),
                number(first["skipped"].str.contains("longer").sum(), "{:.0f}"),
                number((first["error"] != "").sum(), "{:.0f}"),
                words("; ".join(sorted({why for why in first["skipped"] if why.startswith("needs")}))),
            )
        )
    names = [
        "all cores" if count == 0 else "1 thread" if count == 1 else f"{count} threads" for count in threads
    ]
    headers = (
        *("method", *(f"median ms, {name}" for name in names), "longest ms"),
        *("median MiB", "most MiB", "cut short", "given up", "failed", "not run"),
    )
    return Table("Time and peak memory per call, and calls that didn't end", headers, lines)


def failure_table(rows: pd.DataFrame) -> Table:
    """List why problems aren't registered, how good the registered ones are, and unrelated ones accepted."""
    usable = comparable(rows)
    unrelated = rows[rows["kind"] != "related"]
    lines: list[tuple[Cell, ...]] = []
    for method, mine in usable.groupby("method", sort=False):
        right, nothing = mine[mine["right"]], unrelated[unrelated["method"] == method]
        says = mine["ok"].notna().any()
        lines.append(
            (
                method_cell(str(method)),
                number(mine["right"].mean()),
                number((~mine["right"] & mine["best_right"]).mean()),
                number((~mine["right"] & ~mine["best_right"]).mean()),
                number(mine["offered"].mean(), "{:.1f}"),
                number(right["rotation_error"].mean(), "{:.2f}"),
                number(right["translation_error"].mean(), "{:.3g}"),
                number(right["rmse_pr"].mean(), "{:.2f}"),
                number((right["ok"] == False).mean() if says else math.nan),  # noqa: E712 - of three values
                number((nothing["ok"] == True).mean() if says else math.nan),  # noqa: E712
                number(nothing["posed"].mean()),
            )
        )
    headers = (
        *("method", "registered", "right pose offered, not chosen", "no right pose offered", "poses offered"),
        *("rotation (degrees)", "translation (unit)", "displacement (pr)", "right refused"),
        *("unrelated accepted", "unrelated answered"),
    )
    return Table(
        "Why not, how accurate (means over the registered), and answers where there is none", headers, lines
    )


def level_table(related: pd.DataFrame) -> Table | None:
    """List mean F by what a grid varies, or the registered by overlap; None where neither is known."""
    if related["scene"].notna().all() and len(related):
        varied = [name for name in _VARIED if len(set(related[name])) > 1]
        return _spread(related, varied[0], varied[1:]) if varied else None
    if related["overlap"].notna().any():
        return _by_overlap(related)
    return None


def _spread(related: pd.DataFrame, column: str, others: list[str]) -> Table:
    """Spread mean F over the values of one column, the first of all that vary."""
    values = dict.fromkeys(related[column])
    levels = list(values) if column in {"scene", "frames"} else sorted(values)
    lines: list[tuple[Cell, ...]] = []
    able = related[~related["skipped"].str.startswith("needs ")]
    for key, mine in able.groupby(["method", *others], sort=False):
        method, *where = key
        means = mine.groupby(column)["f_score"].mean()
        shares = (number(means.get(level, math.nan), "{:.2f}") for level in levels)
        lines.append((method_cell(method), *map(_level_cell, where), *shares))
    headers = ("method", *(_VARIED[name] for name in others), *map(_name_level, levels))
    return Table(f"Mean F by {_VARIED[column]}", headers, lines)


def _by_overlap(related: pd.DataFrame) -> Table:
    classes = {
        f"{low:g} to {high:g}": related["overlap"].between(low, high, "both" if high == 1 else "left")
        for low, high in itertools.pairwise(_OVERLAPS)
    }
    classes = {name: chosen for name, chosen in classes.items() if chosen.any()}
    lines = [
        (
            method_cell(str(method)),
            *(number(mine.loc[chosen[mine.index], "right"].mean(), "{:.2f}") for chosen in classes.values()),
        )
        for method, mine in related.groupby("method", sort=False)
    ]
    counts = (related.loc[chosen, "case"].nunique() for chosen in classes.values())
    headers = (f"{name} ({count})" for name, count in zip(classes, counts, strict=True))
    return Table("Share of registered pairs by overlap", ("method", *headers), lines)


def with_fewest_threads(rows: pd.DataFrame) -> pd.DataFrame:
    """Keep the rows of the fewest threads, 1 if it is there; 0 stands for all cores."""
    counts = rows["threads"].unique()
    return rows[rows["threads"] == min(counts, key=lambda count: count or math.inf)]


def _tie(f_tied: bool, registered_tied: bool) -> str:  # noqa: FBT001 - two of a kind
    return "F" if f_tied else "registered" if registered_tied else MISSING


def _show(interval: Interval, *, best: bool) -> Cell:
    mean, low, high = interval
    return Cell(f"{mean:.3f} [{low:.2f}, {high:.2f}]", mean, best)


def _milliseconds(seconds: float) -> Cell:
    value = 1e3 * seconds
    return number(value, "{:,.0f}" if value >= 100 else "{:.3g}")


def _level_cell(value: Hashable) -> Cell:
    return Cell(_name_level(value), float(value) if isinstance(value, (int, float)) else str(value))


def _name_level(value: object) -> str:
    return f"{value:,g}" if isinstance(value, (int, float)) else str(value)
