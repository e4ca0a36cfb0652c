"""The records of each experiment of the paper, on the data set that replaces the paper's."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

import numpy as np
import pandas as pd

from cgroup.benchmark import paper
from cgroup.evaluation.protocols import CLUTTER, OCCLUSION, OVERLAP, binned
from cgroup.registry import PAPER_METHODS
from cgroup.types import BoolArray, FloatArray

Level: TypeAlias = "float | str"

_BINS = {"clutter": CLUTTER, "occlusion": OCCLUSION, "overlap": OVERLAP}  # of measured columns
_VARIED = {
    "level": "level of the nuisance",
    "nms_radius": "initial matches (mean number)",
    "combination": "detector and descriptor",
}
"""Columns that experiments other than the paper's may vary, with the label of the axis."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Records of one experiment on one data set, without failed ones; the column ``x`` has the level.

    `place` is the data set of the paper that `dataset` replaces.
    """

    experiment: paper.Experiment
    place: str
    dataset: str
    rows: pd.DataFrame

    def by_level(self, column: str) -> pd.DataFrame:
        """Mean over pairs: one row per level, one column per method."""
        values = self.rows.assign(value=self.rows[column].astype(float))
        return values.pivot_table(index="x", columns="method", values="value")

    def overall(self, column: str) -> pd.Series:
        """Mean over all records of each method, at all levels."""
        return self.rows[column].astype(float).groupby(self.rows["method"]).mean()

    def matches(self, column: str) -> pd.Series:
        """Mean over pairs, per level, of a number that is the same for all methods."""
        pairs = self.rows.drop_duplicates(["pair", "x", "epsilon"])
        return pairs[column].astype(float).groupby(pairs["x"]).mean()

    def smallest_steps(self, column: str) -> pd.Series:
        """Smallest change of any pair's value from one level to the next, by method; NaN for one level."""
        ordered = self.rows.sort_values("x", kind="stable")
        steps = ordered[column].astype(float).groupby([ordered["method"], ordered["pair"]]).diff()
        return steps.groupby(ordered["method"]).min()

    @cached_property
    def is_generated(self) -> bool:
        """Whether all pairs are generated shapes."""
        return bool((self.rows["origin"] == "synthetic").all())

    @cached_property
    def description(self) -> str:
        """The data set, the one that it replaces, the origin of its pairs, and their number."""
        pairs = self.rows.drop_duplicates("pair")
        counts = pairs.groupby("origin").size()
        origins = " + ".join(f"{count} {origin}" for origin, count in counts.items())
        noun = "pair" if len(pairs) == 1 else "pairs"
        replaces = (
            f" in place of {self.place}" if self.place and self.dataset not in paper.OF_THE_PAPER else ""
        )
        kind = " stand-in" if self.dataset.startswith(paper.GENERATED) else ""
        return f"{self.dataset}{replaces} ({origins}{kind} {noun})"


@dataclass(frozen=True, eq=False)
class Evidence:
    """All records of the experiments, one row per case, method and threshold, and all times."""

    frame: pd.DataFrame
    timing: pd.DataFrame
    _samples: dict[tuple[str, str, bool], Sample | None] = field(default_factory=dict, repr=False)

    def sample(self, experiment: str, place: str, *, every_method: bool = False) -> Sample | None:
        """Find the records of one of `EXPERIMENTS` for one of `PLACES`; None without records.

        They are those of the paper's methods, or of all.
        """
        key = (experiment, place, every_method)
        if key not in self._samples:
            self._samples[key] = self._find_sample(
                paper.EXPERIMENTS[experiment], place, every_method=every_method
            )
        return self._samples[key]

    def same_cases(self, place: str, methods: tuple[str, ...]) -> Sample | None:
        """Find the records of some methods on the cases that all of them ran on; None without such cases."""
        if self._usable.empty:
            return None
        rows = self._usable[self._at_threshold & self._usable["method"].isin(methods)]
        for dataset in paper.PLACES[place]:
            chosen = rows[rows["dataset"] == dataset]
            counts = chosen.groupby("case")["method"].nunique()
            shared = chosen[chosen["case"].isin(counts.index[counts == len(methods)])]
            if len(shared):
                return Sample(paper.VARIANTS, place, dataset, shared.assign(x=0.0))
        return None

    def samples(self, *, every_method: bool = True) -> list[Sample]:
        """List all samples, in the paper's order."""
        found = (
            self.sample(each.id, place, every_method=every_method)
            for each in paper.EXPERIMENTS.values()
            for place in each.places
        )
        return [sample for sample in found if sample is not None]

    def further_samples(self) -> list[Sample]:
        """Find the records of experiments that aren't the paper's.

        There is one sample per experiment and data set, with every method that was run on all of its cases.
        Levels are those of the column that varies; NaN if none does.
        """
        if self._usable.empty:
            return []
        own = {name for ids in self._usable["experiments"] for name in ids} - set(paper.EXPERIMENTS)
        at_threshold = self._usable[self._at_threshold]
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
    def _usable(self) -> pd.DataFrame:
        return self.frame if self.frame.empty else self.frame[self.frame["error"] == ""]

    @cached_property
    def _at_threshold(self) -> BoolArray:
        return np.isclose(self._usable["epsilon"], paper.PAPER_EPSILON)

    def _find_sample(self, experiment: paper.Experiment, place: str, *, every_method: bool) -> Sample | None:
        if self._usable.empty:
            return None
        chosen = self._usable["experiments"].map(lambda ids: experiment.id in ids).to_numpy(dtype=bool)
        if experiment.column != "epsilon":
            chosen = chosen & self._at_threshold
        if experiment.column == "level":
            chosen = chosen & self._usable["level"].notna().to_numpy()
        if not every_method:
            chosen = chosen & self._usable["method"].isin(PAPER_METHODS).to_numpy()
        for dataset in paper.PLACES[place]:
            rows = self._usable[chosen & (self._usable["dataset"] == dataset).to_numpy()]
            if len(rows):
                # The paper has no pairs outside its levels, such as views that hardly overlap.
                rows = rows.assign(x=_find_levels(rows, experiment)).dropna(subset="x")
            if len(rows):
                return Sample(experiment, place, dataset, rows)
        return None


def mean_times(timing: pd.DataFrame) -> pd.DataFrame:
    """Mean seconds of the repeats on one thread: one row per n, one column per method."""
    if timing.empty:
        return timing
    single = timing[timing["threads"] == 1]
    means = single.pivot_table(index="n", columns="method", values="seconds", aggfunc="mean")
    return means.set_axis(means.columns.astype(object), axis="columns")


def _make_own_sample(name: str, dataset: str, rows: pd.DataFrame) -> Sample:
    varied = [column for column in _VARIED if len(rows[column].dropna().unique()) > 1]
    column = varied[0] if varied else ""
    experiment = paper.Experiment(name, name, column, _VARIED.get(column, ""), ())
    levels = _find_levels(rows, experiment) if column else np.nan
    return Sample(experiment, "", dataset, rows.assign(x=levels))


def _find_levels(rows: pd.DataFrame, experiment: paper.Experiment) -> pd.Series | FloatArray:
    """Return the value of the varied quantity for each record; NaN outside all levels."""
    if experiment.column in _BINS:
        return binned(rows[experiment.column].to_numpy(), _BINS[experiment.column])
    if experiment.column == "nms_radius":  # its level is the number of matches that a radius leaves
        radius = rows["nms_radius"].fillna(0.0)
        counts = rows.drop_duplicates(["pair", "nms_radius"])["n"]
        means = counts.groupby(radius.loc[counts.index]).mean().round()
        return radius.map(means)
    values = rows[experiment.column]
    return values if experiment.column == "combination" else values.astype(float).round(6)
