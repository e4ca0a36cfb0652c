"""Each claim is confirmed by records that agree with it, and not by records that contradict it."""

from __future__ import annotations

import re
from functools import cache, reduce

import pandas as pd
import pytest
from benchmark_frames import paper_frame, paper_timing
from claim_contradictions import CONTRADICTIONS, Contradiction

from cgroup.benchmark.paper.claims import CLAIMS, Verdict, check_claims, decide
from cgroup.benchmark.paper.evidence import Evidence

BY_ID = {claim.id: claim for claim in CLAIMS}


@cache
def check_on_agreeing_records() -> dict[str, Verdict]:
    return {verdict.id: verdict for verdict in check_claims(paper_frame(), paper_timing())}


def check_on_contradiction(claim_id: str, contradiction: Contradiction) -> Verdict:
    frame = reduce(lambda rows, change: change(rows), contradiction.records, paper_frame())
    timing = reduce(lambda rows, change: change(rows), contradiction.times, paper_timing())
    return decide(BY_ID[claim_id], Evidence(frame, timing))


def test_every_claim_has_records_that_agree_and_records_that_contradict() -> None:
    assert list(check_on_agreeing_records()) == list(BY_ID)
    assert list(CONTRADICTIONS) == list(BY_ID)
    assert all(CONTRADICTIONS.values())


@pytest.mark.parametrize("claim_id", BY_ID)
def test_records_that_agree_confirm(claim_id: str) -> None:
    verdict = check_on_agreeing_records()[claim_id]
    assert verdict.verdict == "confirmed", verdict.measured
    assert re.search(r"\d", verdict.measured)
    assert verdict.data


@pytest.mark.parametrize(
    ("claim_id", "contradiction"),
    [
        pytest.param(claim_id, each, id=f"{claim_id} {each.instead}")
        for claim_id, several in CONTRADICTIONS.items()
        for each in several
    ],
)
def test_records_that_contradict_do_not_confirm(claim_id: str, contradiction: Contradiction) -> None:
    verdict = check_on_contradiction(claim_id, contradiction)
    assert verdict.verdict == "not confirmed", verdict.measured
    # Not one of the comparisons holds: no part of a check confirms whatever the records say.
    assert verdict.measured.startswith("0 of "), verdict.measured


def test_methods_that_the_paper_did_not_compare_change_nothing() -> None:
    """Not even one that is best at everything, and that was run where no other was."""
    frame, timing = paper_frame(), paper_timing()
    perfect = dict.fromkeys(("precision", "recall", "f_score", "registered"), 1.0)
    best = frame[frame["method"] == "gtm"].assign(method="zz", selected=frame["correct"], **perfect)
    other_case = {"level": 0.01, "nms_radius": 9.0, "n": 2, "correct": 2, "inlier_ratio": 1.0}
    elsewhere = best.assign(pair=best["pair"] + "-zz", **other_case)
    fastest = timing[timing["method"] == "gtm"].assign(method="zz", seconds=1e-9)
    verdicts = check_claims(
        pd.concat([elsewhere, best, frame], ignore_index=True),
        pd.concat([fastest.assign(n=20_000), fastest, timing], ignore_index=True),
    )
    assert verdicts == list(check_on_agreeing_records().values())
