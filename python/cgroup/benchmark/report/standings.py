"""Report section with the ranking of methods over all pairs."""

import pandas as pd

from cgroup.benchmark.paper import PAPER_EPSILON
from cgroup.benchmark.report.cells import MISSING, Cell, Table, method_cell
from cgroup.benchmark.report.charts import Section
from cgroup.benchmark.stats import GENERATED, LEVEL, Overall, Standing, rank_overall
from cgroup.evaluation.bins import LEAST_PAIRS
from cgroup.plots.style import method_style

_NAMES = {"f_score": "mean F", "registered": "registered"}


def make_standings(frame: pd.DataFrame) -> list[Section]:
    """Rank methods on the experiments at the paper's threshold, without cases that failed for all."""
    if frame.empty:
        return []
    rows = frame[(frame["epsilon"] - PAPER_EPSILON).abs() < 1e-9]
    rows = rows[rows["case"].isin(rows.loc[rows["error"] == "", "case"])]
    return [
        Section(f"{overall.kind} pairs".capitalize(), [_rank(overall)], label=_describe(overall))
        for overall in rank_overall(rows, tuple(_NAMES))
    ]


def _describe(overall: Overall) -> str:
    """Return the number of pairs, and the kinds of intervals and tests, in sentences."""
    count = sum(overall.pairs.values())
    data = ", ".join(f"{name} {pairs}" for name, pairs in overall.pairs.items())
    parts = [f"Means over {count} pairs ({data}), each with the mean of its cases, {overall.cases:,} in all."]
    if overall.further_cases:
        parts.append(f"{overall.further_cases:,} further cases were not run by all and are left out.")
    if overall.kind == GENERATED:
        parts.append("Results on generated shapes are a weak guide to real ones.")
    if _has_intervals(overall):
        parts += [
            f"Bars are {100 * LEVEL:.0f} % intervals of the mean (bootstrap over pairs, by data set).",
            "Bold: not significantly different from the first of the column at 5 %. p is of the difference",
            "from the first, by paired tests on the same pairs (Wilcoxon's signed ranks; McNemar's where a",
            "pair is registered or not), adjusted by Holm.",
        ]
    else:
        parts.append(f"No intervals and tests, which need at least {LEAST_PAIRS} pairs.")
    if overall.unranked:
        names = ", ".join(f"{method_style(name).label} ({n})" for name, n in overall.unranked.items())
        parts.append(f"Not ranked, because run on fewer than half of the cases: {names}.")
    return " ".join(parts)


def _has_intervals(overall: Overall) -> bool:
    return overall.units >= LEAST_PAIRS


def _rank(overall: Overall) -> Table:
    certain = _has_intervals(overall)
    lines: list[tuple[Cell, ...]] = []
    for place, method in enumerate(overall.methods, start=1):
        cells = [cell for of in overall.standings.values() for cell in _show(of, method, certain=certain)]
        lines.append((Cell(str(place), float(place)), method_cell(method), *cells))
    names = [_NAMES[measure] for measure in overall.standings]
    headers = [header for name in names for header in ((name, "p") if certain else (name,))]
    return Table(f"Ranking by {names[0]}", ("rank", "method", *headers), lines)


def _show(standings: dict[str, Standing], method: str, *, certain: bool) -> tuple[Cell, ...]:
    """Return the cells of a mean, and of the p of its difference from the highest."""
    (mean, low, high), p, tied = standings[method]
    if not certain:
        return (Cell(f"{mean:.3f}", mean),)
    text = f"{mean:.3f} [{low:.2f}, {high:.2f}]"
    highest = mean == max(each.interval.mean for each in standings.values())
    return (
        Cell(text, mean, best=tied, interval=(mean, low, high)),
        Cell(MISSING if highest else "< 0.001" if p < 0.001 else f"{p:.3f}", p),
    )
