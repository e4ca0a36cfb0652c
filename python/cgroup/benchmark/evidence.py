"""The records of each experiment of the paper, by the data set of the paper that they speak for."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportReturnType=false

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from cgroup.benchmark.paper import (
    EXPERIMENTS,
    GENERATED,
    OF_THE_PAPER,
    PAPER_EPSILON,
    PLACES,
    VARIANTS,
    Experiment,
)
from cgroup.evaluation.bins import binned
from cgroup.registry import PAPER_METHODS

if TYPE_CHECKING:
    import pandas as pd

    from cgroup.types import FloatArray

    Level: TypeAlias = float | str


_VARIED = {
    "level": "level of the nuisance",
    "nms_radius": "initial matches (mean number)",
    "combination": "detector and descriptor",
}
"""What experiments that aren't the paper's may vary, with the label of the axis."""


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
    rows : DataFrame
        Records without failed ones, with the level of each in the column ``x``.
    """

    experiment: Experiment
    place: str
    dataset: str
    rows: pd.DataFrame
    _tables: dict[str, pd.DataFrame] = field(default_factory=dict, repr=False)

    @cached_property
    def levels(self) -> list[Level]:
        """What was varied, ascending."""
        return sorted(self.rows["x"].dropna().unique().tolist())

    def by_level(self, column: str) -> pd.DataFrame:
        """Mean over pairs: one row per level, one column per method."""
        if column not in self._tables:
            self._tables[column] = self.rows.pivot_table(
                index="x", columns="method", values=column, aggfunc="mean"
            )
        return self._tables[column]

    def overall(self, column: str) -> pd.Series:
        """Mean over all records of each method, at all levels."""
        return self.rows.groupby("method")[column].mean()

    def matches(self, column: str) -> pd.Series:
        """Mean over pairs of a number that no method has a part in, by level."""
        once = self.rows.drop_duplicates(subset=["pair", "x", "epsilon"])
        return once.groupby("x")[column].mean()

    @property
    def description(self) -> str:
        """The data set, what it stands in for, where its pairs come from and how many there are."""
        return describe_rows(self.rows, self.dataset, self.place)


def describe_rows(rows: pd.DataFrame, dataset: str, place: str = "") -> str:
    """Name a data set with what it stands in for, the origin of its pairs and their number.

    Parameters
    ----------
    rows : DataFrame
        Its records.
    dataset : str
        Its name.
    place : str
        Data set of the paper that it speaks for, if any.

    Returns
    -------
    str
        For people.
    """
    pairs = rows.drop_duplicates("pair")
    counts = pairs.groupby("origin").size()
    origins = " + ".join(f"{count} {origin}" for origin, count in counts.items())
    noun = "pair" if len(pairs) == 1 else "pairs"
    stands = f" in place of {place}" if place and dataset not in OF_THE_PAPER else ""
    kind = " stand-in" if dataset.startswith(GENERATED) else ""
    return f"{dataset}{stands} ({origins}{kind} {noun})"


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
    """

    frame: pd.DataFrame
    timing: pd.DataFrame
    methods: tuple[str, ...] = PAPER_METHODS
    _samples: dict[tuple[str, str, bool], Sample | None] = field(default_factory=dict, repr=False)

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
            rows = self._usable if every_method or self._usable.empty else self._of_methods
            self._samples[key] = _find_sample(rows, EXPERIMENTS[experiment], place)
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
        if self.frame.empty:
            return None
        rows = self.frame[(self.frame["error"] == "") & np.isclose(self.frame["epsilon"], PAPER_EPSILON)]
        rows = rows[rows["method"].isin(methods)]
        for dataset in PLACES[place]:
            chosen = rows[rows["dataset"] == dataset]
            counts = chosen.groupby("case")["method"].nunique()
            shared = chosen[chosen["case"].isin(counts.index[counts == len(methods)])]
            if len(shared):
                return Sample(VARIANTS, place, dataset, shared.assign(x=0.0))
        return None

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
    def _usable(self) -> pd.DataFrame:
        return self.frame if self.frame.empty else self.frame[self.frame["error"] == ""]

    @cached_property
    def _of_methods(self) -> pd.DataFrame:
        return self._usable[self._usable["method"].isin(self.methods)]


def _find_sample(usable: pd.DataFrame, experiment: Experiment, place: str) -> Sample | None:
    rows = _select_experiment(usable, experiment)
    for dataset in PLACES[place]:
        chosen = rows[rows["dataset"] == dataset] if len(rows) else rows
        if len(chosen):
            # The paper has no pairs outside its levels, such as views that hardly overlap.
            chosen = chosen.assign(x=_find_levels(chosen, experiment)).dropna(subset="x")
        if len(chosen):
            return Sample(experiment, place, dataset, chosen)
    return None


def _make_own_sample(name: str, dataset: str, rows: pd.DataFrame) -> Sample:
    varied = [column for column in _VARIED if len(rows[column].dropna().unique()) > 1]
    column = varied[0] if varied else ""
    experiment = Experiment(name, name, column, _VARIED.get(column, ""), ())
    levels = _find_levels(rows, experiment) if column else np.nan
    return Sample(experiment, "", dataset, rows.assign(x=levels))


def _select_experiment(frame: pd.DataFrame, experiment: Experiment) -> pd.DataFrame:
    if frame.empty:
        return frame
    rows = frame[frame["experiments"].map(lambda ids: experiment.id in ids).astype(bool)]
    if experiment.column != "epsilon":
        rows = rows[np.isclose(rows["epsilon"], PAPER_EPSILON)]
    return rows[rows[experiment.column].notna()] if experiment.column == "level" else rows


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
