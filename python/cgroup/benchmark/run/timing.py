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

from cgroup.benchmark.records.growth import fit_exponent
from cgroup.benchmark.records.machine import this_machine
from cgroup.benchmark.records.packing import pack, unpack
from cgroup.benchmark.records.types import Provenance
from cgroup.datasets import CorrespondencePair, open_dataset
from cgroup.errors import CgroupError, InputError
from cgroup.registration import correspond

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path
    from typing import Any, TypeAlias

    from cgroup.benchmark.candidates import Candidate
    from cgroup.benchmark.config import Config, TimingEntry
    from cgroup.benchmark.records.timings import Timings
    from cgroup.datasets import Dataset, MatchingPair
    from cgroup.types import Correspondences

    Progress: TypeAlias = Callable[[str, int, int], Any]

SHORTEST = 0.02
"""A method that takes fewer seconds is called several times in a row per repeat."""

UNKNOWN_EXPONENT = 2.0
"""Growth that is expected of the seconds with n while only one size has been timed."""


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


def take_times(
    config: Config, timing: TimingEntry, records: Timings, root: Path | None, progress: Progress
) -> None:
    """Time every method on every set, unless it has been done on this machine.

    Parameters
    ----------
    config, timing : Config, TimingEntry
        What to do.
    records : Timings
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
    dataset_name, dataset = _open_first(timing.dataset, root)
    pair = timing.pair if timing.pair is not None else dataset.pair_names()[0]
    methods = [entry.candidate() for entry in timing.methods or config.methods]
    sets = [TimingSet(dataset_name, pair, size, config.seed) for size in sorted(timing.sizes)]
    load = functools.cache(lambda: dataset.load(pair))
    done, wanted = 0, len(sets) * len(methods) * len(timing.threads)
    progress("time", done, wanted)
    timer = _Timer(timing)
    for chosen in sets:
        correspondences = _prepare_set(chosen, records, load)
        records.ask_for(chosen.key, methods)
        for method in methods:
            for threads in timing.threads:
                timer.take(chosen, correspondences, method, threads, records)
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
    warm_up = _time_calls(call, 1)
    in_a_row = max(1, math.ceil(SHORTEST / max(warm_up, 1e-6)))
    return [_time_calls(call, in_a_row) for _ in range(repeats)]


class _Timer:
    """Takes times, and expects those of larger sets from those of smaller ones."""

    def __init__(self, timing: TimingEntry) -> None:
        self._timing = timing
        self._medians: dict[tuple[str, int], list[tuple[int, float]]] = {}

    def take(
        self, chosen: TimingSet, given: Correspondences, method: Candidate, threads: int, records: Timings
    ) -> None:
        """Time a method on a set, or say why not."""
        provenance = Provenance()
        where = (chosen.key, method.key, threads)
        seconds = records.seconds(*where, this_machine().id)
        if len(seconds) != self._timing.repeats:
            expected = self._expect(method, threads, len(given))
            if expected > self._timing.budget:
                reason = f"expected to take {expected:.0f} s per call, more than {self._timing.budget:g} s"
                records.skip(*where, provenance, reason)
                return
            try:
                seconds = self._measure(chosen, given, method, threads)
            except CgroupError as error:
                records.skip(*where, provenance, str(error))
                return
            records.add_seconds(*where, provenance, seconds)
        self._medians.setdefault((method.key, threads), []).append((len(given), float(np.median(seconds))))

    def _measure(
        self, chosen: TimingSet, given: Correspondences, method: Candidate, threads: int
    ) -> list[float]:
        cores = None if threads == 0 else threads
        return measure(lambda: method.run(given, seed=chosen.seed, threads=cores), self._timing.repeats)

    def _expect(self, method: Candidate, threads: int, n: int) -> float:
        """Extrapolate from the two largest sets so far."""
        so_far = self._medians.get((method.key, threads), [])[-2:]
        if not so_far:
            return 0.0
        exponent = fit_exponent([size for size, _ in so_far], [seconds for _, seconds in so_far])
        if math.isnan(exponent):
            exponent = UNKNOWN_EXPONENT
        size, seconds = so_far[-1]
        return seconds * (n / size) ** exponent


def _time_calls(call: Callable[[], object], times: int) -> float:
    start = time.perf_counter()
    for _ in range(times):
        call()
    return (time.perf_counter() - start) / times


def _open_first(names: Sequence[str], root: Path | None) -> tuple[str, Dataset]:
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


def _prepare_set(
    chosen: TimingSet, records: Timings, load: Callable[[], MatchingPair | CorrespondencePair]
) -> Correspondences:
    content = records.content(chosen.key)
    if content is None:
        made = _match(chosen, load())
        content = pack(made)
        records.add_set(chosen.key, chosen.dataset, chosen.pair, chosen.size, len(made), content)
    return unpack(content)


def _match(chosen: TimingSet, pair: MatchingPair | CorrespondencePair) -> Correspondences:
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
