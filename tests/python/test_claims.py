"""The paper's claims: all there, decided by the numbers, and not testable without them."""

import re
from functools import cache, reduce

import numpy as np
import pandas as pd
import pytest
from benchmark_frames import paper_frame, paper_timing
from claim_contradictions import CONTRADICTIONS, Contradiction

from cgroup.benchmark.paper.checks import Check, Comparison, in_top
from cgroup.benchmark.paper.claims import (
    CLAIMS,
    CRITERIA,
    Claim,
    Verdict,
    as_markdown,
    check_claims,
    counts_line,
    decide,
)
from cgroup.benchmark.paper.evidence import Evidence
from cgroup.benchmark.paper.numbers import Numbers, Row, compare_rankings, correlate_with_levels, rank
from cgroup.benchmark.paper.table import make_table

NO_TIMES = pd.DataFrame()
NOTHING = make_table(Evidence(pd.DataFrame(), pd.DataFrame()))


@cache
def verdicts() -> dict[str, Verdict]:
    return {verdict.id: verdict for verdict in check_claims(paper_frame(), paper_timing())}


def outcome(claim_id: str, frame: pd.DataFrame, timing: pd.DataFrame = NO_TIMES) -> Verdict:
    claim = next(each for each in CLAIMS if each.id == claim_id)
    return decide(claim, make_table(Evidence(frame, timing)))


def test_every_claim_is_there_once_in_order():
    numbers = [f"C-{number:02d}" for number in range(1, 68)]
    numbers.insert(numbers.index("C-29") + 1, "C-29b")
    assert [claim.id for claim in CLAIMS] == numbers
    assert len(CLAIMS) == 68


def test_empty_records_are_no_evidence():
    for verdict in check_claims(pd.DataFrame(), pd.DataFrame()):
        assert verdict.verdict == "not testable"
        assert "no " in verdict.measured


def test_precision_must_not_fall_as_the_threshold_grows():
    frame = paper_frame("epsilon")
    assert outcome("C-27", frame).verdict == "confirmed"
    fallen = frame.copy()
    row = fallen[(fallen["method"] == "cv") & (fallen["epsilon"] == 8) & (fallen["precision"] > 0)].index[0]
    fallen.loc[row, "precision"] = 0.01
    verdict = outcome("C-27", fallen)
    assert verdict.verdict == "partly"
    assert "CV" in verdict.measured


def test_only_the_threshold_of_the_paper_counts_elsewhere():
    frame = paper_frame("clutter")
    elsewhere = frame.assign(precision=frame["precision"].where(frame["epsilon"] == 5, 0.0))
    assert outcome("C-14", elsewhere).measured == outcome("C-14", frame).measured


def test_pairs_outside_all_levels_are_left_out():
    frame = paper_frame("overlap")
    apart = frame.assign(overlap=0.1, f_score=1.0, pair=frame["pair"] + "-apart")
    assert outcome("C-26", pd.concat([frame, apart], ignore_index=True)) == outcome("C-26", frame)
    assert outcome("C-26", apart).verdict == "not testable"


def test_failed_records_are_left_out():
    frame = paper_frame("noise")
    failed = frame.head(9).assign(error="InputError: no", precision=float("nan"), inlier_ratio=float("nan"))
    assert outcome("C-44", pd.concat([frame, failed], ignore_index=True)).verdict == "confirmed"


def test_stand_ins_are_named():
    frame = paper_frame("overlap").assign(dataset="standin-views", origin="synthetic")
    assert "standin-views in place of U3M" in outcome("C-22", frame).data
    assert "synthetic stand-in" in outcome("C-22", frame).data
    assert "stanford in place of U3M (140 real pairs)" in outcome("C-22", paper_frame("overlap")).data


def test_the_papers_data_come_before_stand_ins():
    real = paper_frame("noise")
    generated = real.assign(dataset="standin-full", origin="synthetic", inlier_ratio=0.0)
    verdict = outcome("C-01", pd.concat([generated, real], ignore_index=True))
    assert verdict.verdict == "confirmed"
    assert verdict.data.startswith("b3r-clean")


def test_missing_methods_and_levels_are_named():
    frame = paper_frame("noise")
    assert "GTM" in outcome("C-03", frame[frame["method"] != "gtm"]).measured
    assert outcome("C-06", frame[frame["method"] != "gtm"]).verdict == "confirmed"
    few = paper_frame("matches")
    assert outcome("C-34", few[few["method"] != "ss"]).verdict == "not testable"
    missing = outcome("C-01", frame[frame["level"] > 0.2])
    assert missing.verdict == "not testable"
    assert "0.05" in missing.measured


def test_gaps_in_the_records_do_not_count():
    frame = paper_frame("noise", "combinations")
    without_si = frame[(frame["method"] != "si") | (frame["nuisance"] != "noise")]
    whole, some = outcome("C-42", frame), outcome("C-42", without_si)
    assert (some.verdict, whole.tests - some.tests) == ("confirmed", 9)
    # ST has been tried with one of the six combinations only.
    elsewhere = (frame["method"] == "st") & (frame["combination"] != "C5") & (frame["dataset"] == "stanford")
    whole, some = outcome("C-40", frame), outcome("C-40", frame[~elsewhere])
    assert (some.verdict, whole.tests, some.tests) == ("confirmed", 9, 8)


@pytest.mark.parametrize(
    ("holding", "need", "expected"),
    [
        (4, "all", "confirmed"),
        (3, "all", "partly"),
        (2, "all", "partly"),
        (1, "all", "not confirmed"),
        (3, "most", "confirmed"),
        (2, "most", "partly"),
        (1, "most", "partly"),
        (0, "most", "not confirmed"),
    ],
)
def test_share_of_tests_decides(holding, need, expected):
    tests = [Comparison(k < holding, "text", 0.0) for k in range(4)]
    claim = Claim("C-00", "6", "Something.", Check("something", lambda _: tests, need))
    assert decide(claim, NOTHING).verdict == expected


def test_ties_count_for_the_best():
    scores = pd.Series({"a": 0.90, "b": 0.905, "c": 0.5})
    numbers = Numbers("F", "here", lambda *_: [Row("", scores)])
    [first, last] = in_top({"a": 1, "c": 2}, numbers).find(None)
    assert first.holds
    assert not last.holds
    [row] = rank(numbers).find(None, ())
    assert dict(row.scores) == {"a": 1, "b": 1, "c": 3}


def test_rank_statistics_of_constant_values():
    assert correlate_with_levels([1, 2, 3], [0.5, 0.5, 0.5]) == 0
    assert correlate_with_levels([1, 2, 3], [0.1, 0.2, 0.3]) == pytest.approx(1)
    flat = pd.Series([1.0, 1.0, 1.0])
    assert compare_rankings(flat, flat) == 1
    assert compare_rankings(flat, pd.Series([1.0, 2.0, 3.0])) == 0
    assert compare_rankings(flat, pd.Series([1.0, 2.0, np.nan])) == 0


def test_tables_hold_every_verdict():
    found = list(verdicts().values())
    text = as_markdown(found)
    assert CRITERIA.splitlines()[0] in text
    assert counts_line(found) in text
    for verdict in found:
        assert f"**{verdict.id}**" in text
    # A bar inside a cell would end it.
    for line in text.splitlines():
        if line.startswith("| **"):
            assert len(re.findall(r"(?<!\\)\|", line)) == 5, line


BY_ID = {claim.id: claim for claim in CLAIMS}


def check_on_contradiction(claim_id: str, contradiction: Contradiction) -> Verdict:
    frame = reduce(lambda rows, change: change(rows), contradiction.records, paper_frame())
    timing = reduce(lambda rows, change: change(rows), contradiction.times, paper_timing())
    return decide(BY_ID[claim_id], make_table(Evidence(frame, timing)))


def test_every_claim_has_records_that_agree_and_records_that_contradict():
    assert list(verdicts()) == list(BY_ID)
    assert list(CONTRADICTIONS) == list(BY_ID)
    assert all(CONTRADICTIONS.values())


@pytest.mark.parametrize("claim_id", BY_ID)
def test_records_that_agree_confirm(claim_id):
    verdict = verdicts()[claim_id]
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
def test_records_that_contradict_do_not_confirm(claim_id, contradiction):
    verdict = check_on_contradiction(claim_id, contradiction)
    assert verdict.verdict == "not confirmed", verdict.measured
    # Not one of the comparisons holds: no part of a check confirms whatever the records say.
    assert verdict.measured.startswith("0 of "), verdict.measured


def test_methods_that_the_paper_did_not_compare_change_nothing():
    """Not even one that is best at everything, and that was run where no other was."""
    frame, timing = paper_frame(), paper_timing()
    perfect = dict.fromkeys(("precision", "recall", "f_score", "registered"), 1.0)
    best = frame[frame["method"] == "gtm"].assign(method="zz", selected=frame["correct"], **perfect)
    other_case = {"level": 0.01, "nms_radius": 9.0, "n": 2, "correct": 2, "inlier_ratio": 1.0}
    elsewhere = best.assign(pair=best["pair"] + "-zz", **other_case)
    fastest = timing[timing["method"] == "gtm"].assign(method="zz", seconds=1e-9)
    found = check_claims(
        pd.concat([elsewhere, best, frame], ignore_index=True),
        pd.concat([fastest.assign(n=20_000), fastest, timing], ignore_index=True),
    )
    assert found == list(verdicts().values())
