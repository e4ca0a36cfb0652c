"""Running a configuration: correspond, group, score, then take times, compare pipelines and methods.

Each stage computes what the records lack, so that a run that was stopped goes on where it was.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cgroup._checks.values import as_count
from cgroup._runtime.progress import ignore_progress
from cgroup.benchmark.plan import make_plan
from cgroup.benchmark.records.lock import only_writer
from cgroup.benchmark.records.reading import RECORDS
from cgroup.benchmark.records.registrations import Registrations
from cgroup.benchmark.records.repair import set_damaged_aside
from cgroup.benchmark.records.store import Store, report_failures
from cgroup.benchmark.records.timings import Timings
from cgroup.benchmark.records.trials import Trials
from cgroup.benchmark.records.types import GroupingRecord, MatchingRecord
from cgroup.benchmark.run import scoring, stages
from cgroup.benchmark.run.registering import register_pairs
from cgroup.benchmark.run.timing import take_times
from cgroup.benchmark.run.trials import try_methods
from cgroup.benchmark.run.workers import open_workers
from cgroup.io._results import make_folder

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from typing import Any, TypeAlias

    from cgroup.benchmark.config import Config
    from cgroup.benchmark.records.progress import Counts
    from cgroup.benchmark.run.workers import CallUnordered

    Progress: TypeAlias = Callable[[str, int, int], Any]

_CASES_AT_ONCE = 4  # of one pair to a worker, which then loads it once; lost if the run is killed meanwhile


@dataclass(frozen=True)
class Summary:
    """What a run came to.

    Attributes
    ----------
    counts : dict of str to Counts
        Done, failed and wanted records of each stage: "correspond", "group", "score", "register", "try".
    missing : dict of str to str
        Data sets and pipelines that are not at hand, and why.
    damaged : str
        Which records of earlier runs weren't what had been written, and so were computed anew, and where
        they are kept; empty where all were.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gc", "gtm"], experiment=[small])
    >>> summary = run(config, Path("results"), backend="threading")
    >>> summary.counts["group"], summary.missing
    (Counts(done=4, failed=0, wanted=4), {})
    """

    counts: dict[str, Counts]
    missing: dict[str, str]
    damaged: str = ""

    @property
    def failed(self) -> int:
        """How many pairs couldn't be matched, and groupings and registrations went wrong.

        Examples
        --------
        >>> from cgroup.benchmark.run import Summary
        >>> Summary(counts={}, missing={}).failed
        0
        """
        return sum(count.failed for count in self.counts.values())


def run(
    config: Config,
    out: Path,
    *,
    root: Path | None = None,
    backend: str = "processes",
    workers: int | None = None,
    scheduler: str | None = None,
    retry_failed: bool = False,
    progress: Progress | None = None,
) -> Summary:
    """Compute every record that a configuration asks for and the folder lacks.

    The records do not depend on backend or workers. Stopped at any moment, by a signal or for good, it
    loses only what was under way; called again, it continues. Records that aren't what was written are set
    aside and computed anew.

    Parameters
    ----------
    config : Config
        What to run.
    out : path
        Folder of the records; made if need be.
    root : path, optional
        Folder with the data, at the same place on every machine; the environment says by default.
    backend : str
        "processes" of this machine, "dask" (a cluster) or "threading".
    workers : int, optional
        How many; one per core by default. A cluster's own number counts with "dask".
    scheduler : str, optional
        Address of the Dask scheduler; ``DASK_SCHEDULER_ADDRESS`` by default.
    retry_failed : bool
        Try again what failed.
    progress : callable, optional
        Called with the stage and how many of how many records are there, as they come in.

    Returns
    -------
    Summary
        What failed is counted there, and doesn't stop the rest.

    Raises
    ------
    InputError
        If no data set is at hand, the backend isn't or is unknown, `workers` is not at least 1, another run
        uses the folder, or the records can't be read or written: the disk is full, say. What is finished is
        kept then.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.benchmark import records
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gc", "gtm"], experiment=[small])
    >>> run(config, Path("results"), backend="threading").failed
    0
    >>> len(records.load(Path("results")))  # two methods on two pairs
    4
    """
    if workers is not None:
        as_count("workers", workers, 1)
    stages.forget_pairs()
    plan = make_plan(config, root)
    make_folder(out)
    file = out / RECORDS
    with only_writer(out), report_failures(file):
        damaged = set_damaged_aside(file)
        with closing(Store(file)) as store:
            store.replace_plan(plan)
            if retry_failed:
                store.forget_failures()
            stage = _StageProgress(store, progress or ignore_progress)
            with open_workers(backend, workers, scheduler) as call_unordered:
                _correspond(store, call_unordered, root, stage)
                _group(store, call_unordered, stage)
            _score(store, stage)
            if config.timing is not None:
                take_times(config, config.timing, Timings(store), root, progress or ignore_progress)
            if config.registration is not None:
                _register(store, root, stage)
            if config.trials is not None:
                _try(store, root, stage)
            return Summary(store.counts(), plan.missing, damaged)


def _correspond(
    store: Store, call_unordered: CallUnordered, root: Path | None, stage: _StageProgress
) -> None:
    folder = None if root is None else str(root)
    tasks = [(cases, folder) for cases in store.pending_cases(_CASES_AT_ONCE)]
    stage.begin("correspond")
    for (cases, _), matched in call_unordered(stages.match_cases, tasks) if tasks else ():
        records = matched or [MatchingRecord(case, error=stages.KILLED) for case in cases]
        store.add_matchings(records)
        stage.add(len(records))


def _group(store: Store, call_unordered: CallUnordered, stage: _StageProgress) -> None:
    pending = store.pending_groupings()
    stage.begin("group")

    def tasks() -> Iterator[tuple[object, ...]]:
        # Drawn one by one: all the correspondences together may not fit into memory.
        for case_key, seed, methods in pending:
            yield case_key, seed, store.content(case_key), methods

    results = call_unordered(stages.group_case, tasks()) if pending else ()
    for (key, *_, methods), grouped in results:
        records = grouped or [GroupingRecord(key, method.key, error=stages.KILLED) for method in methods]
        store.add_groupings(records)
        stage.add(len(records))


def _score(store: Store, stage: _StageProgress) -> None:
    pending = store.pending_scores()
    stage.begin("score")
    for case_key, wanted in pending.items():
        truth = scoring.Truth.unpack(case_key, *store.truth(case_key))
        records = [
            record
            for method_key, mask, pose in store.groupings(case_key)
            if method_key in wanted
            for record in scoring.score_grouping(truth, method_key, mask, pose, wanted[method_key])
        ]
        store.add_scores(records)
        stage.add(len(records))


def _register(store: Store, root: Path | None, stage: _StageProgress) -> None:
    records = Registrations(store)
    stage.begin("register")
    register_pairs(records.pending(), records, root, stage.add)


def _try(store: Store, root: Path | None, stage: _StageProgress) -> None:
    records = Trials(store)
    stage.begin("try")
    try_methods(records.pending(), records, root, stage.add)


class _StageProgress:
    """Passes on how far a stage is, with what earlier runs have done."""

    def __init__(self, store: Store, progress: Progress) -> None:
        self._store = store
        self._progress = progress
        self._stage, self._done, self._wanted = "", 0, 0

    def begin(self, stage: str) -> None:
        counts = self._store.counts()[stage]
        self._stage, self._done, self._wanted = stage, counts.done + counts.failed, counts.wanted
        self.add(0)

    def add(self, records: int) -> None:
        self._done += records
        self._progress(self._stage, self._done, self._wanted)
