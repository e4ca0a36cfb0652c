"""What a check is made of: the evidence that it asks for, and the comparisons that it finds."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple

from cgroup.benchmark.paper import GENERATED, PLACES

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import pandas as pd

    from cgroup.benchmark.evidence import Evidence, Sample

TIE = 0.01
LARGE = 0.1
CLEAR = 0.05
TIME_TIE = math.log(1.05)
"""Tolerances on scores, and on logarithms of times."""

_TIMING = "timing experiment"


class Comparison(NamedTuple):
    """One comparison of numbers.

    Attributes
    ----------
    holds : bool
        Whether it is as the claim says.
    text : str
        What was compared, with the numbers.
    margin : float
        By how much it holds, or fails if negative; NaN where a number is missing.
    """

    holds: bool
    text: str
    margin: float


@dataclass(frozen=True)
class Finding:
    """Outcome of a claim's tests.

    Attributes
    ----------
    tests : sequence of Comparison
        Those with missing numbers don't count.
    need : "all" or "most"
        How many have to hold.
    summary : str
        Numbers worth reading besides those of the tests.
    """

    tests: Sequence[Comparison]
    need: Literal["all", "most"] = "all"
    summary: str = ""


class NotTestableError(Exception):
    """Records that a claim needs are missing; the message says which."""


@dataclass(frozen=True, eq=False)
class ClaimEvidence:
    """The evidence as one claim sees it.

    Attributes
    ----------
    all : Evidence
        The whole.
    used : list of str
        Descriptions of what the claim has asked for.
    generated : list of str
        Data sets among them of which there are generated shapes only.
    """

    all: Evidence
    used: list[str] = field(default_factory=list)
    generated: list[str] = field(default_factory=list)

    def need(self, experiment: str, place: str, *methods: str) -> Sample:
        """Find the records of an experiment with all nine methods, or those named."""
        sample = self.all.sample(experiment, place)
        if sample is None:
            wanted = ", ".join(PLACES[place])
            message = f"no records of experiment '{experiment}' on {place} (data sets: {wanted})"
            raise NotTestableError(message)
        self._remember_sample(sample)
        missing = self._find_missing(methods, sample.rows["method"])
        if missing:
            message = f"no records of {missing} in experiment '{experiment}' on {sample.dataset}"
            raise NotTestableError(message)
        return sample

    def need_same_cases(self, place: str, *methods: str) -> Sample:
        """Find the records of some methods on the cases that all of them were run on."""
        sample = self.all.same_cases(place, methods)
        if sample is None:
            message = f"no case on {place} with {_list_names(methods)}; run an experiment with these methods"
            raise NotTestableError(message)
        self._remember_sample(sample)
        return sample

    def need_times(self, *methods: str) -> pd.DataFrame:
        """Find the mean seconds on one thread: one row per n, one column per method of the paper."""
        timing = self.all.timing
        times = mean_times(timing if timing.empty else timing.loc[timing["method"].isin(self.all.methods)])
        missing = self._find_missing(methods, times.columns)
        if missing:
            message = f"no times of {missing}; run the timing experiment"
            raise NotTestableError(message)
        self._remember(_TIMING)
        self._remember_generated(
            name for name in self.all.timing["dataset"].unique() if name.startswith(GENERATED)
        )
        return times

    def _find_missing(self, methods: Sequence[str], present: Iterable[str]) -> str:
        there = set(present)
        return _list_names([each for each in methods or self.all.methods if each not in there])

    def _remember_sample(self, sample: Sample) -> None:
        self._remember(sample.description)
        if (sample.rows["origin"] == "synthetic").all():
            self._remember_generated([sample.dataset])

    def _remember_generated(self, names: Iterable[str]) -> None:
        self.generated.extend(name for name in names if name not in self.generated)

    def _remember(self, description: str) -> None:
        if description not in self.used:
            self.used.append(description)


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
    return single.pivot_table(index="n", columns="method", values="seconds", aggfunc="mean")


def _list_names(methods: Sequence[str]) -> str:
    return ", ".join(each.upper() for each in methods)
