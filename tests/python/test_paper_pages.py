"""Tables of the pages on the paper: one row per claim, open choice and reading."""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd
import pytest

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS))

from _site import claims  # noqa: E402

from cgroup.benchmark.paper.claims import CLAIMS, OUTCOMES  # noqa: E402
from cgroup.benchmark.paper.verdicts import read_explanations  # noqa: E402
from cgroup.benchmark.readings import read_questions  # noqa: E402


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    folder = tmp_path_factory.mktemp("paper")
    claims.write(DOCS / "figures" / "measured", folder)
    return {path.stem: path.read_text(encoding="utf-8").splitlines() for path in folder.iterdir()}


def test_every_claim_is_a_row_with_its_verdict_and_explanation(tables: dict[str, list[str]]) -> None:
    why = read_explanations()
    for claim, row in zip(CLAIMS, tables["verdicts"][2:], strict=True):
        _, what, verdict, measured, data, _ = row.split(" | ".replace(" ", ""))
        assert what.startswith(f" **{claim.id}** {claim.statement}")
        assert claim.criterion in what
        assert verdict.strip() in OUTCOMES
        assert measured.strip().endswith(why.get(claim.id, ""))
        assert data.strip()


def test_every_reading_is_described_and_was_measured(tables: dict[str, list[str]]) -> None:
    measured = pd.read_csv(DOCS / "figures" / "measured" / "readings.csv", skiprows=5)["reading"]
    known = {reading.name for question in read_questions() for reading in question.readings}
    assert known <= set(measured.str.extract(r"\*\*(.+?)\*\*")[0])
    text = "\n".join(tables["questions"])
    assert all(f"`{name}`: " in text for name in known)
    assert len(tables["questions"]) == 2 + len(read_questions())
    assert len(tables["readings"]) == 2 + len(measured)
