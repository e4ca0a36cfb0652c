"""Pipelines compared: they register every pair one after the other, nothing else at work beside them."""

from __future__ import annotations

from contextlib import closing
from typing import TYPE_CHECKING

from cgroup.benchmark.records.types import RegistrationRecord
from cgroup.benchmark.run.lone_process import LoneProcess, ProcessDiedError
from cgroup.benchmark.run.register_pair import register_pair
from cgroup.benchmark.run.stages import KILLED

if TYPE_CHECKING:
    from collections.abc import Callable
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
        with closing(LoneProcess(threads, cores=threads)) as process:
            for each in pending:
                if each.threads == threads:
                    made = _register(process, each, folder)
                    records.add(made)
                    tell(len(made))


def _register(process: LoneProcess, pair: PendingPair, root: str | None) -> list[RegistrationRecord]:
    try:
        return process.call(register_pair, pair.case, pair.threads, pair.pipelines, root)
    except ProcessDiedError:
        pass
    if len(pair.pipelines) == 1:
        return [RegistrationRecord(pair.case, pair.pipelines[0].key, pair.threads, error=KILLED)]
    # One of them did it; each alone shows which.
    alone = (pair._replace(pipelines=(pipeline,)) for pipeline in pair.pipelines)
    return [record for each in alone for record in _register(process, each, root)]
