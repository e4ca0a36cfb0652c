"""The paper's timing experiment (section 5.3): seconds of each method over the number of correspondences.

The sets are those of one pair, made larger by a smaller radius of the detector's non-maximum suppression.
Only the grouping is timed, one method after another with nothing else at work.
"""

from __future__ import annotations

import functools
import hashlib
import json
import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.machine import this_machine
from cgroup.benchmark.packing import pack, unpack
from cgroup.benchmark.results import Provenance
from cgroup.datasets import CorrespondencePair, open_dataset
from cgroup.errors import CgroupError, InputError
from cgroup.registration import correspond

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path
    from typing import Any, TypeAlias

    from cgroup.benchmark.candidates import Candidate
    from cgroup.benchmark.config import Config, Timing
    from cgroup.benchmark.store import Store
    from cgroup.datasets import Dataset, MatchingPair
    from cgroup.types import Correspondences

    Progress: TypeAlias = Callable[[str, int, int], Any]

SHORTEST = 0.02
"""A method that takes fewer seconds is called several times in a row per repeat."""

UNKNOWN_EXPONENT = 2.0
"""Growth that is expected of the seconds with n while only one size has been timed."""

FITTED_FROM = 2000
"""Exponents are fitted to sets of at least so many correspondences."""


@dataclass(frozen=True)
class TimingSet:
    """A set of correspondences to be timed on.

    Attributes
    ----------
    dataset, pair : str
        Where it comes from.
    size : int
        Keypoints aimed at.
    seed : int
        For methods that draw random numbers.
    """

    dataset: str
    pair: str
    size: int
    seed: int

    @property
    def key(self) -> str:
        """Hash of where it comes from."""
        text = json.dumps([self.dataset, self.pair, self.size])
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def take_times(config: Config, timing: Timing, store: Store, root: Path | None, progress: Progress) -> None:
    """Time every method on every set, unless it has been done on this machine.

    Parameters
    ----------
    config, timing : Config, Timing
        What to do.
    store : Store
        Takes the times; those of one method on one set at a time.
    root : path, optional
        Folder with the data.
    progress : callable
        Called with "time" and how many of how many are done.

    Raises
    ------
    InputError
        If none of the data sets is at hand, or the named pair isn't in the first that is.
    """
    dataset_name, dataset = _first_at_hand(timing.dataset, root)
    pair = timing.pair if timing.pair is not None else dataset.pair_names()[0]
    methods = [entry.candidate() for entry in timing.methods or config.methods]
    sets = [TimingSet(dataset_name, pair, size, config.seed) for size in sorted(timing.sizes)]
    load = functools.cache(lambda: dataset.load(pair))
    done, wanted = 0, len(sets) * len(methods) * len(timing.threads)
    progress("time", done, wanted)
    known = _Known(timing)
    for chosen in sets:
        correspondences = _correspondences(chosen, store, load)
        store.plan_timing(chosen.key, methods)
        for method in methods:
            for threads in timing.threads:
                known.take(chosen, correspondences, method, threads, store)
                done += 1
                progress("time", done, wanted)


def measure(call: Callable[[], object], repeats: int) -> list[float]:
    """Seconds of one call, for each repeat after a call that isn't counted.

    Parameters
    ----------
    call : callable
        What to time.
    repeats : int
        How often.

    Returns
    -------
    list of float
        Of a call shorter than `SHORTEST`, the mean of several in a row.
    """
    warm_up = _clocked(call, 1)
    in_a_row = max(1, math.ceil(SHORTEST / max(warm_up, 1e-6)))
    return [_clocked(call, in_a_row) for _ in range(repeats)]


def fit_exponent(n: Sequence[float], seconds: Sequence[float]) -> float:
    """Exponent a of ``seconds ~ n^a``, by least squares in logarithms.

    Parameters
    ----------
    n, seconds : sequence of float
        Sizes and times.

    Returns
    -------
    float
        NaN for fewer than two different sizes.
    """
    if len(set(n)) < 2:
        return float("nan")
    return float(np.polyfit(np.log(n), np.log(seconds), 1)[0])


class _Known:
    """What is known of the times so far, by method and threads."""

    def __init__(self, timing: Timing) -> None:
        self._timing = timing
        self._medians: dict[tuple[str, int], list[tuple[int, float]]] = {}

    def take(
        self, chosen: TimingSet, given: Correspondences, method: Candidate, threads: int, store: Store
    ) -> None:
        """Time a method on a set, or say why not."""
        provenance = Provenance()
        where = (chosen.key, method.key, threads)
        seconds = store.seconds(*where, this_machine().id)
        if len(seconds) != self._timing.repeats:
            expected = self._expected(method, threads, len(given))
            if expected > self._timing.budget:
                reason = f"expected to take {expected:.0f} s per call, more than {self._timing.budget:g} s"
                store.skip_timing(*where, provenance, reason)
                return
            try:
                seconds = self._measured(chosen, given, method, threads)
            except CgroupError as error:
                store.skip_timing(*where, provenance, str(error))
                return
            store.add_seconds(*where, provenance, seconds)
        self._medians.setdefault((method.key, threads), []).append((len(given), float(np.median(seconds))))

    def _measured(
        self, chosen: TimingSet, given: Correspondences, method: Candidate, threads: int
    ) -> list[float]:
        cores = None if threads == 0 else threads
        return measure(lambda: method.run(given, seed=chosen.seed, threads=cores), self._timing.repeats)

    def _expected(self, method: Candidate, threads: int, n: int) -> float:
        """Extrapolate from the two largest sets so far."""
        so_far = self._medians.get((method.key, threads), [])[-2:]
        if not so_far:
            return 0.0
        exponent = fit_exponent([size for size, _ in so_far], [seconds for _, seconds in so_far])
        if math.isnan(exponent):
            exponent = UNKNOWN_EXPONENT
        size, seconds = so_far[-1]
        return seconds * (n / size) ** exponent


def _clocked(call: Callable[[], object], times: int) -> float:
    start = time.perf_counter()
    for _ in range(times):
        call()
    return (time.perf_counter() - start) / times


def _first_at_hand(names: Sequence[str], root: Path | None) -> tuple[str, Dataset]:
    reasons: list[str] = []
    for name in names:
        try:
            dataset = open_dataset(name, root)
            dataset.pair_names()
        except InputError as error:  # noqa: PERF203 - a handful
            reasons.append(f"{name}: {error}")
        else:
            return name, dataset
    message = f"timing: none of the data sets is at hand; {'; '.join(reasons)}"
    raise InputError(message)


def _correspondences(
    chosen: TimingSet, store: Store, load: Callable[[], MatchingPair | CorrespondencePair]
) -> Correspondences:
    content = store.timing_set(chosen.key)
    if content is None:
        made = _matched(chosen, load())
        content = pack(made)
        store.add_timing_set(chosen.key, chosen.dataset, chosen.pair, chosen.size, len(made), content)
    return unpack(content)


def _matched(chosen: TimingSet, pair: MatchingPair | CorrespondencePair) -> Correspondences:
    if isinstance(pair, CorrespondencePair):
        message = f"timing: {chosen.dataset} comes as correspondences; sets of several sizes need clouds"
        raise InputError(message)
    return correspond(
        pair.source,
        pair.target,
        keypoints=chosen.size,
        normals=pair.normals,
        source_viewpoint=pair.source_viewpoint,
        target_viewpoint=pair.target_viewpoint,
    )
