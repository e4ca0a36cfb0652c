"""Verdicts under all readings: what the readings of a run leave in its folder."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING

import pandas as pd

from cgroup.benchmark.paper.claims import CLAIMS
from cgroup.benchmark.paper.readings import name_questions, read_questions
from cgroup.io import write_file
from cgroup.io._results import Results
from cgroup.plots.readings import draw_readings

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from cgroup.benchmark.paper.readings import Question, ReadingOutcome

MARKDOWN, CSV, FIGURE = "readings.md", "readings.csv", "readings.png"
"""Names of the files."""

_TITLE = "Claims of the paper by reading"

CLOSE_MARK = "≈"
"""Beside verdicts that another draw of the pairs would often change."""

UNMOVED_MARK = "·"
"""In place of verdicts of which a reading moves no number."""

_MARKS = (
    "*moved*: claims of which a number is another than by default; *better*, *worse*: of which the "
    "verdict is. Bold: such verdicts. "
    f"{CLOSE_MARK}: another draw of the pairs would often give another verdict. "
    f"{UNMOVED_MARK}: no number moves."
)
_TESTED = ("confirmed", "partly", "not confirmed")
_COLUMNS = ("question", "reading", "claim", "verdict", "held", "tests", "share", "close", "moved", "measured")


def write_readings(folder: Path, outcomes: Sequence[ReadingOutcome]) -> list[Path]:
    """Write tables and figure of all readings."""
    questions = read_questions()
    picture = io.BytesIO()
    draw_readings(list_figure_cells(outcomes), title=_TITLE).savefig(picture, format="png")
    contents = {
        MARKDOWN: as_markdown(outcomes, questions).encode(),
        CSV: as_csv(outcomes, questions).encode(),
        FIGURE: picture.getvalue(),
    }
    with Results(folder, "readings").writing() as files:
        for name, content in contents.items():
            write_file(folder / name, content)
    return files


def list_figure_cells(outcomes: Sequence[ReadingOutcome]) -> pd.DataFrame:
    """One row per claim and reading, as the figure takes them."""
    asked = name_questions(read_questions())
    rows = [
        {
            "group": asked.get(outcome.name, ""),
            "reading": outcome.name,
            "claim": claim,
            "verdict": verdict.verdict,
            "close": outcome.is_close(claim),
            "moved": outcome is outcomes[0] or claim in outcome.moved,
        }
        for outcome in outcomes
        for claim, verdict in outcome.verdicts.items()
    ]
    return pd.DataFrame(rows)


def as_markdown(outcomes: Sequence[ReadingOutcome], questions: Iterable[Question]) -> str:
    """Write all tables as Markdown, without questions that have no outcome.

    The counts per reading; the claims that readings bring back, and those that none does; and a table claim
    by reading for each question.
    """
    default, *others = outcomes
    by_name = {outcome.name: outcome for outcome in others}
    parts = ["### Claims per reading", "", *_list_counts(outcomes), "", _MARKS, ""]
    parts += ["### Claims that a reading brings back", "", *_list_gains(default, others), ""]
    parts += ["### Claims that no reading confirms", "", *_list_never(outcomes), ""]
    for question in questions:
        tried = [by_name[reading.name] for reading in question.readings if reading.name in by_name]
        if tried:
            told = f"*What is open:* {question.silent} *Default:* {question.default}."
            parts += [f"### {question.title}", "", told, "", *_list_cells(default, tried), ""]
    return "\n".join(parts)


def as_csv(outcomes: Sequence[ReadingOutcome], questions: Iterable[Question]) -> str:
    """Write one row per claim and reading, with a header."""
    asked = name_questions(questions)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for outcome in outcomes:
        for claim, verdict in outcome.verdicts.items():
            share = "" if verdict.stability is None else f"{verdict.stability.share:.3f}"
            judged = (verdict.verdict, verdict.held, verdict.tests, share, outcome.is_close(claim))
            what = (asked.get(outcome.name, ""), outcome.name, claim)
            writer.writerow((*what, *judged, claim in outcome.moved, verdict.measured))
    return text.getvalue()


def show_cell(outcome: ReadingOutcome, claim: str) -> str:
    """Write a verdict with how many of its tests hold, and whether it is close: ``confirmed 9/9``."""
    verdict = outcome.verdicts[claim]
    mark = f" {CLOSE_MARK}" if outcome.is_close(claim) else ""
    count = f" {verdict.held}/{verdict.tests}" if verdict.tests else ""
    return verdict.verdict + count + mark


def _list_counts(outcomes: Sequence[ReadingOutcome]) -> Iterator[str]:
    yield "| reading | confirmed | partly | not | moved | better | worse |"
    yield "|---|---:|---:|---:|---:|---|---|"
    for outcome in outcomes:
        counts = " | ".join(str(outcome.counts[verdict]) for verdict in _TESTED)
        changed = " | ".join(", ".join(claims) for claims in (outcome.better, outcome.worse))
        name = f"**{outcome.name}** {outcome.label}".strip()
        yield f"| {name} | {counts} | {len(outcome.moved)} | {changed} |"


def _list_gains(default: ReadingOutcome, others: Sequence[ReadingOutcome]) -> Iterator[str]:
    yield "| claim | default | confirmed by | better by |"
    yield "|---|---|---|---|"
    for claim in CLAIMS:
        better = [outcome for outcome in others if claim.id in outcome.better]
        if better:
            whole = [each for each in better if each.verdicts[claim.id].verdict == "confirmed"]
            shown = " | ".join(
                ", ".join(f"{each.name} ({_count(each, claim.id)})" for each in named)
                for named in (whole, [each for each in better if each not in whole])
            )
            yield f"| **{claim.id}** {claim.statement} | {show_cell(default, claim.id)} | {shown} |"


def _list_never(outcomes: Sequence[ReadingOutcome]) -> Iterator[str]:
    yield "| claim | default | most tests hold under |"
    yield "|---|---|---|"
    for claim in CLAIMS:
        verdicts = {outcome.verdicts[claim.id].verdict for outcome in outcomes}
        if "confirmed" not in verdicts and verdicts != {"not testable"}:
            best = max(outcomes, key=lambda outcome: _share(outcome, claim.id))
            shown = f"{best.name}: {show_cell(best, claim.id)}"
            yield f"| **{claim.id}** {claim.statement} | {show_cell(outcomes[0], claim.id)} | {shown} |"


def _list_cells(default: ReadingOutcome, tried: Sequence[ReadingOutcome]) -> Iterator[str]:
    headers = [f"{outcome.name}: {outcome.label}" for outcome in tried]
    yield "| claim | default | " + " | ".join(headers) + " |"
    yield "|---|---|" + "---|" * len(tried)
    for claim in default.verdicts:
        if any(claim in outcome.moved for outcome in tried):
            cells = [_show_change(each, claim) for each in tried]
            yield f"| {claim} | {show_cell(default, claim)} | " + " | ".join(cells) + " |"


def _show_change(outcome: ReadingOutcome, claim: str) -> str:
    if claim not in outcome.moved:
        return UNMOVED_MARK
    cell = show_cell(outcome, claim)
    return f"**{cell}**" if claim in (*outcome.better, *outcome.worse) else cell


def _count(outcome: ReadingOutcome, claim: str) -> str:
    mark = f" {CLOSE_MARK}" if outcome.is_close(claim) else ""
    return f"{outcome.verdicts[claim].held}/{outcome.verdicts[claim].tests}{mark}"


def _share(outcome: ReadingOutcome, claim: str) -> float:
    verdict = outcome.verdicts[claim]
    return verdict.held / verdict.tests if verdict.tests else 0.0
