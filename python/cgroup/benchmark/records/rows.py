"""Rows of the records' file, one function per kind."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Literal

from cgroup.benchmark.records.checksums import checksum

if TYPE_CHECKING:
    import sqlite3

    from cgroup.benchmark.candidates import Candidate
    from cgroup.benchmark.plan import DatasetFacts, PlannedExperiment, PlannedSet, PlannedTrials
    from cgroup.benchmark.records.types import Provenance


def insert_dataset(connection: sqlite3.Connection, facts: DatasetFacts) -> None:
    """Store what is known of a data set."""
    row = (facts.name, facts.title, facts.role, facts.origin, facts.citation)
    insert(connection, "datasets", *row, known="replace")


def insert_experiment(
    connection: sqlite3.Connection,
    entry: int,
    planned: PlannedExperiment,
    pairs: dict[str, dict[str, tuple[str, tuple[str, ...]]]],
) -> None:
    """Ask for the records of one experiment; `pairs` are those of each data set, see `DatasetFacts`."""
    experiment = planned.experiment
    insert(connection, "plan_experiments", entry, experiment.id, experiment.model_dump_json())
    for case in planned.cases:
        origin, protocols = pairs[case.dataset][case.pair]
        pair = (case.dataset, case.pair, origin, json.dumps(protocols), case.nuisance, case.level)
        front = (case.combination, case.detector, case.descriptor, case.nms_radius, case.seed)
        insert(connection, "cases", case.key, *pair, *front, known="replace")
        if case.front:
            insert(connection, "fronts", case.key, case.front, known="replace")
        insert(connection, "plan_cases", entry, case.key, known="ignore")
    for position, method in enumerate(planned.methods):
        insert_method(connection, method)
        insert(connection, "plan_methods", entry, method.key, method.label, position, known="ignore")
    for epsilon in experiment.epsilons:
        insert(connection, "plan_epsilons", entry, epsilon, known="ignore")


def insert_set(
    connection: sqlite3.Connection,
    entry: int,
    planned: PlannedSet,
    pairs: dict[str, dict[str, tuple[str, tuple[str, ...]]]],
) -> None:
    """Ask for the records of one set of pairs; `pairs` are those of each data set, see `DatasetFacts`."""
    insert(connection, "plan_sets", entry, planned.entry.id, planned.threads, planned.entry.model_dump_json())
    for case in planned.cases:
        origin, _ = pairs[case.dataset][case.pair]
        what = (case.dataset, case.pair, origin, case.kind, case.other, case.voxel, case.seed)
        insert(connection, "pair_cases", case.key, *what, known="replace")
        insert(connection, "plan_pairs", entry, case.key, known="ignore")
    for position, pipeline in enumerate(planned.pipelines):
        what = (pipeline.key, pipeline.name, pipeline.options, pipeline.refined)
        insert(connection, "pipelines", *what, known="ignore")
        insert(connection, "plan_pipelines", entry, pipeline.key, pipeline.label, position, known="ignore")


def insert_trials(
    connection: sqlite3.Connection,
    entry: int,
    planned: PlannedTrials,
    pairs: dict[str, dict[str, tuple[str, tuple[str, ...]]]],
) -> None:
    """Ask for the records of one set of problems; `pairs` are those of each data set, see `DatasetFacts`."""
    definition = planned.entry.model_dump_json()
    insert(connection, "plan_trials", entry, planned.entry.id, planned.limit, definition)
    for place, case in enumerate(planned.cases):
        origin, _ = pairs[case.dataset][case.pair]
        what = (case.dataset, case.pair, origin, case.kind, case.other)
        how = (case.matches, case.voxel, case.epsilon, case.seed)
        insert(connection, "problems", case.key, *what, *how, known="replace")
        insert(connection, "plan_problems", entry, case.key, place, known="ignore")
    for place, method in enumerate(planned.methods):
        insert_method(connection, method)
        insert(connection, "plan_candidates", entry, method.key, method.label, place, known="ignore")
    for threads in planned.threads:
        insert(connection, "plan_threads", entry, threads, known="ignore")


def insert_method(connection: sqlite3.Connection, method: Candidate) -> None:
    """Store a method, unless it is there."""
    insert(connection, "methods", method.key, method.name, method.options, known="ignore")


def insert_machine(connection: sqlite3.Connection, provenance: Provenance) -> None:
    """Store the machine that made a record, unless it is there."""
    machine = provenance.machine
    insert(connection, "machines", machine.id, *asdict(machine).values(), known="ignore")


def insert(
    connection: sqlite3.Connection,
    table: str,
    *row: object,
    known: Literal["abort", "ignore", "replace"] = "abort",
) -> None:
    """Add a row with its checksum; `known` says what to do where its key is taken."""
    marks = ", ".join("?" * (len(row) + 1))
    connection.execute(f"insert or {known} into {table} values ({marks})", (*row, checksum(row)))


def list_origin(provenance: Provenance) -> tuple[str, str, str]:
    """Version, machine and time, the last columns of a computed record."""
    return provenance.version, provenance.machine.id, provenance.created
