"""Evidence as it would be on other draws of the same pairs (bootstrap: Efron, Annals of Statistics 1979)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from cgroup.benchmark.evidence import Evidence
from cgroup.benchmark.problem import keyed_rng

if TYPE_CHECKING:
    from collections.abc import Iterator

    from cgroup.benchmark.sample import Sample
    from cgroup.types import FloatArray, IndexArray

_SET = ["method", "n", "threads", "dataset", "pair"]
"""What repeats of a time have in common."""


@dataclass(frozen=True, eq=False)
class PairDraws:
    """How often each resample draws each pair.

    Attributes
    ----------
    tables : dict of str to DataFrame
        By data set: one row per resample, one column per pair.
    """

    tables: dict[str, pd.DataFrame]
    _of_samples: dict[Sample, FloatArray] = field(default_factory=dict, repr=False)

    @classmethod
    def make(cls, frame: pd.DataFrame, resamples: int, seed: int) -> PairDraws:
        """Draw as many pairs of each data set as it has, with replacement.

        Parameters
        ----------
        frame : DataFrame
            Records.
        resamples : int
            How often.
        seed : int
            The draws of a data set depend on it and on the names of the pairs only: records of other
            methods on the same pairs are resampled alike.

        Returns
        -------
        PairDraws
            For all data sets of the records.
        """
        tables: dict[str, pd.DataFrame] = {}
        if len(frame):
            for dataset, pairs in frame.groupby("dataset")["pair"]:
                names = sorted(pairs.unique())
                rng = keyed_rng("resampled pairs", seed, names)
                times = rng.multinomial(len(names), np.full(len(names), 1 / len(names)), size=resamples)
                tables[str(dataset)] = pd.DataFrame(times.astype(np.float64), columns=names)
        return cls(tables)

    def times(self, sample: Sample) -> FloatArray:
        """Find how often each resample draws each pair of a sample: (resamples,pairs)."""
        if sample not in self._of_samples:
            self._of_samples[sample] = self.tables[sample.dataset][sample.table.pairs].to_numpy()
        return self._of_samples[sample]


@dataclass(frozen=True, eq=False)
class Resample(Evidence):
    """What another draw of the pairs, and of the repeats of the times, would have shown.

    The data sets that speak for those of the paper stay the same.

    Attributes
    ----------
    frame : DataFrame
        Records of all pairs.
    timing : DataFrame
        The drawn repeats.
    methods : tuple of str
        As of the whole.
    whole : Evidence
        What is resampled.
    draws : PairDraws
        Of all resamples.
    number : int
        Which resample this is, from 0.
    """

    whole: Evidence = field(kw_only=True)
    draws: PairDraws = field(kw_only=True)
    number: int = field(kw_only=True)

    def _find_sample(self, name: str, place: str, *, every_method: bool) -> Sample | None:
        return self._draw(self.whole.sample(name, place, every_method=every_method))

    def _find_same_cases(self, place: str, methods: tuple[str, ...]) -> Sample | None:
        return self._draw(self.whole.same_cases(place, methods))

    def _draw(self, sample: Sample | None) -> Sample | None:
        if sample is None:
            return None
        times = self.draws.times(sample)[self.number]
        return sample.draw(times) if times.any() else None


def resample_evidence(evidence: Evidence, resamples: int, *, seed: int = 0) -> Iterator[Evidence]:
    """Draw the pairs of each data set, and the repeats of each time, with replacement.

    All records of a pair are drawn together: those of all experiments, levels, methods and thresholds.

    Parameters
    ----------
    evidence : Evidence
        On all pairs.
    resamples : int
        How often.
    seed : int
        Of the draws.

    Yields
    ------
    Evidence
        One per resample.
    """
    draws = PairDraws.make(evidence.frame, resamples, seed)
    ordered, repeats = _draw_repeats(evidence.timing, resamples, seed)
    for number in range(resamples):
        yield Resample(
            evidence.frame,
            ordered.take(repeats[number]),
            evidence.methods,
            whole=evidence,
            draws=draws,
            number=number,
        )


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
