"""Records of the comparison of pipelines, in the same file as the others."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from cgroup.benchmark.cases import PairCase
from cgroup.benchmark.pipelines import Pipeline
from cgroup.benchmark.records.rows import insert, insert_machine, list_origin
from cgroup.benchmark.records.schema import PAIR_ORDER, PENDING_REGISTRATIONS

if TYPE_CHECKING:
    from collections.abc import Iterable

    from cgroup.benchmark.records.store import Store
    from cgroup.benchmark.records.types import RegistrationRecord


class PendingPair(NamedTuple):
    """A pair that pipelines are still to be run on."""

    case: PairCase
    threads: int
    pipelines: tuple[Pipeline, ...]


class Registrations:
    """Pairs of clouds, and what pipelines made of them.

    Parameters
    ----------
    store : Store
        Open for writing.
    """

    def __init__(self, store: Store) -> None:
        self._store = store

    def pending(self) -> list[PendingPair]:
        """Pairs to be registered, with the pipelines that are missing."""
        fields = "dataset, pair, kind, other, voxel, seed, w.threads, w.pipeline_key"
        query = f"{PENDING_REGISTRATIONS.format(fields)} {PAIR_ORDER}, w.case_key, w.pipeline_key"
        pipelines = self._pipelines()
        found: dict[tuple[PairCase, int], list[Pipeline]] = {}
        for *case, threads, key in self._store.connection.execute(query):
            found.setdefault((PairCase(*case), threads), []).append(pipelines[key])
        return [PendingPair(case, threads, tuple(missing)) for (case, threads), missing in found.items()]

    def add(self, records: Iterable[RegistrationRecord]) -> None:
        """Store records, all or none."""
        with self._store.transaction() as connection:
            for each in records:
                insert_machine(connection, each.provenance)
                what = (each.case.key, each.pipeline_key, each.threads, each.voxel, each.pr, each.overlap)
                answer = (each.pose, each.ok, each.probability)
                errors = (each.rotation_error, each.translation_error, each.rmse)
                how = (each.seconds, each.error, *list_origin(each.provenance))
                insert(connection, "registrations", *what, *answer, *errors, *how)

    def _pipelines(self) -> dict[str, Pipeline]:
        """Every pipeline that was ever asked for, by key."""
        rows = self._store.connection.execute("select key, name, options, refined from pipelines")
        return {key: Pipeline(name, name, options, bool(refined)) for key, name, options, refined in rows}
