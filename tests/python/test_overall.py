"""Rankings over all pairs: means, intervals and tests are those of a plain computation."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from cgroup.benchmark.stats import (
    GENERATED,
    LEAST_OBJECTS,
    REAL,
    bootstrap,
    holm,
    name_units,
    rank_overall,
)

SCORES = ("f_score", "registered")


def make_rows(dataset: str, origin: str, scores: dict[str, np.ndarray], pairs: list[str]) -> pd.DataFrame:
    """One case per pair; a pair is registered where F exceeds a half."""
    return pd.DataFrame(
        [
            {
                "dataset": dataset, "origin": origin, "pair": pair, "case": f"{dataset}/{pair}",
                "method": method, "f_score": f, "registered": float(f > 0.5), "error": "",
            }
            for method, values in scores.items()
            for pair, f in zip(pairs, values, strict=True)
        ]
    )  # fmt: skip


def make_scores(count: int, seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    base = rng.uniform(0.2, 0.8, count)
    return {
        "good": np.clip(base + 0.15 + rng.normal(0, 0.05, count), 0, 1),
        "as good": np.clip(base + 0.15 + rng.normal(0, 0.05, count), 0, 1),
        "bad": np.clip(base - 0.1, 0, 1),
    }


def draw_means(values: np.ndarray, groups: list[np.ndarray], strata: list[list[int]]) -> np.ndarray:
    """Draw groups of rows by stratum, one draw after the other, and take means with fixed shares."""
    rng = np.random.default_rng(1)
    total = sum(len(group) for group in groups)
    means = np.zeros(4000)
    for draw in range(len(means)):
        for stratum in strata:
            picked = [groups[k] for k in rng.choice(stratum, size=len(stratum))]
            share = sum(len(groups[k]) for k in stratum) / total
            means[draw] += share * values[np.concatenate(picked)].mean()
    return means


def test_intervals_are_those_of_pairs_drawn_by_data_set():
    counts = (30, 12)
    scores = [make_scores(count, seed) for seed, count in enumerate(counts)]
    scores[1] = {method: values / 4 for method, values in scores[1].items()}
    names = [[f"p{k}" for k in range(count)] for count in counts]
    rows = pd.concat([make_rows(d, "real", s, n) for d, s, n in zip("xy", scores, names, strict=True)])
    (overall,) = rank_overall(rows, SCORES)
    values = np.concatenate([each["good"] for each in scores])
    groups = [np.array([k]) for k in range(sum(counts))]
    drawn = draw_means(values, groups, [list(range(30)), list(range(30, 42))])
    found = overall.standings["f_score"]["good"].interval
    assert found.mean == pytest.approx(values.mean())
    np.testing.assert_allclose(found[1:], np.quantile(drawn, (0.025, 0.975)), atol=0.004)
    assert overall.pairs == {"x": 30, "y": 12}
    assert overall.units == 42


def test_pairs_of_an_object_are_drawn_together():
    rng = np.random.default_rng(2)
    sizes = [3, 9, 4, 6, 8, 5]
    levels = rng.uniform(0.2, 0.9, len(sizes))
    values = np.repeat(levels, sizes) + rng.normal(0, 0.01, sum(sizes))
    names = [f"object{k}/{i}" for k, size in enumerate(sizes) for i in range(size)]
    rows = make_rows("x", "real", {"one": values, "other": values / 2}, names)
    (overall,) = rank_overall(rows, SCORES)
    ends = np.cumsum([0, *sizes])
    groups = [np.arange(ends[k], ends[k + 1]) for k in range(len(sizes))]
    drawn = draw_means(values, groups, [list(range(len(sizes)))])
    low, high = overall.standings["f_score"]["one"].interval[1:]
    np.testing.assert_allclose((low, high), np.quantile(drawn, (0.025, 0.975)), atol=0.015)
    alone = bootstrap(values[:, None])[0]
    assert high - low > 1.5 * (alone.high - alone.low)
    assert overall.units == len(sizes)


def test_few_objects_have_their_pairs_drawn():
    few = LEAST_OBJECTS - 1
    pairs = pd.DataFrame({"dataset": "x", "pair": [f"object{k}/{i}" for k in range(few) for i in range(2)]})
    assert len(set(name_units(pairs))) == 2 * few
    more = pd.concat([pairs, pd.DataFrame({"dataset": "x", "pair": ["last/0", "last/1"]})])
    assert len(set(name_units(more))) == LEAST_OBJECTS


def test_data_sets_keep_their_shares_in_every_draw():
    values = np.repeat([0.2, 0.8], [10, 30])[:, None]
    (interval,) = bootstrap(values, strata=["a"] * 10 + ["b"] * 30)
    assert interval == pytest.approx((0.65, 0.65, 0.65))
    (mixed,) = bootstrap(values)
    assert mixed.high - mixed.low > 0.1


def test_differences_are_tested_on_the_same_pairs():
    scores = make_scores(40)
    rows = make_rows("x", "real", scores, [f"p{k}" for k in range(40)])
    (overall,) = rank_overall(rows, SCORES)
    assert overall.methods[2] == "bad"
    first, second = overall.methods[:2]
    tests = [
        stats.wilcoxon(scores[first] - scores[other], zero_method="pratt", method="asymptotic").pvalue
        for other in (second, "bad")
    ]
    adjusted = holm(tests)
    by_f = overall.standings["f_score"]
    assert [by_f[second].p, by_f["bad"].p] == pytest.approx(adjusted)
    assert by_f[second].tied
    assert not by_f["bad"].tied
    # One case per pair: a pair is registered or not, and McNemar's test says whether it is chance.
    registered = {name: values > 0.5 for name, values in scores.items()}
    best = max(registered, key=lambda name: registered[name].mean())
    only = [
        int((registered[best] & ~registered["bad"]).sum()),
        int((~registered[best] & registered["bad"]).sum()),
    ]
    single = stats.binomtest(only[0], sum(only)).pvalue
    assert overall.standings["registered"]["bad"].p == pytest.approx(min(1, 2 * single), rel=1e-6)


def test_a_pair_counts_once_whatever_its_cases():
    rows = make_rows("x", "real", {"one": np.ones(2), "other": np.zeros(2)}, ["a", "b"])
    again = rows[rows["pair"] == "a"].assign(f_score=0.0, case="again")
    (overall,) = rank_overall(pd.concat([rows, again]), SCORES)
    assert overall.standings["f_score"]["one"].interval.mean == 0.75
    assert overall.cases == 3


def test_failures_count_as_nothing_found():
    rows = make_rows("x", "real", {"one": np.ones(4), "other": np.ones(4)}, list("abcd"))
    failed = (rows["method"] == "one") & (rows["pair"] == "a")
    rows.loc[failed, ["f_score", "registered"]] = np.nan
    (overall,) = rank_overall(rows, SCORES)
    assert overall.standings["f_score"]["one"].interval.mean == 0.75
    assert overall.methods == ("other", "one")


def test_only_what_was_run_alike_is_compared():
    rows = make_rows("x", "real", make_scores(10), [f"p{k}" for k in range(10)])
    rare = rows[(rows["method"] == "good") & rows["pair"].isin(["p0", "p1"])].assign(method="rare")
    lacking = rows[~((rows["method"] == "bad") & (rows["pair"] == "p9"))]
    (overall,) = rank_overall(pd.concat([lacking, rare]), SCORES)
    assert overall.unranked == {"rare": 2}
    assert set(overall.methods) == {"good", "as good", "bad"}
    assert (overall.cases, overall.further_cases, overall.pairs) == (9, 1, {"x": 9})


def test_synthetic_pairs_stand_apart():
    names = [f"p{k}" for k in range(6)]
    rows = pd.concat(
        [
            make_rows("x", "real", make_scores(6), names),
            make_rows("y", "semi-synthetic", make_scores(6), names),
            make_rows("z", "synthetic", make_scores(6), names),
        ]
    )
    assert [(each.kind, set(each.pairs)) for each in rank_overall(rows, SCORES)] == [
        (REAL, {"x", "y"}),
        (GENERATED, {"z"}),
    ]


def test_nothing_to_rank():
    assert rank_overall(pd.DataFrame(), SCORES) == []
    alone = make_rows("x", "real", {"one": np.ones(5)}, list("abcde"))
    assert rank_overall(alone, SCORES) == []
