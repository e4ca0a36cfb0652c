"""Configurations of a run, read from TOML, and changes of them by other readings of the paper."""

import functools
import itertools
from collections.abc import Iterable, Iterator
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, model_validator

from cgroup._runtime.toml import load_packaged, tomllib
from cgroup.benchmark import entries
from cgroup.benchmark.solver import Solver
from cgroup.errors import InputError
from cgroup.io.files import load_text
from cgroup.registry import METHODS

__all__ = ["Config", "parse_config", "read_config"]

_PRESETS = resources.files("cgroup.benchmark") / "presets"


class Config(entries.Table):
    """Configuration of a run.

    The documentation of the benchmark lists the keys of all tables.

    Attributes
    ----------
    name, title : str
        Of the run, for the records and the report.
    seed : int
        Key of all random numbers.
    methods, experiment : tuple
        Methods of every set that names none, and experiments.
    timing, registration, scenes, trials : optional
        Times of the methods, and comparisons of pipelines and of methods.

    Raises
    ------
    pydantic.ValidationError
        For an unknown key or method, a value of another type or out of range, two methods of one label, two
        fronts for one experiment, data set and combination, or a configuration without sets.
    """

    name: str
    title: str = ""
    seed: entries.Seed = 0
    methods: entries.Methods = tuple(entries.MethodEntry(name=name) for name in METHODS)
    experiment: tuple[entries.ExperimentEntry, ...] = ()
    timing: entries.TimingEntry | None = None
    registration: entries.RegistrationEntry | None = None
    scenes: entries.ScenesEntry | None = None
    trials: entries.TrialsEntry | None = None

    @property
    def sets(self) -> tuple[entries.SetEntry, ...]:
        """All sets of problems, without the timing."""
        alone = (self.registration, self.scenes, self.trials)
        return (*self.experiment, *(each for table in alone if table for each in table.sets))

    @model_validator(mode="after")
    def _fits(self) -> "Config":
        if not self.sets:
            names = "experiment, registration, scenes, trials"
            tables = "[[experiment]], [registration], [scenes] or [trials]"
            raise InputError(names, remedy=f"all are missing; give {tables}")
        fronts: dict[tuple[str, str, str], entries.FrontEntry] = {}
        for entry in self.experiment:
            for at in itertools.product([entry.id], entry.dataset, entry.combinations):
                if fronts.setdefault(at, entry.front) != entry.front:
                    raise InputError(f"experiment: {entry.id!r} has two fronts; give each an id of its own")
        trials = () if self.trials is None else (self.trials, *self.trials.sets)
        timing = () if self.timing is None else (self.timing,)
        tables = (self.methods, *(each.methods or () for each in (*self.experiment, *trials, *timing)))
        meant: dict[str, Solver] = {}
        for method in (entry.solver() for table in tables for entry in table):
            if meant.setdefault(method.label, method) != method:
                message = f"methods: two are called {method.label!r}; give each variant a label of its own"
                raise InputError(message)
        return self


def preset_names() -> list[str]:
    """Return the names of the package's configurations."""
    return sorted(
        file.name.removesuffix(".toml") for file in _PRESETS.iterdir() if file.name.endswith(".toml")
    )


def read_config(source: str | Path) -> Config:
    """Read a configuration.

    Parameters
    ----------
    source : str or path
        Name of a preset, also with other readings of the paper (``"paper+gtm-20+mutual"``), or a TOML file.

    Returns
    -------
    Config
        The configuration with defaults filled in.

    Examples
    --------
    >>> from cgroup.benchmark.config import read_config
    >>> config = read_config("smoke")
    >>> config.name, len(config.methods)
    ('smoke', 9)
    """
    preset, *readings = str(source).split("+")
    if preset in preset_names():
        config = parse_config(_PRESETS.joinpath(f"{preset}.toml").read_text(encoding="utf-8"), preset)
        if not readings:
            return config
        return Config.model_validate(apply_readings(config.model_dump(exclude_none=True), readings))
    path = Path(source)
    try:
        text = load_text(path)
    except InputError as error:
        message = f"{source}: neither a readable configuration nor one of {', '.join(preset_names())}"
        raise InputError(message) from error
    return parse_config(text, path.name)


def replace_methods(config: Config, methods: list[str]) -> Config:
    """Replace the methods of a configuration, except in sets that name their own."""
    try:
        return Config.model_validate({**config.model_dump(exclude_defaults=True), "methods": methods})
    except ValidationError as error:
        raise InputError(_first_reason(error)) from error


def parse_config(text: str, name: str = "configuration") -> Config:
    """Read a configuration from TOML text.

    Parameters
    ----------
    text : str
        TOML; its keys are the attributes of `Config`.
    name : str
        Name of the text in errors.

    Returns
    -------
    Config
        The configuration with defaults filled in.
    """
    try:
        return Config.model_validate(tomllib.loads(text))
    except ValidationError as error:
        raise InputError(f"{name}: {_key_path(error.errors()[0]['loc'])}{_first_reason(error)}") from error
    except (ValueError, RecursionError, OverflowError) as error:
        raise InputError(f"{name}: not TOML: {error}") from error


def _first_reason(error: ValidationError) -> str:
    return error.errors()[0]["msg"].removeprefix("Value error, ")


def _key_path(location: tuple[int | str, ...]) -> str:
    path = ""
    for part in location:
        if isinstance(part, int):
            path += f"[{part}]"
        elif part.isidentifier():
            path += f".{part}" if path else part
        # The rest are pydantic's names of types in a choice of several.
    return f"{path}: " if path else ""


# --- readings: changes of a configuration for open points in the paper, from `readings.toml` ---------------


class Reading(entries.Table):
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


class Question(entries.Table):
    """A choice that the paper leaves open: the paper's statement, the default, and the other readings."""

    id: str
    title: str
    paper: str
    default: str
    readings: Annotated[tuple[Reading, ...], Field(min_length=1)]


@functools.cache
def read_questions() -> tuple[Question, ...]:
    """Read all questions."""
    tables = load_packaged("cgroup.benchmark", "readings.toml")["question"]
    return tuple(Question.model_validate(table) for table in tables)


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
