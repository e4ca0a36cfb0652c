"""What the page shows at its top: methods ranked over all pairs, and who is better than whom."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cgroup.benchmark.overall import GENERATED, LEAST_OBJECTS, LEAST_PAIRS, Overall, Standing, rank_overall
from cgroup.benchmark.paper import PAPER_EPSILON
from cgroup.benchmark.rankings import LEVEL
from cgroup.benchmark.report.cells import MISSING, Cell, Table, method_cell
from cgroup.benchmark.report.trial_tables import with_fewest_threads
from cgroup.plots.style import method_style

if TYPE_CHECKING:
    import pandas as pd

_NAMES = {"f_score": "F", "registered": "registered", "right": "registered"}


@dataclass(frozen=True)
class StandingsSection:
    """A ranking over all pairs of a kind.

    Attributes
    ----------
    title, label : str
        What it is about, and how it was computed.
    ranking : Table
        One row per method.
    differences : Table
        One row and one column per method.
    """

    title: str
    label: str
    ranking: Table
    differences: Table


def make_standings(
    frame: pd.DataFrame, trials: pd.DataFrame, registrations: pd.DataFrame
) -> list[StandingsSection]:
    """Rank what there is: methods on cases, methods on matches, and ways to register.

    Parameters
    ----------
    frame, trials, registrations : DataFrame
        Rows of `load`, `load_trials`, `load_registrations`; each may be empty.

    Returns
    -------
    list of StandingsSection
        Real and semi-synthetic pairs before synthetic ones.
    """
    ranked = [
        *(("methods", each) for each in rank_overall(*_pick_cases(frame))),
        *(("methods on matches", each) for each in rank_overall(*_pick_trials(trials))),
        *(("ways to register", each) for each in rank_overall(*_pick_registrations(registrations))),
    ]
    several = len({what for what, _ in ranked}) > 1
    return [_make_section(what if several else "", overall) for what, overall in ranked]


def _pick_cases(frame: pd.DataFrame) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Records at the paper's threshold; cases that failed for every method are no one's failure."""
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
    return rows.assign(case=case, method=rows["pipeline"]), ("right",)


def _make_section(what: str, overall: Overall) -> StandingsSection:
    prefix = f"{what}, ".capitalize() if what else ""
    kind = f"{overall.kind} pairs"
    title = prefix + kind if prefix else kind.capitalize()
    return StandingsSection(title, _describe(overall), _rank(overall), _compare(overall))


def _describe(overall: Overall) -> str:
    """Say what the means are of, and what is drawn and tested."""
    count = sum(overall.pairs.values())
    data = ", ".join(f"{name} {pairs}" for name, pairs in overall.pairs.items())
    parts = [f"Means over {count} pairs ({data}), each with the mean of its cases, {overall.cases:,} in all."]
    if overall.kind == GENERATED:
        parts.append("These are generated shapes: they show that everything works, not which method is best.")
    if overall.units < LEAST_PAIRS:
        parts.append(f"No intervals: they need at least {LEAST_PAIRS} pairs.")
    else:
        parts.append(
            f"Bars are {100 * LEVEL:.0f} % intervals of the mean (bootstrap over pairs, by data set)."
        )
    if overall.by_object:
        parts.append(
            f"Pairs of one object or room are drawn together in {', '.join(overall.by_object)}, which has"
            f" {LEAST_OBJECTS} or more of them."
        )
    parts.append(
        "Bold: can’t be told from the first of the column at a level of 5 %; p is that of the difference"
        " from that first one, by paired tests on the same pairs (Wilcoxon’s signed ranks; McNemar’s where a"
        " pair is registered or not), adjusted by Holm."
    )
    if overall.unranked:
        names = ", ".join(f"{method_style(name).label} ({n})" for name, n in overall.unranked.items())
        parts.append(f"Not ranked, as run on fewer than half of the cases: {names}.")
    return " ".join(parts)


def _rank(overall: Overall) -> Table:
    certain = overall.units >= LEAST_PAIRS
    lines: list[tuple[Cell, ...]] = []
    for place, method in enumerate(overall.methods, start=1):
        cells = [cell for of in overall.standings.values() for cell in _show(of, method, certain=certain)]
        lines.append((Cell(str(place), float(place)), method_cell(method), *cells))
    headers = [
        header
        for measure in overall.standings
        for header in (f"{'mean F' if measure == 'f_score' else _NAMES[measure]}", f"p ({_NAMES[measure]})")
    ]
    first = _NAMES[next(iter(overall.standings))]
    return Table(f"Ranking by {first}", ("rank", "method", *headers), lines)


def _show(standings: dict[str, Standing], method: str, *, certain: bool) -> tuple[Cell, Cell]:
    """Cells of a mean, and of the p of its difference from the highest."""
    (mean, low, high), p, tied = standings[method]
    if not certain:
        return Cell(f"{mean:.3f}", mean), Cell(MISSING, math.inf)
    text = f"{mean:.3f} [{low:.2f}, {high:.2f}]"
    highest = mean == max(each.interval.mean for each in standings.values())
    return (
        Cell(text, mean, best=tied, interval=(mean, low, high)),
        Cell(MISSING if highest else _show_p(p), p),
    )


def _show_p(p: float) -> str:
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def _compare(overall: Overall) -> Table:
    measure = next(iter(overall.standings))
    means = {method: standing.interval.mean for method, standing in overall.standings[measure].items()}
    certain = overall.units >= LEAST_PAIRS
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
    caption = (
        f"Difference in {_NAMES[measure]}, row minus column; bold where it is more than chance "
        "(paired test, adjusted by Holm over all twos)"
    )
    headers = ("method", *(method_cell(other).text for other in overall.methods))
    return Table(caption, headers, lines)
