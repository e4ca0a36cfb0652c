"""Tables of a configuration: methods, experiments, and the timing experiment."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from cgroup.benchmark.candidates import Candidate, candidate
from cgroup.benchmark.cases import COMBINATIONS
from cgroup.benchmark.config.front import FrontEntry
from cgroup.benchmark.config.table import Positive, Table, as_list
from cgroup.errors import InputError
from cgroup.registry import METHODS, PAPER_METHODS

METHOD_SETS = {"paper": PAPER_METHODS, "all": tuple(METHODS)}
"""What a configuration may write in place of names: the nine that the paper compares, and all that exist."""


def _expand_sets(value: object) -> object:
    """Replace the names of sets by those of their methods; what else there is, is checked later."""
    entries = [value] if isinstance(value, str) else value
    if not isinstance(entries, list):
        return entries
    return [method for entry in entries for method in _list_members(entry)]


def _list_members(entry: object) -> tuple[object, ...]:
    return METHOD_SETS.get(entry.strip().casefold(), (entry,)) if isinstance(entry, str) else (entry,)


class MethodEntry(Table):
    """A method, its options, and the label that tells it from its variants.

    Attributes
    ----------
    name : str
        One of `cgroup.METHODS` in any spelling, or ``module:function``.
    label : str
        Name in tables and figures; that in `cgroup.METHODS` by default.
    options : dict
        Keyword arguments; a name that ends in ``_pr`` is a length in pr.

    Raises
    ------
    pydantic.ValidationError
        For an unknown key, method or option, or a value of another type.

    Examples
    --------
    >>> from cgroup.benchmark.config import MethodEntry
    >>> MethodEntry(name="gc", label="GC, 2 pr", options={"tolerance_pr": 2}).label
    'GC, 2 pr'
    """

    name: str
    label: str = ""
    options: dict[str, Any] = Field(default_factory=dict[str, Any])

    @model_validator(mode="before")
    @classmethod
    def _from_name(cls, value: object) -> object:
        return {"name": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _exists(self) -> MethodEntry:
        self.candidate()
        return self

    def candidate(self) -> Candidate:
        """Return what the runner runs.

        Returns
        -------
        Candidate
            The method with its options; its name stands for a label that isn't given.

        Raises
        ------
        InputError
            For a function that can't be imported any more.

        Examples
        --------
        >>> from cgroup.benchmark.config import MethodEntry
        >>> MethodEntry(name="gtm").candidate()
        Candidate(label='gtm', name='gtm', options='{}')
        """
        return candidate(self.label, self.name, self.options)


Methods = Annotated[tuple[MethodEntry, ...], BeforeValidator(_expand_sets), Field(min_length=1)]


class ExperimentEntry(Table):
    """Cases to be run: every pair of data sets, at every level and combination.

    Attributes
    ----------
    id : str
        Names the experiment in records; several entries may share it.
    dataset : tuple of str
        Built-in names or ``module:attribute``.
    nuisance : str
        What is done to the pair, at each of the `levels`: built-in or ``module:function``.
    levels : tuple of float
        Of the nuisance, or of the swept radius.
    sweep : {"nms_radius"}, optional
        The levels are radii of the detector's non-maximum suppression, in pr.
    combinations : tuple of str
        C1 to C6: Harris 3D with SHOT, LFSH, RCS, then ISS with the same three.
    front : FrontEntry
        What differs from the paper's front end; nothing by default.
    epsilons : tuple of float
        A match is correct when it misses its true place by at most so many pr.
    pairs : int or tuple of str, optional
        At most so many pairs, drawn at random by the seed, or those named; all by default.
    methods : tuple of MethodEntry, optional
        In place of the configuration's.

    Raises
    ------
    pydantic.ValidationError
        For an unknown key, a value of another type or out of range, or levels without a nuisance or a sweep.

    Examples
    --------
    >>> from cgroup.benchmark.config import ExperimentEntry
    >>> entry = ExperimentEntry(
    ...     id="noise", dataset="standin-full", nuisance="noise", levels=[0.1, 0.3]
    ... )
    >>> entry.dataset, entry.combinations, entry.epsilons
    (('standin-full',), ('C1',), (5.0,))
    """

    id: str
    dataset: Annotated[tuple[str, ...], BeforeValidator(as_list), Field(min_length=1)]
    nuisance: str = ""
    levels: tuple[float, ...] = ()
    sweep: Literal["nms_radius"] | None = None
    combinations: Annotated[tuple[str, ...], Field(min_length=1)] = ("C1",)
    front: FrontEntry = FrontEntry()
    epsilons: Annotated[tuple[Positive, ...], BeforeValidator(as_list), Field(min_length=1)] = (5.0,)
    pairs: Annotated[int, Field(ge=1)] | tuple[str, ...] | None = None
    methods: Methods | None = None

    @model_validator(mode="after")
    def _fits(self) -> ExperimentEntry:
        if self.nuisance and self.sweep:
            message = "nuisance, sweep: the levels can belong to one of them only"
            raise InputError(message)
        if bool(self.levels) != bool(self.nuisance or self.sweep):
            message = "levels: needed with a nuisance or a sweep, and only there"
            raise InputError(message)
        for name in self.combinations:
            if name not in COMBINATIONS:
                message = f"combinations: got {name!r}; choose from {', '.join(COMBINATIONS)}"
                raise InputError(message)
        if self.sweep and min(self.levels) <= 0:
            message = f"levels: got {min(self.levels)}; a radius is greater than 0"
            raise InputError(message)
        return self


class TimingEntry(Table):
    """The timing experiment: each method alone on sets of growing size from one pair.

    Attributes
    ----------
    dataset : tuple of str
        The first that is at hand is taken.
    pair : str, optional
        Its first by default.
    sizes : tuple of int
        Numbers of keypoints to aim at by the radius of Harris 3D's non-maximum suppression.
    repeats : int
        Timed calls after one that isn't.
    threads : tuple of int
        Numbers of threads; 0 for all cores.
    budget : float
        A method is skipped at a size where one call is expected to take more seconds.
    methods : tuple of MethodEntry, optional
        In place of the configuration's.

    Raises
    ------
    pydantic.ValidationError
        For an unknown key, or a value of another type or out of range.

    Examples
    --------
    >>> from cgroup.benchmark.config import TimingEntry
    >>> TimingEntry(dataset="standin-full", sizes=[500, 1000]).repeats
    10
    """

    dataset: Annotated[tuple[str, ...], BeforeValidator(as_list), Field(min_length=1)]
    pair: str | None = None
    sizes: tuple[Annotated[int, Field(ge=3)], ...] = (500, 1000, 2000, 3000, 5000, 10_000, 20_000)
    repeats: Annotated[int, Field(ge=1)] = 10
    threads: Annotated[tuple[Annotated[int, Field(ge=0)], ...], BeforeValidator(as_list)] = (1, 0)
    budget: Positive = 60.0
    methods: Methods | None = None
