"""The records of each experiment of the paper, by the data set of the paper that they speak for."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.pair_sums import PairSums
from cgroup.benchmark.paper import EXPERIMENTS, PAPER_EPSILON, PLACES, VARIANTS, Experiment
from cgroup.benchmark.sample import Sample
from cgroup.benchmark.tables import exponents
from cgroup.evaluation.bins import binned
from cgroup.registry import PAPER_METHODS

if TYPE_CHECKING:
    import pandas as pd

    from cgroup.benchmark.averages import Average
    from cgroup.types import BoolArray, FloatArray, IndexArray


_VARIED = {
    "level": "level of the nuisance",
    "nms_radius": "initial matches (mean number)",
    "combination": "detector and descriptor",
}
"""What experiments that aren't the paper's may vary, with the label of the axis."""


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
        """Find the records of an experiment that speak for a data set of the paper.

        Parameters
        ----------
        experiment : str
            One of `EXPERIMENTS`.
        place : str
            One of `PLACES`.
        every_method : bool
            Whether to have the records of all methods, or those of `methods` only.

        Returns
        -------
        Sample or None
            None where there are no records.
        """
        key = (experiment, place, every_method)
        if key not in self._samples:
            self._samples[key] = self._find_sample(experiment, place, every_method=every_method)
        return self._samples[key]

    def same_cases(self, place: str, methods: tuple[str, ...]) -> Sample | None:
        """Find the records of some methods, on the cases that all of them were run on.

        Parameters
        ----------
        place : str
            One of `PLACES`.
        methods : tuple of str
            By the names in the records; they need not be among `methods` of the evidence.

        Returns
        -------
        Sample or None
            At the paper's threshold; None where there are no such cases.
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

        Returns
        -------
        list of Sample
            One per experiment and data set, with every method that was run on all of its cases. Levels are
            those of whatever is varied; NaN where nothing is.
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


def mean_times(timing: pd.DataFrame) -> pd.DataFrame:
    """Mean seconds of the repeats on one thread.

    Parameters
    ----------
    timing : DataFrame
        Times of the timing experiment.

    Returns
    -------
    DataFrame
        One row per n, one column per method; empty where there are no times.
    """
    if timing.empty:
        return timing
    single = timing[timing["threads"] == 1]
    means = single.pivot_table(index="n", columns="method", values="seconds", aggfunc="mean")
    return means.set_axis(means.columns.astype(object), axis="columns")


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
