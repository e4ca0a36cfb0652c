"""The records of one experiment on one data set, and means over its pairs."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import pandas as pd

from cgroup.benchmark.pair_sums import PairSums, Totals
from cgroup.benchmark.paper import GENERATED, OF_THE_PAPER
from cgroup.evaluation.metrics import harmonic_mean, score_counts

if TYPE_CHECKING:
    from cgroup.benchmark.averages import Average
    from cgroup.benchmark.pair_sums import Grouping
    from cgroup.benchmark.paper import Experiment
    from cgroup.types import BoolArray, FloatArray, IndexArray

    Level: TypeAlias = float | str

_COUNTS = ("n", "correct", "selected", "selected_correct")
_FROM_COUNTS = ("inlier_ratio", "precision", "recall", "f_score")


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
        """Let each pair count as often as it was drawn.

        Parameters
        ----------
        times : (n,) array of float
            For each of the table's pairs.

        Returns
        -------
        Sample
            Its means are those of the drawn pairs.
        """
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
                means[levels][:, methods],
                index=self._levels[0][levels],
                columns=self.table.methods[methods],
            )
        return self._means[column]

    def overall(self, column: str) -> pd.Series:
        """Mean over all records of each method, at all levels."""
        return self._by_method(self._average(column, "methods")[0], column)

    def matches(self, column: str) -> pd.Series:
        """Mean over pairs of a number that no method has a part in, by level."""
        means = self._average(column, "levels")[:, 0]
        return pd.Series(means, index=self._levels[0], name=column)

    def smallest_steps(self, column: str) -> pd.Series:
        """Smallest change of any pair's value from one level to the next, by method."""
        drawn = self.table.smallest_steps(column)[:, self._times > 0]
        return self._by_method(np.fmin.reduce(drawn, axis=1), column)

    def count(self, among: pd.Series) -> int:
        """Count some of the records.

        Parameters
        ----------
        among : Series of bool
            Which of `rows`.

        Returns
        -------
        int
            Records of a pair that counts several times do so too.
        """
        return int(self.table.spread(self._times)[among.to_numpy(dtype=bool)].sum())

    def share(self, holds: pd.Series, among: pd.Series) -> float:
        """Find the share of records for which something holds.

        Parameters
        ----------
        holds : Series of bool
            For which of `rows` it does.
        among : Series of bool
            The share of which of `rows`.

        Returns
        -------
        float
            NaN where there are none.
        """
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

    def _average(self, column: str, grouping: Grouping) -> FloatArray:
        """Average a column over pairs: (levels,methods), (1,methods) or (levels,1); NaN for no pair."""
        totals = self._total(column, grouping)
        if self.average == "pooled" and column in _FROM_COUNTS:
            scores = score_counts(*(self._total(name, grouping).sums for name in _COUNTS))
            return np.where(totals.counts > 0, getattr(scores, column), np.nan)
        if self.average == "f_of_means" and column == "f_score":
            precision, recall = (self._total(name, grouping).means() for name in ("precision", "recall"))
            return harmonic_mean(precision, recall)
        return totals.means()

    def _total(self, column: str, grouping: Grouping) -> Totals:
        totals = self.table.total(column, grouping, self._times)
        return totals if grouping == "methods" else self._merge_levels(totals)

    def _by_method(self, values: FloatArray, column: str) -> pd.Series:
        there = self._has_method
        return pd.Series(values[there], index=self.table.methods[there], name=column)

    @cached_property
    def _has_method(self) -> BoolArray:
        """Of which of the table's methods there are records."""
        return self.table.count_rows("methods", self._times)[0] > 0

    @cached_property
    def _times(self) -> FloatArray:
        return np.ones(len(self.table.pairs)) if self.times is None else self.times

    @cached_property
    def _levels(self) -> tuple[pd.Index, IndexArray]:
        """Levels that there are records of, ascending, and the place of each of the table's among them."""
        levels = self.table.levels
        there = self.table.count_rows("levels", self._times)[:, 0] > 0
        if self.times is not None and self.experiment.column == "nms_radius":
            # Such a level is a mean over pairs itself, and two of them can come to be the same.
            counts = self.table.total("n", "levels", self._times).means()[:, 0]
            levels = pd.Index(counts.round(), name=levels.name)
        known = levels[there].unique().sort_values()
        return known, np.where(there, known.get_indexer(levels), -1)

    def _merge_levels(self, totals: Totals) -> Totals:
        """Totals of the levels that there are, from those of all levels of the table."""
        known, place = self._levels
        if len(known) == len(place) and (np.diff(place) == 1).all():
            return totals
        merged = Totals(*(np.zeros((len(known), each.shape[1])) for each in totals))
        for to, each in zip(merged, totals, strict=True):
            np.add.at(to, place[place >= 0], each[place >= 0])
        return merged


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
