"""What the paper leaves open, and one way to read it: data, checked as configurations are."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from cgroup.benchmark.averages import Average
from cgroup.benchmark.config import Positive, Table, as_list

Names = Annotated[tuple[str, ...], BeforeValidator(as_list)]


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
        How the scores of several pairs become one, see `cgroup.benchmark.averages`.
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

    Raises
    ------
    pydantic.ValidationError
        For an unknown key, or a value of another type or out of range.

    Examples
    --------
    >>> from cgroup.benchmark.readings import Reading
    >>> short = Reading(
    ...     name="gtm-20", label="20 steps", methods={"gtm": {"iterations": 20}}
    ... )
    >>> short.applies_to("noise", "b3r-clean", "C1")
    True
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

    @property
    def changes(self) -> tuple[Reading, ...]:
        """The readings that are combined, or this one alone.

        Examples
        --------
        >>> from cgroup.benchmark.readings import Reading
        >>> alone = Reading(name="solvable", label="left out", solvable=True)
        >>> alone.changes == (alone,)
        True
        """
        return self.parts or (self,)

    @property
    def makes_other_matches(self) -> bool:
        """Whether all methods have to be run or judged once more, not only those with other options.

        Examples
        --------
        >>> from cgroup.benchmark.readings import Reading
        >>> mutual = {"matching": "mutual"}
        >>> Reading(name="m", label="mutual", front=mutual).makes_other_matches
        True
        """
        return bool(self.front or self.nuisances or self.datasets or self.epsilons)

    def applies_to(self, experiment: str, dataset: str, combination: str) -> bool:
        """Tell whether the change is tried there.

        Parameters
        ----------
        experiment, dataset, combination : str
            As the records name them.

        Returns
        -------
        bool
            Whether none of the three is left out.

        Examples
        --------
        >>> from cgroup.benchmark.readings import Reading
        >>> wide = Reading(name="iss", label="6 pr", combinations=["C4", "C5", "C6"])
        >>> wide.applies_to("combinations", "b3r", "C1")
        False
        """
        asked = (
            (self.experiments, experiment),
            (self.data, dataset),
            (self.combinations, combination),
            (tuple(self.datasets), dataset),
        )
        return all(name in named for named, name in asked if named)
