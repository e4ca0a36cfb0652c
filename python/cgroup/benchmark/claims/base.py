"""What a check is made of: the evidence that it asks for, and the comparisons that it finds."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple

from cgroup.benchmark.paper import GENERATED, PLACES

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import pandas as pd

    from cgroup.benchmark.evidence import Evidence
    from cgroup.benchmark.sample import Sample

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
    used : list of Sample or str
        What the claim has asked for.
    """

    all: Evidence
    used: list[Sample | str] = field(default_factory=list)

    def need(self, experiment: str, place: str, *methods: str) -> Sample:
        """Find the records of an experiment with all nine methods, or those named."""
        sample = self.all.sample(experiment, place)
        if sample is None:
            wanted = ", ".join(PLACES[place])
            message = f"no records of experiment '{experiment}' on {place} (data sets: {wanted})"
            raise NotTestableError(message)
        self._remember(sample)
        missing = self._find_missing(methods, sample.methods)
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
        self._remember(sample)
        return sample

    def need_times(self, *methods: str) -> pd.DataFrame:
        """Find the mean seconds on one thread: one row per n, one column per method of the paper."""
        times = self.all.mean_times
        missing = self._find_missing(methods, times.columns)
        if missing:
            message = f"no times of {missing}; run the timing experiment"
            raise NotTestableError(message)
        self._remember(_TIMING)
        return times

    def describe(self) -> str:
        """Name what the claim has asked for."""
        return "; ".join(
            dict.fromkeys(each if isinstance(each, str) else each.description for each in self.used)
        )

    def list_generated(self) -> list[str]:
        """List data sets that the claim has asked for of which there are generated shapes only."""
        found: list[str] = []
        for each in self.used:
            if isinstance(each, str):
                names = self.all.timing["dataset"].unique()
                found += [name for name in names if name.startswith(GENERATED)]
            elif each.is_generated:
                found.append(each.dataset)
        return list(dict.fromkeys(found))

    def _find_missing(self, methods: Sequence[str], present: Iterable[str]) -> str:
        there = set(present)
        return _list_names([each for each in methods or self.all.methods if each not in there])

    def _remember(self, asked: Sample | str) -> None:
        if asked not in self.used:
            self.used.append(asked)


def _list_names(methods: Sequence[str]) -> str:
    return ", ".join(each.upper() for each in methods)
