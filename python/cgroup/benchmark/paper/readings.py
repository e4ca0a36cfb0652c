"""The paper's open questions, read in other ways, one at a time and together.

A reading is a list of overrides of what a configuration runs, or of how its records are judged: all are in
`readings.toml`. The experiments that a reading changes are run again under ids that end in its name, by the
same loop as all others; its records then stand in place of the default's.
"""

from __future__ import annotations

import functools
import sys
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import BeforeValidator, Field

from cgroup._checks.values import as_count
from cgroup._runtime.progress import ignore_progress
from cgroup.benchmark.config import Config
from cgroup.benchmark.entries import MethodEntry, Positive, Table, as_list
from cgroup.benchmark.paper.claims import (
    CLAIMS,
    OUTCOMES,
    RESAMPLES,
    check_claims,
    check_evidence,
    resample_outcomes,
)
from cgroup.benchmark.paper.evidence import Average, Evidence
from cgroup.benchmark.paper.verdicts import count_verdicts
from cgroup.datasets import open_dataset
from cgroup.errors import InputError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # pyright: ignore[reportMissingImports] - on Python 3.10 only

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from cgroup.benchmark.entries import ExperimentEntry
    from cgroup.benchmark.paper.claims import Claim, Outcome, Verdict

DEFAULT = "default"
"""Name of the reading that is none."""

SEPARATOR = " / "
"""Between the id of an experiment and the name of the reading that it is run for."""

Names = Annotated[tuple[str, ...], BeforeValidator(as_list)]


# --- What readings are ------------------------------------------------------------------------------------


class Reading(Table):
    """One change against the default, or several together.

    Attributes
    ----------
    name : str
        Short, as tables and options have it.
    label : str
        What is changed, for people.
    methods : dict of str to dict
        Options of methods that take part by this label: they are run once more, on the stored matches.
    front : dict
        Fields of `cgroup.benchmark.config.FrontEntry`: clouds are matched once more.
    nuisances : dict of str to str
        What is done to pairs in place of a nuisance, by that one's name.
    datasets : dict of str to str
        Data sets in place of others, by those others' names.
    epsilons : tuple of float
        Thresholds of the experiment on the inlier threshold.
    without : dict of str to str
        By experiment, a data set whose records are left out.
    solvable : bool
        Whether pairs without a correct match are left out.
    average : {"macro", "pooled", "f_of_means"}
        How the scores of several pairs become one: means over pairs; the scores of all their matches taken
        as one set; or means, but F of the mean precision and the mean recall.
    facts : dict of str to float
        Bounds in pr with which facts about pairs, `overlap`, `clutter` or `occlusion`, are measured again, so
        that pairs come to stand at other levels.
    times : dict of str to str
        Label of the timing experiment whose times a method has, by the method's own.
    experiments, combinations, data : tuple of str
        What the change is tried on: experiments, combinations of detector and descriptor, data sets; all by
        default.
    only : tuple of str
        Methods that another front end makes a difference to; all by default.
    levels : dict of str to tuple of float
        By experiment, other levels.
    together : tuple of str
        Names of readings that are combined; all else is theirs then.
    parts : tuple of Reading
        Those readings; `read_questions` finds them.
    """

    name: str
    label: str
    methods: dict[str, dict[str, Any]] = Field(default_factory=dict)
    front: dict[str, Any] = Field(default_factory=dict)
    nuisances: dict[str, str] = Field(default_factory=dict)
    datasets: dict[str, str] = Field(default_factory=dict)
    epsilons: tuple[Positive, ...] = ()
    without: dict[str, str] = Field(default_factory=dict)
    solvable: bool = False
    average: Average = "macro"
    facts: dict[Literal["clutter", "occlusion", "overlap"], Positive] = Field(default_factory=dict)
    times: dict[str, str] = Field(default_factory=dict)
    experiments: Names = ()
    combinations: Names = ()
    data: Names = ()
    only: Names = ()
    levels: dict[str, tuple[Positive, ...]] = Field(default_factory=dict)
    together: Names = ()
    parts: tuple[Reading, ...] = ()


class Question(Table):
    """Something that the paper leaves open.

    Attributes
    ----------
    id : str
        Short.
    title : str
        What it is about.
    silent : str
        What the paper says of it, and doesn't.
    default : str
        How it is read by default.
    readings : tuple of Reading
        The other ways.
    """

    id: str
    title: str
    silent: str
    default: str
    readings: Annotated[tuple[Reading, ...], Field(min_length=1)]


@functools.cache
def read_questions() -> tuple[Question, ...]:
    """Read all questions."""
    text = files("cgroup.benchmark.paper").joinpath("readings.toml").read_text(encoding="utf-8")
    questions = tuple(Question.model_validate(table) for table in tomllib.loads(text)["question"])
    known = {reading.name: reading for question in questions for reading in question.readings}
    return tuple(
        question.model_copy(update={"readings": tuple(_resolve(each, known) for each in question.readings)})
        for question in questions
    )


def list_readings(names: Sequence[str] | None = None) -> list[Reading]:
    """List readings."""
    questions = read_questions()
    known = {question.id for question in questions}
    known |= {reading.name for question in questions for reading in question.readings}
    for name in names or ():
        if name not in known:
            message = f"reading: got {name!r}; choose from {', '.join(sorted(known))}"
            raise InputError(message)
    return [
        reading
        for question in questions
        for reading in question.readings
        if names is None or question.id in names or reading.name in names
    ]


def name_questions(questions: Iterable[Question]) -> dict[str, str]:
    """Name the question that each reading answers: ids of questions, by the readings' names."""
    return {reading.name: question.id for question in questions for reading in question.readings}


def _resolve(reading: Reading, known: dict[str, Reading]) -> Reading:
    return reading.model_copy(update={"parts": tuple(known[name] for name in reading.together)})


def _changes(reading: Reading) -> tuple[Reading, ...]:
    """List the readings that are combined, or one alone."""
    return reading.parts or (reading,)


# --- What is run again ------------------------------------------------------------------------------------


def add_readings(config: Config, readings: Iterable[Reading]) -> Config:
    """Ask for what readings need besides the records of the default."""
    asked = list(readings)
    _check_experiments(config)
    base = _share_labels(config, asked)
    given = base.model_dump(exclude_defaults=True)
    return Config.model_validate({**given, "experiment": [*given["experiment"], *_expand(base, asked)]})


def _variant_label(method: str, options: Mapping[str, Any]) -> str:
    """Name a method with other options; the same for the same options in all readings."""
    changed = ", ".join(f"{name}={value}" for name, value in sorted(options.items()))
    return f"{method} {changed}" if changed else method


def _plain_label(label: str, reading: Reading) -> str:
    """Label of the method that a variant of a reading is of; that of another method as it is."""
    for method in {method for change in _changes(reading) for method in change.methods}:
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
            changes = [each for each in _changes(reading) if _applies(each, base.id, dataset, combination)]
            alike.setdefault(tuple(change.name for change in changes), []).append(combination)
        for names, combinations in alike.items():
            changes = [change for change in _changes(reading) if change.name in names]
            entry = _change(base, dataset, methods, changes)
            if entry is not None:
                yield {**entry, "id": base.id + SEPARATOR + reading.name, "combinations": combinations}


def _applies(change: Reading, experiment: str, dataset: str, combination: str) -> bool:
    """Tell whether a change is tried there."""
    asked = (
        (change.experiments, experiment),
        (change.data, dataset),
        (change.combinations, combination),
        (tuple(change.datasets), dataset),
    )
    return all(name in named for named, name in asked if named)


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
    label = _variant_label(method.solver().label, changed)
    return {"name": method.name, "label": label, "options": {**method.options, **changed}}


def _list_only(changes: Sequence[Reading]) -> set[str]:
    """Methods that other matches make a difference to; empty for all."""
    named = [each.only for each in changes if each.front or each.nuisances or each.datasets or each.epsilons]
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


# --- Which records a reading has --------------------------------------------------------------------------


def select_default(frame: pd.DataFrame) -> pd.DataFrame:
    """Keep the records of experiments that no reading asks for."""
    if frame.empty:
        return frame
    ids = [tuple(name for name in names if SEPARATOR not in name) for names in frame["experiments"]]
    return _take(frame, ids)


def select_reading(frame: pd.DataFrame, reading: Reading) -> pd.DataFrame:
    """Put the records of a reading in place of those of the default.

    They stand under the plain ids of experiments and labels of methods. The default's stay, but for those of
    an experiment, data set, combination and method that the reading has records of.
    """
    if frame.empty:
        return frame
    suffix = SEPARATOR + reading.name
    own = [
        tuple(name.removesuffix(suffix) for name in names if name.endswith(suffix))
        for names in frame["experiments"]
    ]
    methods = [
        _plain_label(label, reading) if mine else label
        for label, mine in zip(frame["method"], own, strict=True)
    ]
    stands_for = {new: old for change in _changes(reading) for old, new in change.datasets.items()}
    datasets = [stands_for.get(name, name) for name in frame["dataset"]]
    cells = list(zip(datasets, frame["combination"], methods, strict=True))
    replaced = {(name, *cell) for names, cell in zip(own, cells, strict=True) for name in names}
    without = {pair for change in _changes(reading) for pair in change.without.items()}

    def keeps(name: str, dataset: str, cell: tuple[Any, ...]) -> bool:
        """Whether a record of the default goes on to speak for an experiment."""
        return SEPARATOR not in name and (name, *cell) not in replaced and (name, dataset) not in without

    rows = zip(own, frame["experiments"], frame["dataset"], cells, strict=True)
    ids = [(*mine, *(n for n in names if keeps(n, dataset, cell))) for mine, names, dataset, cell in rows]
    chosen = _take(frame.assign(method=methods), ids)
    if any(change.solvable for change in _changes(reading)):
        chosen = chosen[(chosen["correct"] > 0) | (chosen["error"] != "")]
    return chosen


def select_times(timing: pd.DataFrame, reading: Reading | None = None) -> pd.DataFrame:
    """Keep the times of the default, or put a reading's in their place.

    A method then has the times of another only at the sizes at which that one has been timed.
    """
    for change in () if reading is None else _changes(reading):
        for method, other in change.times.items():
            found = timing[timing["method"] == other].assign(method=method)
            rest = timing[(timing["method"] != method) & timing["n"].isin(found["n"])]
            timing = found if rest.empty else pd.concat([rest, found], ignore_index=True)
    return timing


def _take(frame: pd.DataFrame, ids: list[tuple[str, ...]]) -> pd.DataFrame:
    """Keep the records that speak for an experiment, and name those that they speak for."""
    chosen = frame.assign(experiments=ids)
    return chosen[[bool(names) for names in ids]]


def measure_again(frame: pd.DataFrame, reading: Reading, root: Path | None) -> pd.DataFrame:
    """Measure facts about pairs as a reading has it, in place of those measured by default.

    Those of pairs that a nuisance changed stay, and those of data sets that don't measure the fact.
    """
    if frame.empty:
        return frame
    for change in _changes(reading):
        for fact, bound in change.facts.items():
            # A nuisance changes a pair, and what a data set has is the pair before it.
            chosen = frame[fact].notna() & (frame["nuisance"] == "")
            values = frame[fact].copy()
            values[chosen] = _measure(frame[chosen], fact, bound, root)
            frame = frame.assign(**{fact: values.fillna(frame[fact])})
    return frame


def _measure(frame: pd.DataFrame, fact: str, bound: float, root: Path | None) -> list[float]:
    """Return the fact about the pair of each record; NaN where its data set doesn't measure it."""
    datasets = {name: open_dataset(name, root) for name in frame["dataset"].unique()}
    rows = list(zip(frame["dataset"], frame["pair"], strict=True))
    facts = {(name, pair): datasets[name].measure_facts(pair, bound=bound) for name, pair in set(rows)}
    return [facts[row].get(fact, np.nan) for row in rows]


# --- What comes of it -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ReadingOutcome:
    """Verdicts under one reading.

    Attributes
    ----------
    name, label : str
        Of the reading.
    verdicts : dict of str to Verdict
        By claim, in the paper's order, with their stability.
    moved : frozenset of str
        Claims of which a number that is quoted, or the data, is another than under the default.
    better, worse : tuple of str
        Claims whose verdict is better than under the default, and worse; without those that are not
        testable under one of both.
    """

    name: str
    label: str
    verdicts: dict[str, Verdict]
    moved: frozenset[str] = frozenset()
    better: tuple[str, ...] = ()
    worse: tuple[str, ...] = ()

    @property
    def counts(self) -> dict[str, int]:
        """How many claims have which verdict."""
        return count_verdicts(self.verdicts.values())

    def is_close(self, claim: str) -> bool:
        """Tell whether another draw of the pairs would often give another verdict."""
        stability = self.verdicts[claim].stability
        return stability is not None and stability.close


def judge_readings(
    frame: pd.DataFrame,
    timing: pd.DataFrame,
    readings: Sequence[Reading],
    *,
    root: Path | None = None,
    resamples: int = RESAMPLES,
    progress: Callable[[str, int, int], Any] | None = None,
) -> list[ReadingOutcome]:
    """Check the paper's claims on the records of every reading."""
    tell, resamples = progress or ignore_progress, as_count("resamples", resamples, 1)
    tell("judge", 0, 1 + len(readings))
    default = check_claims(select_default(frame), select_times(timing), resamples=resamples)
    before = {verdict.id: verdict for verdict in default}
    outcomes = [ReadingOutcome(DEFAULT, "", before)]
    for reading in readings:
        tell("judge", len(outcomes), 1 + len(readings))
        chosen, times = select_reading(frame, reading), select_times(timing, reading)
        averages: list[Average] = [each.average for each in _changes(reading) if each.average != "macro"]
        average: Average = averages[-1] if averages else "macro"
        evidence = Evidence(measure_again(chosen, reading, root), times, average=average)
        outcomes.append(_judge(evidence, reading, before, resamples))
    tell("judge", len(outcomes), len(outcomes))
    return outcomes


def _judge(
    evidence: Evidence, reading: Reading, before: dict[str, Verdict], resamples: int
) -> ReadingOutcome:
    verdicts = {verdict.id: verdict for verdict in check_evidence(evidence)}
    pairs = [(claim, verdicts[claim.id], before[claim.id]) for claim in CLAIMS]
    moved = [claim for claim, new, old in pairs if (new.measured, new.data) != (old.measured, old.data)]
    change = {claim.id: _count_steps(before[claim.id], verdicts[claim.id]) for claim in moved}
    found: dict[Claim, Outcome] = {claim: verdicts[claim.id].verdict for claim in moved}
    drawn = resample_outcomes(evidence, found, resamples)
    known = {claim: drawn.get(claim) if claim in change else before[claim].stability for claim in verdicts}
    return ReadingOutcome(
        reading.name,
        reading.label,
        {claim: replace(verdict, stability=known[claim]) for claim, verdict in verdicts.items()},
        frozenset(change),
        tuple(claim for claim, steps in change.items() if steps > 0),
        tuple(claim for claim, steps in change.items() if steps < 0),
    )


def _count_steps(before: Verdict, after: Verdict) -> int:
    """By how many steps a verdict is better than before; 0 where one of both is not testable."""
    if "not testable" in {before.verdict, after.verdict}:
        return 0
    return OUTCOMES.index(before.verdict) - OUTCOMES.index(after.verdict)
