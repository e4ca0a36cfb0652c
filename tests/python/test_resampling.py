"""Draws of pairs, and means over them, against records whose rows are repeated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pytest
from benchmark_frames import paper_frame
from repeated_rows import repeat_rows, uneven

from cgroup.benchmark import tables
from cgroup.benchmark.paper.evidence import Evidence, draw_pairs, resample_evidence

if TYPE_CHECKING:
    from cgroup.benchmark.paper.evidence import Average, Sample

NO_TIMES = pd.DataFrame()
SAMPLES = [
    ("noise", "B3R"),
    ("clutter", "U3OR"),
    ("overlap", "U3M"),
    ("epsilon", "U3OR"),
    ("matches", "U3OR"),
    ("combinations", "U3M"),
]


def assert_same(one: Sample, other: Sample) -> None:
    assert one.methods == other.methods
    assert one.levels == other.levels
    for column in ("precision", "f_score", "registered"):
        pd.testing.assert_frame_equal(one.by_level(column), other.by_level(column))
        pd.testing.assert_series_equal(one.overall(column), other.overall(column))
    pd.testing.assert_series_equal(one.matches("inlier_ratio"), other.matches("inlier_ratio"))
    pd.testing.assert_series_equal(one.smallest_steps("precision"), other.smallest_steps("precision"))
    drawn, repeated = ((each.rows["precision"] > 0.3, each.rows["method"] == "gc") for each in (one, other))
    assert one.count(drawn[1]) == other.count(repeated[1])
    assert one.share(*drawn) == pytest.approx(other.share(*repeated), nan_ok=True)


def test_means_of_a_resample_are_those_of_rows_that_are_repeated() -> None:
    frame = uneven(paper_frame())
    evidence = Evidence(frame, NO_TIMES)
    draws = draw_pairs(frame, 2, 5)
    for number, resample in enumerate(resample_evidence(evidence, 2, seed=5)):
        repeated = Evidence(repeat_rows(frame, draws, number), NO_TIMES)
        for experiment, place in SAMPLES:
            assert_same(resample.sample(experiment, place), repeated.sample(experiment, place))
        methods = ("gc+ransac", "ransac")
        assert_same(resample.same_cases("U3OR", methods), repeated.same_cases("U3OR", methods))


@pytest.mark.parametrize("average", ["macro", "pooled", "f_of_means"])
def test_averages_are_those_of_the_records(average: Average) -> None:
    evidence = Evidence(uneven(paper_frame()), NO_TIMES, average=average)
    how = "pooled" if average == "pooled" else "macro"
    for experiment, place in SAMPLES:
        sample = evidence.sample(experiment, place)
        for column in ("precision", "recall", "f_score", "seconds"):
            wanted = "f_of_means" if (average, column) == ("f_of_means", "f_score") else column
            by_level = tables.aggregate(sample.rows, ["x", "method"], how).pivot_table(
                index="x", columns="method", values=wanted
            )
            np.testing.assert_allclose(sample.by_level(column), by_level)
            overall = tables.aggregate(sample.rows, ["method"], how)[wanted]
            np.testing.assert_allclose(sample.overall(column), overall)
        pairs = sample.rows.drop_duplicates(["pair", "x", "epsilon"])
        ratios = tables.aggregate(pairs, ["x"], how)["inlier_ratio"]
        np.testing.assert_allclose(sample.matches("inlier_ratio"), ratios)


@pytest.mark.parametrize("average", ["pooled", "f_of_means"])
def test_other_averages_of_a_resample_are_those_of_rows_that_are_repeated(average: Average) -> None:
    frame = uneven(paper_frame("clutter", "combinations"))
    draws = draw_pairs(frame, 1, 5)
    evidence = Evidence(frame, NO_TIMES, average=average)
    repeated = Evidence(repeat_rows(frame, draws, 0), NO_TIMES, average=average)
    [resample] = resample_evidence(evidence, 1, seed=5)
    for experiment, place in (("clutter", "U3OR"), ("combinations", "U3M")):
        assert_same(resample.sample(experiment, place), repeated.sample(experiment, place))


def test_a_resample_has_the_levels_and_methods_of_its_pairs() -> None:
    frame = uneven(paper_frame("noise"))
    only_first = (frame["level"] == 0.05) & (frame["pair"] != "scene0")
    only_second = (frame["method"] == "st") & (frame["pair"] != "scene1")
    # Of two pairs one has been tried with one method only: it counts as much as the other.
    alone = (frame["level"] == 0.1) & (frame["pair"] == "scene2") & (frame["method"] != "gc")
    thin = frame[~(only_first | only_second | alone)].assign(
        inlier_ratio=lambda rows: rows["inlier_ratio"].where(rows["pair"] != "scene2", 0.1)
    )
    draws = draw_pairs(thin, 8, 0)
    levels, methods = set(), set()
    for number, resample in enumerate(resample_evidence(Evidence(thin, NO_TIMES), 8)):
        drawn = resample.sample("noise", "B3R")
        repeated = Evidence(repeat_rows(thin, draws, number), NO_TIMES).sample("noise", "B3R")
        assert_same(drawn, repeated)
        by_pair = repeated.rows.groupby(["x", "pair"])["inlier_ratio"].first()
        np.testing.assert_allclose(drawn.matches("inlier_ratio"), by_pair.groupby("x").mean())
        levels.add(len(drawn.levels))
        methods.add(len(drawn.methods))
    assert (levels, methods) == ({8, 9}, {8, 9}), "some draws lack the only pair of each"


def test_numbers_of_matches_that_become_the_same_level_are_one() -> None:
    frame = paper_frame("matches")
    # Only the first pair tells the two radii apart.
    first = frame["pair"] == "rs0"
    frame = frame.assign(n=np.where(first, frame["n"], 700), dataset="u3or")
    sample = Evidence(frame, NO_TIMES).sample("matches", "U3OR")
    assert len(sample.levels) == 6
    drawn = sample.draw((sample.table.pairs != "rs0").astype(float))
    assert drawn.levels == [700]
    rest = frame[~first]
    wanted = rest.groupby("method")["precision"].mean()
    np.testing.assert_allclose(drawn.by_level("precision").loc[700], wanted)


def test_a_data_set_keeps_its_number_of_pairs() -> None:
    frame = paper_frame("noise", "overlap", "clutter")
    one = frame[(frame["dataset"] != "b3r-clean") | (frame["pair"] == "scene1")]
    draws = draw_pairs(one, 50, 0)
    for dataset, pairs in one.groupby("dataset")["pair"]:
        assert (draws[dataset].sum(axis=1) == pairs.nunique()).all()
    assert all(each.sample("noise", "B3R") for each in resample_evidence(Evidence(one, NO_TIMES), 50))


def test_a_stand_in_does_not_speak_where_no_pair_is_drawn() -> None:
    frame = paper_frame("matches")
    first = frame["pair"] == "rs0"
    real, other = frame[first], frame[~first].assign(experiments=[("variants",)] * int((~first).sum()))
    generated = frame.assign(dataset="standin-clutter", origin="synthetic")
    evidence = Evidence(pd.concat([real, other, generated], ignore_index=True), NO_TIMES)
    samples = [each.sample("matches", "U3OR") for each in resample_evidence(evidence, 20)]
    assert None in samples
    assert {each.dataset for each in samples if each} == {"u3or"}


def test_draws_depend_on_the_seed_and_the_names_of_the_pairs_only() -> None:
    frame = uneven(paper_frame("clutter", "noise"))
    draws = draw_pairs(frame, 20, 0)
    worse = frame.assign(precision=0.0)[frame["method"] != "gc"].sample(frac=1, random_state=0)
    for dataset, table in draw_pairs(worse, 20, 0).items():
        pd.testing.assert_frame_equal(table, draws[dataset])
    dense = frame[frame["dataset"] == "u3or"].assign(dataset="u3or-dense")
    pd.testing.assert_frame_equal(draw_pairs(dense, 20, 0)["u3or-dense"], draws["u3or"])
    assert not draw_pairs(frame, 20, 1)["u3or"].equals(draws["u3or"])
