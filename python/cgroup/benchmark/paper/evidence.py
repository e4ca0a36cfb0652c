"""The records of each experiment of the paper, by the data set of the paper that they speak for.

Sums of scores by level, method and pair are kept, so that means over any draw of the pairs are one product
(bootstrap: Efron, Annals of Statistics 1979).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
import pandas as pd

from cgroup.benchmark.paper import (
    EXPERIMENTS,
    GENERATED,
    OF_THE_PAPER,
    PAPER_EPSILON,
    PLACES,
    VARIANTS,
    Experiment,
)
from cgroup.benchmark.problem import keyed_rng
from cgroup.benchmark.stats import draw_weights
from cgroup.benchmark.tables import exponents
from cgroup.evaluation.bins import binned
from cgroup.evaluation.metrics import harmonic_mean, score_counts
from cgroup.registry import PAPER_METHODS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from cgroup.types import BoolArray, FloatArray, IndexArray

    Level: TypeAlias = float | str
    By: TypeAlias = Literal["cells", "methods", "levels"]
    Totals: TypeAlias = tuple[FloatArray, FloatArray]  # sums of values, and how many they are of

Average: TypeAlias = Literal["macro", "pooled", "f_of_means"]
"""How the scores of several pairs become one, which the paper doesn't say: means over pairs, each with the
same weight; the scores of all their matches taken as one set; or means, but F of the means of P and R."""

_VARIED = {
    "level": "level of the nuisance",
    "nms_radius": "initial matches (mean number)",
    "combination": "detector and descriptor",
}
"""What experiments that aren't the paper's may vary, with the label of the axis."""

_COUNTS = ("n", "correct", "selected", "selected_correct")
_FROM_COUNTS = ("inlier_ratio", "precision", "recall", "f_score")
_SET = ["method", "n", "threads", "dataset", "pair"]  # what repeats of a time have in common


class PairSums:
    """Records, with their level in the column ``x``, summed by level, method and pair."""

    def __init__(self, rows: pd.DataFrame) -> None:
        self.rows = rows
        self._level, self.levels = _number(rows["x"], "x")
        self._method, self.methods = _number(rows["method"], "method")
        self._pair, self.pairs = _number(rows["pair"], "pair")
        self._sums: dict[tuple[str, By], Totals] = {}
        self._steps: dict[str, FloatArray] = {}

    def total(self, column: str, by: By, times: FloatArray) -> Totals:
        """Sum a column: (levels,methods) cells, (1,methods), or (levels,1) with one record of a pair each.

        An empty name counts records. `times` says how often each pair counts; NaN values never do.
        """
        if (column, by) not in self._sums:
            values = self.rows[column].to_numpy(dtype=np.float64) if column else np.ones(len(self.rows))
            self._sums[column, by] = self._sum_by_pair(values, by)
        sums, counts = self._sums[column, by]
        return sums @ times, counts @ times

    def spread(self, times: FloatArray) -> FloatArray:
        """Give each record the number of times that its pair counts."""
        return times[self._pair]

    def smallest_steps(self, column: str) -> FloatArray:
        """Find the smallest change from one level to the next: (methods,pairs); NaN under two values."""
        if column not in self._steps:
            ordered = np.lexsort((self._level, self._pair, self._method))
            ordered = ordered[self._level[ordered] >= 0]
            values = self.rows[column].to_numpy(dtype=np.float64)[ordered]
            place = (self._method * len(self.pairs) + self._pair)[ordered]
            steps = np.where(place[1:] == place[:-1], np.diff(values), np.nan)
            least = np.full(len(self.methods) * len(self.pairs), np.nan)
            np.fmin.at(least, place[1:], steps)
            self._steps[column] = least.reshape(len(self.methods), len(self.pairs))
        return self._steps[column]

    def _sum_by_pair(self, values: FloatArray, by: By) -> Totals:
        group, rows, columns = self._group(by)
        known = (group >= 0) & ~np.isnan(values)
        place, shape = group[known] * len(self.pairs) + self._pair[known], (rows, columns, len(self.pairs))
        counted = (
            np.bincount(place, weights, minlength=rows * columns * len(self.pairs))
            for weights in (values[known], None)
        )
        sums, counts = (each.astype(np.float64).reshape(shape) for each in counted)
        return sums, counts

    def _group(self, by: By) -> tuple[IndexArray, int, int]:
        """Find each record's group, -1 for none, and the table that the groups make."""
        n_levels, n_methods = len(self.levels), len(self.methods)
        if by == "methods":
            return self._method, 1, n_methods
        if by == "levels":
            first = ~self.rows.duplicated(subset=["pair", "x", "epsilon"]).to_numpy()
            return np.where(first, self._level, -1), n_levels, 1
        return np.where(self._level >= 0, self._level * n_methods + self._method, -1), n_levels, n_methods


@dataclass(frozen=True, eq=False)
class Sample:
    """Records of one experiment on one data set.

    Attributes
    ----------
    experiment : Experiment
        Which.
    place : str
        Data set of the paper that the records speak for.
    dataset : str
        Data set that they come from.
    table : PairSums
        The records by level, method and pair.
    times : (n,) array of float, optional
        How often each of the table's pairs counts; once by default.
    average : {"macro", "pooled", "f_of_means"}
        How the scores of several pairs become one.
    """

    experiment: Experiment
    place: str
    dataset: str
    table: PairSums
    times: FloatArray | None = None
    average: Average = "macro"
    _means: dict[str, pd.DataFrame] = field(default_factory=dict, repr=False)

    @property
    def rows(self) -> pd.DataFrame:
        """Records of all pairs without failed ones, with the level of each in the column ``x``."""
        return self.table.rows

    def draw(self, times: FloatArray) -> Sample:
        """Let each of the table's pairs count as often as it was drawn."""
        return replace(self, times=times, _means={})

    @cached_property
    def levels(self) -> list[Level]:
        """What was varied, ascending."""
        return self._levels[0].tolist()

    @cached_property
    def methods(self) -> list[str]:
        """Methods that there are records of."""
        return self.table.methods[self._has_method].tolist()

    def by_level(self, column: str) -> pd.DataFrame:
        """Mean over pairs: one row per level, one column per method."""
        if column not in self._means:
            means = self._average(column, "cells")
            known = ~np.isnan(means)
            levels, methods = known.any(axis=1), known.any(axis=0)
            self._means[column] = pd.DataFrame(
                means[levels][:, methods], index=self._levels[0][levels], columns=self.table.methods[methods]
            )
        return self._means[column]

    def overall(self, column: str) -> pd.Series:
        """Mean over all records of each method, at all levels."""
        return self._by_method(self._average(column, "methods")[0], column)

    def matches(self, column: str) -> pd.Series:
        """Mean over pairs, per level, of a quantity that does not depend on the method."""
        return pd.Series(self._average(column, "levels")[:, 0], index=self._levels[0], name=column)

    def smallest_steps(self, column: str) -> pd.Series:
        """Smallest change of any pair's value from one level to the next, by method."""
        drawn = self.table.smallest_steps(column)[:, self._times > 0]
        return self._by_method(np.fmin.reduce(drawn, axis=1), column)

    def count(self, among: pd.Series) -> int:
        """Count some of `rows`; a record of a pair that counts several times does so too."""
        return int(self.table.spread(self._times)[among.to_numpy(dtype=bool)].sum())

    def share(self, holds: pd.Series, among: pd.Series) -> float:
        """Find for which share of some of `rows` something holds; NaN where there are none."""
        count = self.count(among)
        return self.count(holds & among) / count if count else float("nan")

    @cached_property
    def is_generated(self) -> bool:
        """Whether all pairs are generated shapes."""
        return bool((self.rows["origin"] == "synthetic").all())

    @cached_property
    def description(self) -> str:
        """The data set, what it stands in for, where its pairs come from and how many there are."""
        return describe_rows(self.rows, self.dataset, self.place)

    def _average(self, column: str, by: By) -> FloatArray:
        """Average a column over pairs, in the shape of `PairSums.total`; NaN for no pair."""
        sums, counts = self._total(column, by)
        if self.average == "pooled" and column in _FROM_COUNTS:
            scores = score_counts(*(self._total(name, by)[0] for name in _COUNTS))
            return np.where(counts > 0, getattr(scores, column), np.nan)
        if self.average == "f_of_means" and column == "f_score":
            return harmonic_mean(*(_divide(*self._total(name, by)) for name in ("precision", "recall")))
        return _divide(sums, counts)

    def _total(self, column: str, by: By) -> Totals:
        totals = self.table.total(column, by, self._times)
        return totals if by == "methods" else self._merge_levels(totals)

    def _by_method(self, values: FloatArray, column: str) -> pd.Series:
        there = self._has_method
        return pd.Series(values[there], index=self.table.methods[there], name=column)

    @cached_property
    def _has_method(self) -> BoolArray:
        """Of which of the table's methods there are records."""
        return self.table.total("", "methods", self._times)[1][0] > 0

    @cached_property
    def _times(self) -> FloatArray:
        return np.ones(len(self.table.pairs)) if self.times is None else self.times

    @cached_property
    def _levels(self) -> tuple[pd.Index, IndexArray]:
        """Levels that there are records of, ascending, and the place of each of the table's among them."""
        levels = self.table.levels
        there = self.table.total("", "levels", self._times)[1][:, 0] > 0
        if self.times is not None and self.experiment.column == "nms_radius":
            # Such a level is a mean over pairs itself, and two of them can come to be the same.
            counts = _divide(*self.table.total("n", "levels", self._times))[:, 0]
            levels = pd.Index(counts.round(), name=levels.name)
        known = levels[there].unique().sort_values()
        return known, np.where(there, known.get_indexer(levels), -1)

    def _merge_levels(self, totals: Totals) -> Totals:
        """Totals of the levels that there are, from those of all levels of the table."""
        known, place = self._levels
        if len(known) == len(place) and (np.diff(place) == 1).all():
            return totals
        sums, counts = (np.zeros((len(known), each.shape[1])) for each in totals)
        for to, each in zip((sums, counts), totals, strict=True):
            np.add.at(to, place[place >= 0], each[place >= 0])
        return sums, counts


@dataclass(frozen=True, eq=False)
class Evidence:
    """All records, sorted by experiment and place.

    Attributes
    ----------
    frame : DataFrame
        Records, one row per case, method and threshold.
    timing : DataFrame
        Times of the timing experiment; may have no rows.
    methods : tuple of str
        Methods that claims are about; the paper's nine by default.
    average : {"macro", "pooled", "f_of_means"}
        How the scores of several pairs become one.
    """

    frame: pd.DataFrame
    timing: pd.DataFrame
    methods: tuple[str, ...] = PAPER_METHODS
    average: Average = "macro"
    _samples: dict[tuple[str, str, bool], Sample | None] = field(default_factory=dict, repr=False)
    _shared: dict[tuple[str, tuple[str, ...]], Sample | None] = field(default_factory=dict, repr=False)

    def sample(self, experiment: str, place: str, *, every_method: bool = False) -> Sample | None:
        """Find the records of one of `EXPERIMENTS` that speak for one of `PLACES`; None without any.

        They are those of all methods, or of `methods` only.
        """
        key = (experiment, place, every_method)
        if key not in self._samples:
            self._samples[key] = self._find_sample(experiment, place, every_method=every_method)
        return self._samples[key]

    def same_cases(self, place: str, methods: tuple[str, ...]) -> Sample | None:
        """Find the records of some methods at the paper's threshold, on the cases that all were run on.

        The methods are named as in the records and need not be among `methods`; None without such cases.
        """
        key = (place, methods)
        if key not in self._shared:
            self._shared[key] = self._find_same_cases(place, methods)
        return self._shared[key]

    def samples(self) -> list[Sample]:
        """All that there are, of every method, in the paper's order."""
        found = (
            self.sample(each.id, place, every_method=True)
            for each in EXPERIMENTS.values()
            for place in each.places
        )
        return [sample for sample in found if sample is not None]

    def further_samples(self) -> list[Sample]:
        """Find the records of experiments that aren't the paper's.

        There is one sample per experiment and data set, with every method that was run on all of its cases.
        Levels are those of whatever is varied; NaN where nothing is.
        """
        if self._usable.empty:
            return []
        own = {name for ids in self._usable["experiments"] for name in ids} - set(EXPERIMENTS)
        at_threshold = self._usable[np.isclose(self._usable["epsilon"], PAPER_EPSILON)]
        found: list[Sample] = []
        for name in sorted(own):
            of_it = at_threshold[at_threshold["experiments"].map(lambda ids, name=name: name in ids)]
            for dataset, cases in of_it.groupby("dataset")["case"]:
                rows = at_threshold[at_threshold["case"].isin(cases)]
                counts = rows.groupby("method")["case"].nunique()
                rows = rows[rows["method"].isin(counts.index[counts == cases.nunique()])]
                found.append(_make_own_sample(name, str(dataset), rows))
        return found

    @cached_property
    def mean_times(self) -> pd.DataFrame:
        """Mean seconds of the methods on one thread: one row per n, one column per method."""
        timing = self.timing
        return mean_times(timing if timing.empty else timing[timing["method"].isin(self.methods)])

    @cached_property
    def exponents(self) -> dict[str, float]:
        """Exponents of time over n, by method; NaN where there are too few sets."""
        known = exponents(self.timing).set_index("method")["exponent"].to_dict()
        return {method: known.get(method, np.nan) for method in self.methods}

    @cached_property
    def _usable(self) -> pd.DataFrame:
        return self.frame if self.frame.empty else self.frame[self.frame["error"] == ""]

    def _find_sample(self, name: str, place: str, *, every_method: bool) -> Sample | None:
        if self._usable.empty:
            return None
        experiment = EXPERIMENTS[name]
        chosen = self._select_experiment(experiment)
        if not every_method:
            chosen = chosen & self._usable["method"].isin(self.methods).to_numpy()
        for dataset in PLACES[place]:
            rows = self._usable[chosen & (self._usable["dataset"] == dataset).to_numpy()]
            if len(rows):
                # The paper has no pairs outside its levels, such as views that hardly overlap.
                rows = rows.assign(x=_find_levels(rows, experiment)).dropna(subset="x")
            if len(rows):
                return Sample(experiment, place, dataset, PairSums(rows), average=self.average)
        return None

    def _find_same_cases(self, place: str, methods: tuple[str, ...]) -> Sample | None:
        if self._usable.empty:
            return None
        rows = self._usable[np.isclose(self._usable["epsilon"], PAPER_EPSILON)]
        rows = rows[rows["method"].isin(methods)]
        for dataset in PLACES[place]:
            chosen = rows[rows["dataset"] == dataset]
            counts = chosen.groupby("case")["method"].nunique()
            shared = chosen[chosen["case"].isin(counts.index[counts == len(methods)])]
            if len(shared):
                return Sample(VARIANTS, place, dataset, PairSums(shared.assign(x=0.0)), average=self.average)
        return None

    def _select_experiment(self, experiment: Experiment) -> BoolArray:
        """Which of the usable records are of an experiment."""
        numbers, lists = self._experiments
        chosen = np.isin(numbers, [at for at, ids in enumerate(lists) if experiment.id in ids])
        if experiment.column != "epsilon":
            chosen &= np.isclose(self._usable["epsilon"], PAPER_EPSILON)
        if experiment.column == "level":
            chosen &= self._usable["level"].notna().to_numpy()
        return chosen

    @cached_property
    def _experiments(self) -> tuple[IndexArray, list[tuple[str, ...]]]:
        """Number of the list of experiments of each usable record, and the lists."""
        numbers: dict[tuple[str, ...], int] = {}
        found = [numbers.setdefault(ids, len(numbers)) for ids in self._usable["experiments"]]
        return np.array(found, dtype=np.intp), list(numbers)


@dataclass(frozen=True, eq=False)
class _Resample(Evidence):
    """What another draw of the pairs would have shown, from the samples of the whole."""

    whole: Evidence = field(kw_only=True)
    draw: Callable[[Sample], FloatArray] = field(kw_only=True)

    def _find_sample(self, name: str, place: str, *, every_method: bool) -> Sample | None:
        return self._draw(self.whole.sample(name, place, every_method=every_method))

    def _find_same_cases(self, place: str, methods: tuple[str, ...]) -> Sample | None:
        return self._draw(self.whole.same_cases(place, methods))

    def _draw(self, sample: Sample | None) -> Sample | None:
        if sample is None:
            return None
        times = self.draw(sample)
        return sample.draw(times) if times.any() else None


def resample_evidence(evidence: Evidence, resamples: int, *, seed: int = 0) -> Iterator[Evidence]:
    """Draw the pairs of each data set, and the repeats of each time, with replacement.

    All records of a pair are drawn together: those of all experiments, levels, methods and thresholds. Data
    sets that speak for those of the paper stay the same.
    """
    tables = draw_pairs(evidence.frame, resamples, seed)

    @cache
    def of_sample(sample: Sample) -> FloatArray:
        return tables[sample.dataset][sample.table.pairs].to_numpy()

    ordered, repeats = _draw_repeats(evidence.timing, resamples, seed)
    for number in range(resamples):
        yield _Resample(
            evidence.frame,
            ordered.take(repeats[number]),
            evidence.methods,
            whole=evidence,
            draw=lambda sample, number=number: of_sample(sample)[number],
        )


def draw_pairs(frame: pd.DataFrame, resamples: int, seed: int) -> dict[str, pd.DataFrame]:
    """How often each resample draws each pair, by data set: one row per resample, one column per pair.

    The draws of a data set depend on the seed and on the names of the pairs only: records of other methods on
    the same pairs are resampled alike.
    """
    tables: dict[str, pd.DataFrame] = {}
    for dataset, pairs in frame.groupby("dataset")["pair"] if len(frame) else ():
        names = sorted(pairs.unique())
        times = draw_weights(len(names), resamples, "resampled pairs", seed, names)
        tables[str(dataset)] = pd.DataFrame(times, columns=names)
    return tables


def _draw_repeats(timing: pd.DataFrame, resamples: int, seed: int) -> tuple[pd.DataFrame, IndexArray]:
    """Sort times by set; return them, and for each resample the rows that it draws."""
    if timing.empty:
        return timing, np.zeros((resamples, 0), dtype=np.int64)
    sets = timing.groupby(_SET, sort=True).ngroup().to_numpy()
    order = np.argsort(sets, kind="stable")
    _, first, which, sizes = np.unique(
        sets[order], return_index=True, return_inverse=True, return_counts=True
    )
    uniform = keyed_rng("resampled repeats", seed, len(sets)).random((resamples, len(sets)))
    drawn = first[which] + (uniform * sizes[which]).astype(np.int64)
    return timing[[*_SET, "seconds"]].take(order), drawn


def mean_times(timing: pd.DataFrame) -> pd.DataFrame:
    """Mean seconds of the repeats on one thread: one row per n, one column per method."""
    if timing.empty:
        return timing
    single = timing[timing["threads"] == 1]
    means = single.pivot_table(index="n", columns="method", values="seconds", aggfunc="mean")
    return means.set_axis(means.columns.astype(object), axis="columns")


def describe_rows(rows: pd.DataFrame, dataset: str, place: str = "") -> str:
    """Name a data set with what it stands in for, the origin of its pairs and their number."""
    pairs = rows.drop_duplicates("pair")
    counts = pairs.groupby("origin").size()
    origins = " + ".join(f"{count} {origin}" for origin, count in counts.items())
    noun = "pair" if len(pairs) == 1 else "pairs"
    stands = f" in place of {place}" if place and dataset not in OF_THE_PAPER else ""
    kind = " stand-in" if dataset.startswith(GENERATED) else ""
    return f"{dataset}{stands} ({origins}{kind} {noun})"


def _make_own_sample(name: str, dataset: str, rows: pd.DataFrame) -> Sample:
    varied = [column for column in _VARIED if len(rows[column].dropna().unique()) > 1]
    column = varied[0] if varied else ""
    experiment = Experiment(name, name, column, _VARIED.get(column, ""), ())
    levels = _find_levels(rows, experiment) if column else np.nan
    return Sample(experiment, "", dataset, PairSums(rows.assign(x=levels)))


def _find_levels(rows: pd.DataFrame, experiment: Experiment) -> pd.Series | FloatArray:
    """Value of what was varied, for each record; NaN outside all levels."""
    if experiment.bins is not None:
        return binned(rows[experiment.column].to_numpy(), experiment.bins)
    if experiment.column == "nms_radius":  # what the radius is there for: the number of matches
        radius = rows["nms_radius"].fillna(0.0)
        counts = rows.drop_duplicates(["pair", "nms_radius"])["n"]
        means = counts.groupby(radius.loc[counts.index]).mean().round()
        return radius.map(means)
    values = rows[experiment.column]
    return values if experiment.column == "combination" else values.astype(float).round(6)


def _divide(sums: FloatArray, counts: FloatArray) -> FloatArray:
    with np.errstate(invalid="ignore"):
        return sums / counts


def _number(values: pd.Series, name: str) -> tuple[IndexArray, pd.Index]:
    """Replace values by their place among all, -1 for NaN; return these, too."""
    codes, known = pd.factorize(values, sort=True)
    # Python's own strings are found faster than others.
    return codes.astype(np.intp), pd.Index(known, name=name, dtype=None if values.dtype == float else object)
