"""Pipelines compared: they register every pair one after the other, nothing else at work beside them."""

from __future__ import annotations

import multiprocessing
import os
import signal
from contextlib import closing, suppress
from typing import TYPE_CHECKING

from cgroup.benchmark.records.types import RegistrationRecord
from cgroup.benchmark.run.register_pair import register_pair
from cgroup.benchmark.run.stages import KILLED

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess
    from pathlib import Path
    from typing import Any

    from cgroup.benchmark.records.registrations import PendingPair, Registrations


def register_pairs(
    pending: list[PendingPair], records: Registrations, root: Path | None, tell: Callable[[int], Any]
) -> None:
    """Register pairs.

    The work is done in one other process, which may die of a pipeline: that is recorded, and the rest goes
    on in a new one. It is told to compute on as many threads as the pair asks for, before any library loads.

    Parameters
    ----------
    pending : list of PendingPair
        What the records lack.
    records : Registrations
        Where they go to.
    root : path, optional
        Folder with the data; the environment says by default.
    tell : callable
        Called with the number of new records.
    """
    folder = None if root is None else str(root)
    for threads in sorted({each.threads for each in pending}):
        with closing(_Worker(threads)) as worker:
            for each in pending:
                if each.threads == threads:
                    made = _register(worker, each, folder)
                    records.add(made)
                    tell(len(made))


def _register(worker: _Worker, pair: PendingPair, root: str | None) -> list[RegistrationRecord]:
    records = worker.register(pair.case, pair.threads, pair.pipelines, root)
    if records is not None:
        return records
    if len(pair.pipelines) == 1:
        return [RegistrationRecord(pair.case, pair.pipelines[0].key, pair.threads, error=KILLED)]
    # One of them did it; each alone shows which.
    alone = (pair._replace(pipelines=(pipeline,)) for pipeline in pair.pipelines)
    return [record for each in alone for record in _register(worker, each, root)]


class _Worker:
    """A process that registers pairs, started again after it died; it ends with this one, in any case."""

    def __init__(self, threads: int) -> None:
        self._threads = threads
        self._process: BaseProcess | None = None
        self._pipe: Any = None

    def register(self, *task: object) -> list[RegistrationRecord] | None:
        """Call `register_pair` there; None if the process dies of it."""
        pipe = self._pipe or self._start()
        try:
            pipe.send(task)
            return pipe.recv()
        except (EOFError, OSError):
            self.close()
            return None

    def _start(self) -> Any:  # noqa: ANN401 - its type depends on the system
        spawn = multiprocessing.get_context("spawn")
        self._pipe, theirs = spawn.Pipe()
        self._process = spawn.Process(target=_work, args=(theirs, self._threads), daemon=True)
        self._process.start()
        theirs.close()  # so that the pipe ends with the process
        return self._pipe

    def close(self) -> None:
        """End the process."""
        if self._process is not None and self._pipe is not None:
            self._pipe.close()
            self._process.terminate()
            self._process.join()
        self._process = self._pipe = None


def _work(pipe: Connection[Any, Any], threads: int) -> None:
    """Register what comes through a pipe until it is closed."""
    _prepare_process(threads)
    with suppress(EOFError, OSError):
        while True:
            pipe.send(register_pair(*pipe.recv()))


def _prepare_process(threads: int) -> None:
    """Limit the threads of libraries that can't be told otherwise, and leave Ctrl-C to the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ["OMP_NUM_THREADS"] = str(threads)
    if hasattr(os, "sched_setaffinity"):  # on Linux; what TBB goes by
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:threads])
