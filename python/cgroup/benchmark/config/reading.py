"""What is to be run, read from TOML: experiments, methods and thresholds."""

from __future__ import annotations

import itertools
import sys
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, ValidationError, model_validator

from cgroup.benchmark.config.entries import ExperimentEntry, MethodEntry, Methods, TimingEntry
from cgroup.benchmark.config.registration import RegistrationEntry
from cgroup.benchmark.config.table import Table
from cgroup.benchmark.config.trials import TrialsEntry
from cgroup.errors import InputError
from cgroup.io._files import load_text
from cgroup.registry import METHODS

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # pyright: ignore[reportMissingImports] - on Python 3.10 only

if TYPE_CHECKING:
    from cgroup.benchmark.candidates import Candidate
    from cgroup.benchmark.config.front import FrontEntry

_PRESETS = resources.files("cgroup.benchmark") / "presets"


class Config(Table):
    """Everything that one run computes.

    Attributes
    ----------
    name : str
        Of the run.
    title : str
        Of the run, for the report.
    seed : int
        Key of all random numbers.
    methods : tuple of MethodEntry
        Those that every experiment runs unless it names its own; all that exist by default. ``"paper"``
        stands for the nine that the paper compares, and ``"all"`` for all that exist.
    experiment : tuple of ExperimentEntry
        Of the grouping methods.
    timing : TimingEntry, optional
        Runs after the experiments, alone.
    registration : RegistrationEntry, optional
        Ways to register, compared; runs alone.
    trials : TrialsEntry, optional
        Grouping methods on matches of any kind, compared; runs last, alone.

    Raises
    ------
    pydantic.ValidationError
        For an unknown key or method, a value of another type or out of range, two methods of one label, two
        fronts for one experiment, data set and combination, or nothing to be run.

    Examples
    --------
    >>> from cgroup.benchmark.config import Config
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gc", "gtm"], experiment=[small])
    >>> [method.name for method in config.methods], config.experiment[0].pairs
    (['gc', 'gtm'], 2)
    """

    name: str
    title: str = ""
    seed: Annotated[int, Field(ge=0)] = 0
    methods: Methods = tuple(MethodEntry(name=name) for name in METHODS)
    experiment: tuple[ExperimentEntry, ...] = ()
    timing: TimingEntry | None = None
    registration: RegistrationEntry | None = None
    trials: TrialsEntry | None = None

    @model_validator(mode="after")
    def _fits(self) -> Config:
        if not self.experiment and self.registration is None and self.trials is None:
            message = (
                "experiment, registration, trials: none is there; give [[experiment]], [registration] or "
                "[trials]"
            )
            raise InputError(message)
        fronts: dict[tuple[str, str, str], FrontEntry] = {}
        for entry in self.experiment:
            for at in itertools.product([entry.id], entry.dataset, entry.combinations):
                if fronts.setdefault(at, entry.front) != entry.front:
                    message = f"experiment: {entry.id!r} is there with two fronts; give each an id of its own"
                    raise InputError(message)
        of_trials = () if self.trials is None else (self.trials, *self.trials.sets)
        entries = (*self.experiment, *of_trials, *((self.timing,) if self.timing else ()))
        tables = [self.methods, *(entry.methods for entry in entries if entry.methods)]
        meant: dict[str, Candidate] = {}
        for method in (entry.candidate() for table in tables for entry in table):
            if meant.setdefault(method.label, method) != method:
                message = f"methods: two are called {method.label!r}; give each variant a label of its own"
                raise InputError(message)
        return self


def preset_names() -> list[str]:
    """Name the configurations that come with the package.

    Returns
    -------
    list of str
        What `read_config` takes besides files.

    Examples
    --------
    >>> from cgroup.benchmark.config import preset_names
    >>> "smoke" in preset_names()
    True
    """
    return sorted(
        file.name.removesuffix(".toml") for file in _PRESETS.iterdir() if file.name.endswith(".toml")
    )


def read_config(source: str | Path) -> Config:
    """Read a configuration.

    Parameters
    ----------
    source : str or path
        Name of a preset, or a TOML file.

    Returns
    -------
    Config
        What is to be run, with defaults filled in.

    Raises
    ------
    InputError
        If there is no such file or preset, or for the first thing that is wrong in it, with the key's path.

    Examples
    --------
    >>> from cgroup.benchmark.config import read_config
    >>> config = read_config("smoke")
    >>> config.name, len(config.methods)
    ('smoke', 9)
    """
    if str(source) in preset_names():
        return parse_config(_PRESETS.joinpath(f"{source}.toml").read_text(encoding="utf-8"), str(source))
    path = Path(source)
    try:
        text = load_text(path)
    except InputError as error:
        message = f"{source}: no configuration that can be read, nor one of {', '.join(preset_names())}"
        raise InputError(message) from error
    return parse_config(text, path.name)


def replace_methods(config: Config, methods: list[str]) -> Config:
    """Return a configuration that runs other methods.

    Experiments that name their own methods keep these.

    Parameters
    ----------
    config : Config
        Left as it is.
    methods : list of str
        Names, or ``"paper"`` and ``"all"``.

    Returns
    -------
    Config
        The same otherwise.

    Raises
    ------
    InputError
        If there is no such method.

    Examples
    --------
    >>> from cgroup.benchmark.config import read_config, replace_methods
    >>> config = replace_methods(read_config("smoke"), ["gtm", "lc"])
    >>> [method.name for method in config.methods]
    ['gtm', 'lc']
    """
    try:
        return Config.model_validate({**config.model_dump(exclude_defaults=True), "methods": methods})
    except ValidationError as error:
        raise InputError(error.errors()[0]["msg"].removeprefix("Value error, ")) from error


def parse_config(text: str, name: str = "configuration") -> Config:
    """Read a configuration from TOML text.

    Parameters
    ----------
    text : str
        TOML; its keys are the attributes of `Config`.
    name : str
        What errors call it.

    Returns
    -------
    Config
        What is to be run, with defaults filled in.

    Raises
    ------
    InputError
        If it is no TOML, or for the first thing that is wrong in it, with the key's path.

    Examples
    --------
    >>> from cgroup.benchmark.config import parse_config
    >>> config = parse_config(
    ...     '''
    ...     name = "mine"
    ...     methods = ["gtm", { name = "gc", label = "GC, 2 pr", options = { tolerance_pr = 2 } }]
    ...
    ...     [[experiment]]
    ...     id = "noise"
    ...     dataset = "standin-full"
    ...     nuisance = "noise"
    ...     levels = [0.1, 0.3]
    ...     '''
    ... )
    >>> [method.label or method.name for method in config.methods]
    ['gtm', 'GC, 2 pr']
    """
    try:
        return Config.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        message = f"{name}: not TOML: {error}"
        raise InputError(message) from error
    except ValidationError as error:
        first = error.errors()[0]
        reason = first["msg"].removeprefix("Value error, ")
        message = f"{name}: {_key_path(first['loc'])}{reason}"
        raise InputError(message) from error


def _key_path(location: tuple[int | str, ...]) -> str:
    path = ""
    for part in location:
        if isinstance(part, int):
            path += f"[{part}]"
        elif part.isidentifier():
            path += f".{part}" if path else part
        # The rest are pydantic's names of types in a choice of several.
    return f"{path}: " if path else ""
