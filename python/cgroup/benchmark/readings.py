"""Other readings of what the paper leaves open: changes of a configuration, from `readings.toml`."""

from __future__ import annotations

import functools
import sys
from importlib.resources import files
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from cgroup.errors import InputError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # pyright: ignore[reportMissingImports] - on Python 3.10 only

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Reading(_Table):
    """Changes of a configuration.

    Attributes
    ----------
    name, label : str
        Its name in commands, and the change in words.
    methods : dict of str to dict
        Options of methods, by label; they hold in every experiment and in the timing.
    front : dict
        Fields of an experiment's `front`.
    nuisances : dict of str to str
        Nuisances that replace others.
    epsilons : tuple of float
        Thresholds of the experiment `epsilon`.
    without : dict of str to str
        By experiment, a data set to leave out.
    experiments, combinations, data : tuple of str
        Experiments, combinations of detector and descriptor, and data sets that `front` and `nuisances`
        change; all by default.
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


class Question(_Table):
    """A choice that the paper leaves open: what the paper states, the default, and the other readings."""

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
            message = f"reading: got {name!r}; choose from {', '.join(known)}"
            raise InputError(message)
        tables = _apply(tables, known[name])
    return tables


def _apply(tables: dict[str, Any], reading: Reading) -> dict[str, Any]:
    experiments = [part for entry in tables["experiment"] for part in _split(entry, reading)]
    changed: dict[str, Any] = {
        **tables,
        "name": f"{tables['name']}+{reading.name}",
        "experiment": experiments,
    }
    parts: list[dict[str, Any]] = [changed, *experiments, changed.get("timing") or {}]
    for table in parts:
        if table.get("methods"):
            table["methods"] = [_set_options(method, reading) for method in table["methods"]]
    return changed


def _set_options(method: dict[str, Any], reading: Reading) -> dict[str, Any]:
    """Change the options of a method and keep its label, by which results are compared."""
    label = method["label"] or method["name"]
    options = reading.methods.get(label)
    return {**method, "label": label, "options": {**method["options"], **options}} if options else method


def _split(entry: dict[str, Any], reading: Reading) -> Iterator[dict[str, Any]]:
    """Split an experiment into the part that a reading changes, and the rest."""
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
        reached = entry["id"] in (reading.experiments or [entry["id"]]) and dataset in (
            reading.data or [dataset]
        )
        combinations = [
            name for name in entry["combinations"] if reached and name in (reading.combinations or [name])
        ]
        rest = [name for name in entry["combinations"] if name not in combinations]
        if rest:
            yield {**entry, "dataset": [dataset], "combinations": rest}
        if combinations:
            yield {**entry, **changes, "dataset": [dataset], "combinations": combinations}
