"""The methods that take part: the package's own, and functions from outside it."""

from __future__ import annotations

import functools
import hashlib
import inspect
import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup._runtime.plugins import load_plugin
from cgroup.errors import InputError
from cgroup.group import group
from cgroup.registry import find_method
from cgroup.types import OPTIONAL_FIELDS, Correspondences, Grouping

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from cgroup.types import RealArray

__all__ = [
    "IN_RESOLUTIONS",
    "Candidate",
    "candidate",
]

IN_RESOLUTIONS = "_pr"
"""An option whose name ends so is a length in pr; the method gets it without that, in the data's unit."""


@dataclass(frozen=True)
class Candidate:
    """A method with its options, under the name that tables and figures show.

    Attributes
    ----------
    label : str
        What it is called in records.
    name : str
        One of `METHODS`, spelt as there, or ``module:function``.
    options : str
        JSON object with sorted keys; a name ending in ``_pr`` is a length in pr.

    Examples
    --------
    >>> from cgroup.benchmark.candidates import candidate
    >>> candidate("GC, 2 pr", "gc", {"tolerance_pr": 2})
    Candidate(label='GC, 2 pr', name='gc', options='{"tolerance_pr": 2}')
    """

    label: str
    name: str
    options: str = "{}"

    @property
    def key(self) -> str:
        """Hash that names what is computed, whatever the label.

        Examples
        --------
        >>> from cgroup.benchmark.candidates import candidate
        >>> candidate("mine", "gc", {}).key == candidate("yours", "gc", {}).key
        True
        """
        text = json.dumps([self.name, self.options])
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def check(self) -> None:
        """Refuse an unknown method or option.

        Raises
        ------
        InputError
            For an unknown method or option, or a function that can't be imported.

        Examples
        --------
        >>> from cgroup.benchmark.candidates import Candidate
        >>> Candidate("GC", "gc", '{"colour": 3}').check()  # doctest: +ELLIPSIS
        Traceback (most recent call last):
            ...
        cgroup.errors.InputError: option: gc has no 'colour'; it takes tolerance, ...
        """
        known = [name for name in _parameters(self.name) if name not in _FIELDS]
        given = (name.removesuffix(IN_RESOLUTIONS) for name in json.loads(self.options))
        unknown = [name for name in given if name not in known]
        if unknown and not _takes_any(self.name):
            message = f"option: {self.name} has no {unknown[0]!r}; it takes {', '.join(known) or 'none'}"
            raise InputError(message)

    def run(self, correspondences: Correspondences, *, seed: int = 0, threads: int | None = 1) -> Grouping:
        """Group correspondences.

        Parameters
        ----------
        correspondences : Correspondences
            The problem.
        seed : int
            Passed on where the method takes a seed and the options set none.
        threads : int, optional
            Passed on where the method takes a number of threads; None for all cores.

        Returns
        -------
        Grouping
            Aligned with the correspondences.

        Raises
        ------
        InputError
            If the problem lacks what the method needs, or a function from outside returns no mask. What such
            a function raises itself is passed on.

        Examples
        --------
        >>> import numpy as np
        >>> from cgroup.benchmark.candidates import candidate
        >>> from cgroup.datasets import make_problem
        >>> problem = make_problem(np.random.default_rng(0), 200)
        >>> candidate("GC, 2 pr", "gc", {"tolerance_pr": 2}).run(problem.correspondences())
        Grouping(86 of 200 selected)
        """
        options: dict[str, Any] = self.parameters(seed, correspondences.resolution)
        if "threads" in _parameters(self.name):
            options["threads"] = threads
        if ":" not in self.name:
            return group(correspondences, self.name, **options)
        return _as_grouping(self.name, _function(self.name)(correspondences, **options), correspondences)

    def parameters(self, seed: int, resolution: float | None) -> dict[str, Any]:
        """Return the options as the method gets them, threads aside.

        Parameters
        ----------
        seed : int
            Passed on where the method takes a seed and the options set none.
        resolution : float or None
            Length of one pr, by which options that end in ``_pr`` are multiplied.

        Returns
        -------
        dict
            Keyword arguments by name.

        Raises
        ------
        InputError
            For a length in pr where the resolution is None.

        Examples
        --------
        >>> from cgroup.benchmark.candidates import candidate
        >>> candidate("", "ransac", {"tolerance_pr": 2}).parameters(seed=7, resolution=0.5)
        {'seed': 7, 'tolerance': 1.0}
        """
        given: dict[str, Any] = {}
        for name, value in json.loads(self.options).items():
            bare = name.removesuffix(IN_RESOLUTIONS)
            if bare != name and resolution is None:
                message = f"{name}: a length in pr, but no resolution is known; give {bare}"
                raise InputError(message)
            given[bare] = value if bare == name else value * resolution
        return {"seed": seed, **given} if "seed" in _parameters(self.name) else given


_FIELDS = ("source", "target", *OPTIONAL_FIELDS)

_OTHERWISE = ", or give module:function"


def candidate(label: str, name: str, options: Mapping[str, Any]) -> Candidate:
    """Make a candidate whose method and options exist.

    Parameters
    ----------
    label : str
        What to call it; the name if empty.
    name : str
        One of `METHODS` in any spelling, or ``module:function`` for a function that takes correspondences and
        returns a `Grouping` or a (n,) mask of bool.
    options : mapping
        Keyword arguments that JSON can hold; a name ending in ``_pr`` is a length in pr.

    Returns
    -------
    Candidate
        The method with its options and label; two of the same key compute the same.

    Raises
    ------
    InputError
        For an unknown method or option, or a function that can't be imported.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.benchmark.candidates import candidate
    >>> from cgroup.datasets import make_problem
    >>> problem = make_problem(np.random.default_rng(0), 200)
    >>> tuned = candidate("GTM, longer", "gtm", {"iterations": 500})
    >>> tuned.label, tuned.run(problem.correspondences()).mask.shape
    ('GTM, longer', (200,))
    """
    name = name if ":" in name else find_method(name, _OTHERWISE).name
    made = Candidate(label or name, name, json.dumps(dict(options), sort_keys=True))
    made.check()
    return made


@functools.cache
def _parameters(name: str) -> tuple[str, ...]:
    parameters = tuple(inspect.signature(_function(name)).parameters)
    return parameters[1:] if ":" in name else parameters  # without the correspondences


def _takes_any(name: str) -> bool:
    parameters = inspect.signature(_function(name)).parameters.values()
    return any(parameter.kind is inspect.Parameter.VAR_KEYWORD for parameter in parameters)


def _function(name: str) -> Callable[..., Any]:
    if ":" in name:
        function = load_plugin("method", name)
        if not callable(function):
            message = f"method: {name} is a {type(function).__name__}; name a function"
            raise InputError(message)
        return function
    return find_method(name, _OTHERWISE).function


def _as_grouping(name: str, result: object, correspondences: Correspondences) -> Grouping:
    found = result if isinstance(result, Grouping) else Grouping(np.asarray(result), None, None, None, {})
    mask = found.mask
    if mask.dtype != bool or mask.shape != (len(correspondences),):
        message = (
            f"{name}: returned {mask.dtype} of shape {mask.shape}; "
            f"return a Grouping or a mask of {len(correspondences)} bool"
        )
        raise InputError(message)
    positions: tuple[RealArray, RealArray] = (correspondences.source, correspondences.target)
    return replace(found, _positions=positions)
