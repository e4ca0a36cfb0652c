"""Sums of scores by level, method and pair, of which means over any draw of the pairs are one product."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np
import pandas as pd

if TYPE_CHECKING:
    from cgroup.types import BoolArray, FloatArray, IndexArray

    Grouping: TypeAlias = Literal["cells", "methods", "levels"]


class Totals(NamedTuple):
    """Sums of values and how many they are of; each (levels,methods), (1,methods) or (levels,1).

    Attributes
    ----------
    sums, counts : array of float
        NaNs don't count.
    """

    sums: FloatArray
    counts: FloatArray

    def means(self) -> FloatArray:
        """Means; NaN where there are no values."""
        with np.errstate(invalid="ignore"):
            return self.sums / self.counts


class PairSums:
    """Records of an experiment on a data set, each with the numbers of its level, its method and its pair.

    Parameters
    ----------
    rows : DataFrame
        Records, with the level of each in the column ``x``; NaN for none.

    Attributes
    ----------
    rows : DataFrame
        As given.
    levels, methods, pairs : Index
        Ascending.
    """

    def __init__(self, rows: pd.DataFrame) -> None:
        self.rows = rows
        self._level, self.levels = _number(rows["x"], "x")
        self._method, self.methods = _number(rows["method"], "method")
        self._pair, self.pairs = _number(rows["pair"], "pair")
        self._sums: dict[tuple[str, Grouping], Totals] = {}
        self._steps: dict[str, FloatArray] = {}

    def total(self, column: str, grouping: Grouping, times: FloatArray) -> Totals:
        """Sum a column by level and method ("cells"), by method, or by level.

        Parameters
        ----------
        column : str
            Of the records.
        grouping : "cells", "methods" or "levels"
            "methods": over all records, also those without a level. "levels": one record of each pair,
            level and threshold, for what no method has a part in.
        times : (n,) array of float
            How often each pair counts.

        Returns
        -------
        Totals
            Of the drawn pairs.
        """
        key = (column, grouping)
        if key not in self._sums:
            self._sums[key] = self._sum_by_pair(self.rows[column].to_numpy(dtype=np.float64), grouping)
        sums, counts = self._sums[key]
        return Totals(sums @ times, counts @ times)

    def count_rows(self, grouping: Grouping, times: FloatArray) -> FloatArray:
        """Count records, whatever they say."""
        key = ("", grouping)
        if key not in self._sums:
            self._sums[key] = self._sum_by_pair(np.ones(len(self.rows)), grouping)
        return self._sums[key].counts @ times

    def spread(self, times: FloatArray) -> FloatArray:
        """Give each record the number of times that its pair counts."""
        return times[self._pair]

    def smallest_steps(self, column: str) -> FloatArray:
        """Find the smallest change of each pair's values from one level to the next.

        Parameters
        ----------
        column : str
            Of the records.

        Returns
        -------
        (methods,pairs) array of float
            NaN where a pair has fewer than two values.
        """
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

    def _sum_by_pair(self, values: FloatArray, grouping: Grouping) -> Totals:
        group, shape = self._group(grouping)
        known = (group >= 0) & ~np.isnan(values)
        place = group[known] * shape[2] + self._pair[known]
        size = shape[0] * shape[1] * shape[2]
        return Totals(
            np.bincount(place, weights=values[known], minlength=size).reshape(shape),
            np.bincount(place, minlength=size).astype(np.float64).reshape(shape),
        )

    def _group(self, grouping: Grouping) -> tuple[IndexArray, tuple[int, int, int]]:
        """Find each record's group, -1 for none; return how many levels, methods and pairs there are, too."""
        n_levels, n_methods, n_pairs = len(self.levels), len(self.methods), len(self.pairs)
        if grouping == "methods":
            return self._method, (1, n_methods, n_pairs)
        if grouping == "levels":
            return np.where(self._first_of_each, self._level, -1), (n_levels, 1, n_pairs)
        cell = np.where(self._level >= 0, self._level * n_methods + self._method, -1)
        return cell, (n_levels, n_methods, n_pairs)

    @cached_property
    def _first_of_each(self) -> BoolArray:
        return ~self.rows.duplicated(subset=["pair", "x", "epsilon"]).to_numpy()


def _number(values: pd.Series, name: str) -> tuple[IndexArray, pd.Index]:
    """Replace values by their place among all, -1 for NaN; return these, too."""
    codes, known = pd.factorize(values, sort=True)
    # Python's own strings are found faster than others.
    return codes.astype(np.intp), pd.Index(known, name=name, dtype=None if values.dtype == float else object)
