"""Which experiments are run again for a reading, and how."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cgroup.benchmark.config import Config

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from cgroup.benchmark.config import ExperimentEntry, MethodEntry
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
        methods whose options it changes, on the same matches; or all methods, on others.

    Raises
    ------
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
    added = [
        entry
        for reading in readings
        for base in config.experiment
        for entry in _read_experiment(base, base.methods or config.methods, reading)
    ]
    given = config.model_dump(exclude_defaults=True)
    return Config.model_validate({**given, "experiment": [*given["experiment"], *added]})


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


def plain_label(label: str) -> str:
    """Label of the method that a variant is of."""
    return label.split(" ", maxsplit=1)[0] if "=" in label else label


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
    only = {name for change in changes for name in change.only}
    chosen = [
        _vary(method, options.get(method.candidate().label, {}))
        for method in methods
        if method.candidate().label in options or (anew and (not only or method.candidate().label in only))
    ]
    if not chosen:
        return None
    entry = base.model_dump(exclude_defaults=True)
    entry |= {"dataset": [other], "methods": chosen, "nuisance": nuisance}
    entry |= {"front": front} if front else {}
    entry |= {"epsilons": epsilons[-1]} if epsilons else {}
    for change in changes:
        entry |= {"pairs": change.pairs[base.id]} if base.id in change.pairs else {}
        entry |= {"levels": change.levels[base.id]} if base.id in change.levels else {}
    return entry


def _vary(method: MethodEntry, options: Mapping[str, Any]) -> dict[str, Any]:
    label = variant_label(method.candidate().label, options)
    return {"name": method.name, "label": label, "options": {**method.options, **options}}


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
