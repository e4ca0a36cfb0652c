"""Section of the report that ranks methods over all pairs, and compares them with each other."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from cgroup.benchmark.paper import PAPER_EPSILON
from cgroup.benchmark.report.cells import MISSING, Cell, Table, method_cell
from cgroup.benchmark.report.trials import with_fewest_threads
from cgroup.benchmark.stats import GENERATED, LEAST_OBJECTS, LEVEL, Overall, Standing, rank_overall
from cgroup.evaluation.bins import LEAST_PAIRS
from cgroup.plots.style import method_style

if TYPE_CHECKING:  # slow to load
    import pandas as pd

_NAMES = {"f_score": "mean F", "registered": "registered", "right": "registered"}


class StandingsSection(NamedTuple):
    """Ranking over all pairs of a kind, one row per method, and the differences of every two methods."""

    title: str
    label: str
    ranking: Table
    differences: Table


def make_standings(
    frame: pd.DataFrame, trials: pd.DataFrame, registrations: pd.DataFrame
) -> list[StandingsSection]:
    """Rank methods on experiments, methods on matches, and pipelines."""
    kinds = {
        "methods": rank_overall(*_pick_cases(frame)),
        "methods on matches": rank_overall(*_pick_trials(trials)),
        "pipelines": rank_overall(*_pick_registrations(registrations)),
    }
    several = sum(map(bool, kinds.values())) > 1
    return [
        _make_section(what, overall, named=several) for what, ranked in kinds.items() for overall in ranked
    ]


def _pick_cases(frame: pd.DataFrame) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Return rows at the paper's threshold, without cases that failed for every method."""
    measures = ("f_score", "registered")
    if frame.empty:
        return frame, measures
    rows = frame[(frame["epsilon"] - PAPER_EPSILON).abs() < 1e-9]
    return rows[rows["case"].isin(rows.loc[rows["error"] == "", "case"])], measures


def _pick_trials(trials: pd.DataFrame) -> tuple[pd.DataFrame, tuple[str, ...]]:
    measures = ("f_score", "right")
    if trials.empty:
        return trials, measures
    rows = with_fewest_threads(trials[trials["kind"] == "related"])
    return rows[~rows["skipped"].str.startswith("needs ")], measures


def _pick_registrations(registrations: pd.DataFrame) -> tuple[pd.DataFrame, tuple[str, ...]]:
    if registrations.empty:
        return registrations, ("right",)
    rows = registrations[registrations["kind"] == "related"]
    case = rows["set"] + "/" + rows["dataset"] + "/" + rows["pair"]
    return rows.assign(case=case), ("right",)


def _make_section(what: str, overall: Overall, *, named: bool) -> StandingsSection:
    pairs = f"{overall.kind} pairs"
    title = f"{what}: {pairs}" if named else pairs
    noun = "pipeline" if what == "pipelines" else "method"
    ranking, differences = _rank(overall, noun), _compare(overall, noun)
    return StandingsSection(title[0].upper() + title[1:], _describe(overall), ranking, differences)


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
    if overall.by_object:
        parts.append(
            f"Pairs of one object or room are drawn and tested together in {', '.join(overall.by_object)},"
            f" which have {LEAST_OBJECTS} or more."
        )
    if overall.unranked:
        names = ", ".join(f"{method_style(name).label} ({n})" for name, n in overall.unranked.items())
        parts.append(f"Not ranked, because run on fewer than half of the cases: {names}.")
    return " ".join(parts)


def _has_intervals(overall: Overall) -> bool:
    return overall.units >= LEAST_PAIRS


def _rank(overall: Overall, noun: str) -> Table:
    certain = _has_intervals(overall)
    lines: list[tuple[Cell, ...]] = []
    for place, method in enumerate(overall.methods, start=1):
        cells = [cell for of in overall.standings.values() for cell in _show(of, method, certain=certain)]
        lines.append((Cell(str(place), float(place)), method_cell(method), *cells))
    names = [_NAMES[measure] for measure in overall.standings]
    headers = [header for name in names for header in ((name, "p") if certain else (name,))]
    return Table(f"Ranking by {names[0]}", ("rank", noun, *headers), lines)


def _show(standings: dict[str, Standing], method: str, *, certain: bool) -> tuple[Cell, ...]:
    """Return the cells of a mean, and of the p of its difference from the highest."""
    (mean, low, high), p, tied = standings[method]
    if not certain:
        return (Cell(f"{mean:.3f}", mean),)
    text = f"{mean:.3f} [{low:.2f}, {high:.2f}]"
    highest = mean == max(each.interval.mean for each in standings.values())
    return (
        Cell(text, mean, best=tied, interval=(mean, low, high)),
        Cell(MISSING if highest else _show_p(p), p),
    )


def _show_p(p: float) -> str:
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def _compare(overall: Overall, noun: str) -> Table:
    measure = next(iter(overall.standings))
    means = {method: standing.interval.mean for method, standing in overall.standings[measure].items()}
    certain = _has_intervals(overall)
    lines = [
        (
            method_cell(one),
            *(
                Cell(MISSING, 0.0)
                if one == other
                else Cell(
                    f"{means[one] - means[other]:+.3f}",
                    means[one] - means[other],
                    best=certain and overall.p_between[one, other] < 1 - LEVEL,
                )
                for other in overall.methods
            ),
        )
        for one in overall.methods
    ]
    caption = f"Difference in {_NAMES[measure]}, row minus column" + (
        "; bold where p < 0.05 (paired test, adjusted by Holm over all twos)" if certain else ""
    )
    headers = (noun, *(method_cell(other).text for other in overall.methods))
    return Table(caption, headers, lines)
