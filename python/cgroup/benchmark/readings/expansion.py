"""Which experiments are run again for a reading, and how."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cgroup.benchmark.config import Config, MethodEntry
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from cgroup.benchmark.config import ExperimentEntry
    from cgroup.benchmark.readings.reading import Reading

SEPARATOR = " / "
"""Between the id of an experiment and the name of the reading that it is run for."""


def add_readings(config: Config, readings: Iterable[Reading]) -> Config:
    """Ask for what readings need besides the records of the default.

    Parameters
    ----------
    config : Config
        The default.
    readings : iterable of Reading
        What is to be tried.

    Returns
    -------
    Config
        With further experiments, whose ids end in the reading's name, of what that reading can move: the
        methods whose options it changes, on the same matches; or all methods, on others. What the default
        runs with the options of a reading under another label has the reading's label.

    Raises
    ------
    InputError
        If the configuration has no experiments, or one whose id looks like that of a reading.
    pydantic.ValidationError
        If a reading gives a method an option that it doesn't have.

    Examples
    --------
    >>> from cgroup.benchmark.config import read_config
    >>> from cgroup.benchmark.readings import add_readings, list_readings
    >>> config = add_readings(read_config("smoke"), list_readings(["gtm-20"]))
    >>> (
    ...     config.experiment[-1].id,
    ...     [method.label for method in config.experiment[-1].methods],
    ... )
    ('variants / gtm-20', ['gtm+ransac iterations=20'])
    """
    asked = list(readings)
    _check_experiments(config)
    base = _share_labels(config, asked)
    given = base.model_dump(exclude_defaults=True)
    return Config.model_validate({**given, "experiment": [*given["experiment"], *_expand(base, asked)]})


def variant_label(method: str, options: Mapping[str, Any]) -> str:
    """Name a method with other options; the same for the same options, whatever reading asks for them.

    Parameters
    ----------
    method : str
        Label of the method.
    options : mapping
        What is changed.

    Returns
    -------
    str
        Without a change, the label itself.
    """
    changed = ", ".join(f"{name}={value}" for name, value in sorted(options.items()))
    return f"{method} {changed}" if changed else method


def plain_label(label: str, reading: Reading) -> str:
    """Label of the method that a variant of a reading is of; that of another method as it is."""
    for method in {method for change in reading.changes for method in change.methods}:
        if label.startswith(f"{method} ") and "=" in label:
            return method
    return label


def _check_experiments(config: Config) -> None:
    if not config.experiment:
        message = f"config: {config.name!r} has no [[experiment]], which readings repeat; add one"
        raise InputError(message)
    for experiment in config.experiment:
        if SEPARATOR in experiment.id:
            message = (
                f"config: got the experiment {experiment.id!r}; {SEPARATOR!r} sets off the names of "
                "readings, choose another id"
            )
            raise InputError(message)


def _expand(config: Config, readings: Iterable[Reading]) -> list[dict[str, Any]]:
    """All experiments that readings ask for."""
    return [
        entry
        for reading in readings
        for base in config.experiment
        for entry in _read_experiment(base, base.methods or config.methods, reading)
    ]


def _share_labels(config: Config, readings: Sequence[Reading]) -> Config:
    """Give methods that are the same as a variant its label: records know both by one label only."""
    methods = [method for entry in config.experiment for method in entry.methods or config.methods]
    known = {method.solver().label for method in methods}
    varied = (MethodEntry(**method) for entry in _expand(config, readings) for method in entry["methods"])
    labels = {method.solver().key: method.label for method in varied if method.label not in known}

    def relabel(given: tuple[MethodEntry, ...] | None) -> tuple[MethodEntry, ...] | None:
        return given and tuple(
            method.model_copy(update={"label": labels.get(method.solver().key, method.label)})
            for method in given
        )

    experiments = (
        entry.model_copy(update={"methods": relabel(entry.methods)}) for entry in config.experiment
    )
    return config.model_copy(update={"methods": relabel(config.methods), "experiment": tuple(experiments)})


def _read_experiment(
    base: ExperimentEntry, methods: Sequence[MethodEntry], reading: Reading
) -> Iterator[dict[str, Any]]:
    """Experiments of one, each on one data set, with the combinations to which the same changes apply."""
    for dataset in base.dataset:
        alike: dict[tuple[str, ...], list[str]] = {}
        for combination in base.combinations:
            changes = [each for each in reading.changes if each.applies_to(base.id, dataset, combination)]
            alike.setdefault(tuple(change.name for change in changes), []).append(combination)
        for names, combinations in alike.items():
            changes = [change for change in reading.changes if change.name in names]
            entry = _change(base, dataset, methods, changes)
            if entry is not None:
                yield {**entry, "id": base.id + SEPARATOR + reading.name, "combinations": combinations}


def _change(
    base: ExperimentEntry, dataset: str, methods: Sequence[MethodEntry], changes: Sequence[Reading]
) -> dict[str, Any] | None:
    """One experiment on one data set, changed; None where the changes make no difference to it."""
    options = _merge(change.methods for change in changes)
    front = {name: value for change in changes for name, value in change.front.items()}
    nuisance = _replace(base.nuisance, (change.nuisances for change in changes))
    other = _replace(dataset, (change.datasets for change in changes))
    epsilons = [change.epsilons for change in changes if change.epsilons and base.id == "epsilon"]
    anew = bool(front or epsilons) or (nuisance, other) != (base.nuisance, dataset)
    only = _list_only(changes)
    chosen = [
        _vary(method, options.get(method.solver().label, {}))
        for method in methods
        if method.solver().label in options or (anew and (not only or method.solver().label in only))
    ]
    if not chosen:
        return None
    entry = base.model_dump(exclude_defaults=True)
    entry |= {"dataset": [other], "methods": chosen, "nuisance": nuisance}
    entry |= {"front": entry.get("front", {}) | front} if front else {}
    entry |= {"epsilons": epsilons[-1]} if epsilons else {}
    for change in changes:
        entry |= {"levels": change.levels[base.id]} if base.id in change.levels else {}
    return entry


def _vary(method: MethodEntry, options: Mapping[str, Any]) -> dict[str, Any]:
    changed = {name: value for name, value in options.items() if method.options.get(name) != value}
    label = variant_label(method.solver().label, changed)
    return {"name": method.name, "label": label, "options": {**method.options, **changed}}


def _list_only(changes: Sequence[Reading]) -> set[str]:
    """Methods that other matches make a difference to; empty for all."""
    named = [change.only for change in changes if change.makes_other_matches]
    return set().union(*named) if all(named) else set()


def _merge(tables: Iterable[Mapping[str, Mapping[str, Any]]]) -> dict[str, dict[str, Any]]:
    merged: dict[str, dict[str, Any]] = {}
    for table in tables:
        for name, values in table.items():
            merged.setdefault(name, {}).update(values)
    return merged


def _replace(name: str, tables: Iterable[Mapping[str, str]]) -> str:
    for table in tables:
        name = table.get(name, name)
    return name
