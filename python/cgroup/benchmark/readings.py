"""Other readings of open points in the paper: changes of a configuration, from `readings.toml`."""

import functools
from collections.abc import Iterable, Iterator
from importlib.resources import files
from typing import Annotated, Any

from pydantic import Field

from cgroup._runtime.toml import tomllib
from cgroup.benchmark.entries import Table
from cgroup.errors import InputError


class Reading(Table):
    """Changes of a configuration.

    `methods` are options of methods by label, in every experiment and in the timing. `front` and `nuisances`
    change the front end and replace nuisances in some experiments, combinations of detector and descriptor,
    and data sets; in all by default. `epsilons` are the thresholds of the experiment `epsilon`. `without` has
    a data set to leave out, by experiment.
    """

    name: str
    label: str
    methods: dict[str, dict[str, Any]] = Field(default_factory=dict)
    front: dict[str, Any] = Field(default_factory=dict)
    nuisances: dict[str, str] = Field(default_factory=dict)
    epsilons: tuple[float, ...] = ()
    without: dict[str, str] = Field(default_factory=dict)
    experiments: tuple[str, ...] = ()
    combinations: tuple[str, ...] = ()
    data: tuple[str, ...] = ()


class Question(Table):
    """A choice that the paper leaves open: the paper's statement, the default, and the other readings."""

    id: str
    title: str
    paper: str
    default: str
    readings: Annotated[tuple[Reading, ...], Field(min_length=1)]


@functools.cache
def read_questions() -> tuple[Question, ...]:
    """Read all questions."""
    text = files("cgroup.benchmark").joinpath("readings.toml").read_text(encoding="utf-8")
    return tuple(Question.model_validate(table) for table in tomllib.loads(text)["question"])


def apply_readings(tables: dict[str, Any], names: Iterable[str]) -> dict[str, Any]:
    """Return the tables of a validated configuration with the changes of some readings, in this order."""
    known = {reading.name: reading for question in read_questions() for reading in question.readings}
    for name in names:
        if name not in known:
            raise InputError(f"reading: got {name!r}; choose from {', '.join(known)}")
        experiments = [part for entry in tables["experiment"] for part in _split(entry, known[name])]
        tables = {**tables, "name": f"{tables['name']}+{name}", "experiment": experiments}
        for table in (tables, *experiments, tables.get("timing") or {}):
            if table.get("methods"):
                table["methods"] = [_set_options(method, known[name]) for method in table["methods"]]
    return tables


def _set_options(method: dict[str, Any], reading: Reading) -> dict[str, Any]:
    """Change the options of a method and keep its label, by which results are compared."""
    label = method["label"] or method["name"]
    options = reading.methods.get(label)
    return {**method, "label": label, "options": {**method["options"], **options}} if options else method


def _split(entry: dict[str, Any], reading: Reading) -> Iterator[dict[str, Any]]:
    """Split an experiment into the part that a reading changes and the rest."""
    kept = [name for name in entry["dataset"] if reading.without.get(entry["id"]) != name]
    if not (reading.front or reading.nuisances):
        thresholds = {"epsilons": reading.epsilons} if reading.epsilons and entry["id"] == "epsilon" else {}
        if kept:
            yield {**entry, **thresholds, "dataset": kept}
        return
    changes = {
        "front": {**entry["front"], **reading.front},
        "nuisance": reading.nuisances.get(entry["nuisance"], entry["nuisance"]),
    }
    for dataset in kept:
        reached = not reading.experiments or entry["id"] in reading.experiments
        reached = reached and (not reading.data or dataset in reading.data)
        changed, rest = [], []
        for name in entry["combinations"]:
            fits = reached and (not reading.combinations or name in reading.combinations)
            (changed if fits else rest).append(name)
        if rest:
            yield {**entry, "dataset": [dataset], "combinations": rest}
        if changed:
            yield {**entry, **changes, "dataset": [dataset], "combinations": changed}
