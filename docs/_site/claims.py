"""Tables on the paper's claims and open choices, made when the site is built."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from cgroup.benchmark.config import read_questions
from cgroup.benchmark.paper.claims import CLAIMS, CRITERIA, read_explanations

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

_HEADING = 5
"""Lines of a file of measurements before its table."""


def write(measured: Path, folder: Path) -> None:
    """Write the tables below docs/_generated, from the files of docs/figures/measured."""
    folder.mkdir(parents=True, exist_ok=True)
    tables = {
        "criteria": CRITERIA,
        "questions": question_table(),
        "readings": reading_table(_load(measured / "readings.csv")),
        "verdicts": verdict_table(_load(measured / "verdicts.csv")),
    }
    for name, table in tables.items():
        (folder / f"{name}.md").write_text(table, encoding="utf-8")


def question_table() -> str:
    """Return the open choices: what the paper states, the default, and the other readings."""
    rows = [
        (
            f"**{question.title}**",
            question.paper,
            question.default,
            "; ".join(f"`{reading.name}`: {reading.label}" for reading in question.readings),
        )
        for question in read_questions()
    ]
    return _markdown(("choice", "the paper", "default", "other readings"), rows)


def reading_table(measured: pd.DataFrame) -> str:
    """Return the number of claims by verdict under every reading, and the claims that it changes."""
    columns = ["reading", "confirmed", "partly", "not", "better", "worse"]
    return _markdown(columns, measured[columns].itertuples(index=False))


def verdict_table(measured: pd.DataFrame) -> str:
    """Return the claims with their tests, measured verdicts, and explanations."""
    why, found = read_explanations(), measured.set_index("claim")
    rows = [
        (
            f"**{claim.id}** {claim.statement} *Test: {claim.criterion}*",
            found.loc[claim.id, "verdict"],
            found.loc[claim.id, "measured"] + (f" **Why:** {why[claim.id]}" if claim.id in why else ""),
            found.loc[claim.id, "data"],
        )
        for claim in CLAIMS
    ]
    return _markdown(("claim", "verdict", "measured", "data"), rows)


def _load(path: Path) -> pd.DataFrame:
    return pd.read_csv(path, skiprows=_HEADING, dtype=str, keep_default_na=False)


def _markdown(headers: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [headers, ["---"] * len(headers), *rows]
    return "".join("| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |\n" for line in lines)
