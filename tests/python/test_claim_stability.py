"""How sure verdicts are: how often they change on other draws of the pairs, and which are close."""

from __future__ import annotations

import json
import re
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pytest
from benchmark_frames import paper_frame, paper_timing
from repeated_rows import repeat_rows, uneven

from cgroup.benchmark import tables
from cgroup.benchmark.paper.checks import Check, Comparison
from cgroup.benchmark.paper.claims import (
    CLAIMS,
    CRITERIA,
    OUTCOMES,
    RESAMPLES,
    Claim,
    Stability,
    bootstrap_verdicts,
    check_claims,
    decide,
)
from cgroup.benchmark.paper.evidence import Evidence, draw_pairs, resample_evidence
from cgroup.benchmark.paper.verdicts import as_markdown, counts_line
from cgroup.cli import main
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


NO_TIMES = pd.DataFrame()


def pick(*ids: str) -> list[Claim]:
    return [claim for claim in CLAIMS if claim.id in ids]


def test_verdicts_of_a_resample_are_those_of_rows_that_are_repeated() -> None:
    frame = uneven(paper_frame())
    draws = draw_pairs(frame, 3, 0)
    found = bootstrap_verdicts(frame, NO_TIMES, resamples=3)
    slow = [check_claims(repeat_rows(frame, draws, number), NO_TIMES) for number in range(3)]
    for outcomes in zip(*slow, strict=True):
        if outcomes[0].id in found:
            counts = {name: count for name, count in found[outcomes[0].id].counts.items() if count}
            assert counts == Counter(each.verdict for each in outcomes), outcomes[0].id
    assert len({each.share for each in found.values()}) > 2, "some verdicts change"


def make_frame(scores: list[float]) -> pd.DataFrame:
    """Records of noise at its least, of which the first claim asks for the share of correct matches."""
    frame = paper_frame("noise")
    rows = frame[(frame["level"] == 0.05) & (frame["pair"] == "scene0")]
    return pd.concat(
        [
            rows.assign(pair=f"scene{k}", case=f"case{k}", inlier_ratio=score)
            for k, score in enumerate(scores)
        ],
        ignore_index=True,
    )


def test_a_claim_far_from_its_bound_is_stable_and_one_on_it_is_close() -> None:
    far = bootstrap_verdicts(make_frame([0.8, 0.9] * 10), NO_TIMES, claims=pick("C-01"))["C-01"]
    assert (far.share, far.close) == (1.0, False)
    assert far.counts == {"confirmed": 200, "partly": 0, "not confirmed": 0, "not testable": 0}
    near = bootstrap_verdicts(make_frame([0.31, 0.71] * 10), NO_TIMES, claims=pick("C-01"))["C-01"]
    assert near.close
    # Confirmed wherever at least ten of twenty draws are of the upper half: a binomial has it so in 58.8 %.
    assert near.share == pytest.approx(0.588, abs=0.1)


def test_what_is_more_than_a_tenth_is_close() -> None:
    counts = {"confirmed": 180, "partly": 19, "not confirmed": 1}
    assert not Stability.of("confirmed", counts).close
    assert Stability.of("confirmed", counts | {"confirmed": 179, "partly": 20}).close
    assert str(Stability.of("confirmed", counts)) == "90 %"
    assert str(Stability.of("confirmed", counts | {"confirmed": 179, "partly": 20})) == "89 %, close"


def test_resamples_without_a_verdict_are_left_out_but_counted() -> None:
    found = Stability.of("partly", {"partly": 90, "not testable": 110})
    assert (found.share, found.close) == (1.0, False)
    assert found.counts["not testable"] == 110
    nowhere = Stability.of("partly", {"not testable": 200})
    assert (nowhere.share, nowhere.close) == (0.0, True)


def test_a_level_that_loses_its_only_pair_makes_a_claim_untestable() -> None:
    frame = paper_frame("noise")
    alone = frame[(frame["level"] > 0.05) | (frame["pair"] == "scene0")]
    found = bootstrap_verdicts(alone, NO_TIMES, claims=pick("C-01", "C-44"))
    # One of three pairs is missing from (2/3)^3 = 30 % of the draws.
    assert found["C-01"].counts["not testable"] == pytest.approx(59, abs=20)
    assert found["C-01"].share == 1
    assert found["C-44"].counts["not testable"] == 0


def test_the_same_records_give_the_same_stability() -> None:
    frame, claims = uneven(paper_frame("noise", "clutter")), pick("C-05", "C-08", "C-14", "C-46")
    found = bootstrap_verdicts(frame, NO_TIMES, resamples=40, claims=claims)
    assert list(found) == ["C-05", "C-08", "C-14", "C-46"]
    assert bootstrap_verdicts(frame[::-1], NO_TIMES, resamples=40, claims=claims) == found
    others = bootstrap_verdicts(frame, NO_TIMES, resamples=40, seed=1, claims=claims)
    assert others != found
    all_claims = {each.id: each.stability for each in check_claims(frame, NO_TIMES, resamples=40, seed=1)}
    assert {name: all_claims[name] for name in others} == others


def test_repeats_of_times_are_drawn() -> None:
    timing = paper_timing()
    # Three repeats each: the slow one of CV decides, and some draws don't have it.
    slow = (timing["method"] == "cv") & (timing["repeat"] == 0)
    si = timing[timing["method"] == "si"].set_index(["n", "repeat"])["seconds"]
    of_si = si.reindex(pd.MultiIndex.from_frame(timing[["n", "repeat"]])).to_numpy()
    uneven_times = timing.assign(seconds=np.where(slow, 5 * of_si, timing["seconds"]))
    faster = pick("C-60")
    assert not bootstrap_verdicts(pd.DataFrame(), timing, claims=faster, resamples=20)["C-60"].close
    found = bootstrap_verdicts(pd.DataFrame(), uneven_times, claims=faster, resamples=100)["C-60"]
    # A level holds where none of three draws is the slow one, in 8 of 27; three of five are "partly".
    assert found.counts["partly"] == pytest.approx(15.3, abs=12)
    means = [each.mean_times for each in resample_evidence(Evidence(pd.DataFrame(), uneven_times), 30)]
    drawn = {round(each.loc[500, "cv"] / si[500, 0], 1) for each in means}
    assert drawn >= {0.1, 1.8, 3.4}, "none, one or two of three are the slow one"
    assert all(each.shape == (5, 9) for each in means)


def test_claims_that_are_not_testable_have_no_stability() -> None:
    assert bootstrap_verdicts(pd.DataFrame(), NO_TIMES) == {}
    generated = paper_frame("noise").assign(dataset="standin-full", origin="synthetic")
    assert bootstrap_verdicts(generated, NO_TIMES, resamples=2) == {}
    found = {each.id: each for each in check_claims(paper_frame("noise"), NO_TIMES, resamples=2)}
    assert found["C-60"].stability is None
    assert found["C-03"].stability is not None
    assert check_claims(paper_frame("noise"), NO_TIMES)[2].stability is None


@pytest.mark.parametrize("wrong", [{"resamples": 0}, {"resamples": 1.5}, {"seed": -1}])
def test_wrong_numbers_of_resamples_are_refused(wrong: dict) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        bootstrap_verdicts(paper_frame("noise"), NO_TIMES, **wrong)


def test_verdicts_count_their_tests() -> None:
    found = {each.id: each for each in check_claims(paper_frame("noise"), NO_TIMES)}
    assert (found["C-06"].held, found["C-06"].tests) == (18, 18)
    assert (found["C-60"].held, found["C-60"].tests) == (0, 0)
    tests = [Comparison(k < 2, "text", float("nan") if k == 2 else 0.0) for k in range(5)]
    claim = Claim("C-00", "6", "Something.", Check("something", lambda _: tests))
    counted = bootstrap_verdicts(pd.DataFrame(), NO_TIMES, claims=[claim], resamples=3)
    assert counted["C-00"].counts["partly"] == 3
    verdict = decide(claim, Evidence(pd.DataFrame(), NO_TIMES))
    assert (verdict.held, verdict.tests) == (2, 4), "a number that is missing doesn't count"
    generated = paper_frame("noise").assign(dataset="standin-full", origin="synthetic")
    assert {each.tests for each in check_claims(generated, NO_TIMES)} == {0}


def test_tables_mark_close_verdicts() -> None:
    verdicts = check_claims(make_frame([0.31, 0.71] * 10), NO_TIMES, resamples=50)
    first = verdicts[0]
    assert first.stability.close
    text = as_markdown(verdicts)
    assert f"| confirmed ({first.stability}) |" in text
    assert "close if it changes in more than 10 %" in " ".join(CRITERIA.split())
    close = sum(each.stability.close for each in verdicts if each.stability)
    assert counts_line(verdicts).endswith(f"; {close} verdicts are close")
    assert "close" not in counts_line(check_claims(make_frame([0.31, 0.71]), NO_TIMES))
    assert (first.held, first.tests) == (1, 1)
    assert tuple(first.stability.counts) == OUTCOMES
    assert verdicts[-1].stability is None


@pytest.fixture
def show(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Callable:
    frames = {"experiment": make_frame([0.31, 0.71] * 10), "timing": NO_TIMES}
    monkeypatch.setattr(tables, "load", lambda _, kind="experiment": frames[kind])

    def run(*arguments: str) -> str:
        with pytest.raises(SystemExit) as ended:
            main(["benchmark", "claims", "--out", str(tmp_path), *arguments])
        assert ended.value.code == 0
        return capsys.readouterr().out

    return run


def test_the_command_line_marks_close_verdicts(show: Callable) -> None:
    few = ("--resamples", "40")
    frame = make_frame([0.31, 0.71] * 10)
    stability = bootstrap_verdicts(frame, NO_TIMES, resamples=40, claims=pick("C-01"))["C-01"]
    line = next(line for line in show(*few).splitlines() if line.startswith("C-01"))
    assert re.split(" {2,}", line)[1:3] == ["confirmed", str(stability)]
    assert str(stability).endswith("%, close")
    assert "of 40 draws of the same pairs" in show(*few)
    assert f"resamples {stability}: {stability.counts['confirmed']} confirmed" in show("--wide", *few)
    assert f"confirmed ({stability})" in show("--format", "markdown", *few)
    document = json.loads(show("--json"))
    assert document["options"]["resamples"] == sum(
        document["results"]["claims"][0]["stability"]["counts"].values()
    )
    assert document["options"]["resamples"] == RESAMPLES == 200
    assert document["results"]["claims"][0]["tests"] == 1


def test_no_resamples_leave_verdicts_unmarked(show: Callable) -> None:
    assert "resamples" not in show("--resamples", "0")
    assert json.loads(show("--resamples", "0", "--json"))["results"]["claims"][0]["stability"] is None
