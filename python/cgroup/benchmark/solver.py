"""The solvers that take part: grouping methods, and ways to register two clouds or many scans."""

from __future__ import annotations

import functools
import hashlib
import importlib
import inspect
import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup._checks.values import as_named, guess_word, refuse_word
from cgroup._runtime.plugins import load_plugin
from cgroup._runtime.progress import StageClock
from cgroup.benchmark.pipelines import PIPELINES, SCENE_SOLVERS
from cgroup.benchmark.pipelines.libraries import refine
from cgroup.errors import InputError
from cgroup.group import group
from cgroup.registry import find_method
from cgroup.types import OPTIONAL_FIELDS, Correspondences, Grouping

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping

    from cgroup.benchmark.pipelines import Answer, Clouds, Scans, SceneAnswer

__all__ = [
    "IN_RESOLUTIONS",
    "Solver",
    "candidate",
    "make_pipeline",
    "make_scene_solver",
]

IN_RESOLUTIONS = "_pr"
"""An option whose name ends so is a length in pr; the method gets it without that, in the data's unit."""

_FIELDS = ("source", "target", *OPTIONAL_FIELDS)
_OTHERWISE = ", or give module:function"
_BUILT_IN = {"pipeline": PIPELINES, "scene solver": SCENE_SOLVERS}


@dataclass(frozen=True)
class Solver:
    """A grouping method or a way to register, with its options and its label.

    `candidate`, `make_pipeline` and `make_scene_solver` make one that is sure to exist.

    Attributes
    ----------
    label : str
        Name in records.
    name : str
        One of `METHODS`, spelt as there; of `PIPELINES` or `SCENE_SOLVERS`; or ``module:function``.
    options : str
        JSON object with sorted keys; a method's option ending in ``_pr`` is a length in pr.
    refined : bool, optional
        Whether small_gicp refines the pose of a way to register two clouds; None for another solver.

    Examples
    --------
    >>> from cgroup.benchmark.solver import candidate
    >>> candidate("GC, 2 pr", "gc", {"tolerance_pr": 2})
    Solver(label='GC, 2 pr', name='gc', options='{"tolerance_pr": 2}', refined=None)
    """

    label: str
    name: str
    options: str = "{}"
    refined: bool | None = None

    @property
    def key(self) -> str:
        """Hash of what is computed, whatever the label.

        Examples
        --------
        >>> from cgroup.benchmark.solver import candidate
        >>> candidate("mine", "gc", {}).key == candidate("yours", "gc", {}).key
        True
        """
        parts = [self.name, self.options, *([] if self.refined is None else [self.refined])]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]

    def group(self, matches: Correspondences, *, seed: int = 0, threads: int | None = 1) -> Grouping:
        """Group matches by a method.

        Parameters
        ----------
        matches : Correspondences
            The problem.
        seed : int
            Passed on where the method takes a seed and the options set none.
        threads : int, optional
            Passed on where the method takes a number of threads; None for all cores.

        Returns
        -------
        Grouping
            Aligned with the matches.

        Raises
        ------
        InputError
            If the matches lack a field that the method needs, or a function from outside returns no mask.
            Errors of such a function are passed on.

        Examples
        --------
        >>> import numpy as np
        >>> from cgroup.benchmark.solver import candidate
        >>> from cgroup.datasets import make_problem
        >>> matches = make_problem(np.random.default_rng(0), 200).correspondences()
        >>> candidate("GC, 2 pr", "gc", {"tolerance_pr": 2}).group(matches)
        Grouping(86 of 200 selected)
        """
        options = self.parameters(seed, matches.resolution)
        if "threads" in _method_options(self.name):
            options["threads"] = threads
        if ":" not in self.name:
            return group(matches, self.name, **options)
        result = _find("method", self.name)(matches, **options)
        found = result if isinstance(result, Grouping) else Grouping(np.asarray(result), None, None, None, {})
        if found.mask.dtype != bool or found.mask.shape != (len(matches),):
            message = (
                f"{self.name}: returned {found.mask.dtype} of shape {found.mask.shape}; "
                f"return a Grouping or a mask of {len(matches)} bool"
            )
            raise InputError(message)
        return replace(found, _positions=(matches.source, matches.target))

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
        >>> from cgroup.benchmark.solver import candidate
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
        return {"seed": seed, **given} if "seed" in _method_options(self.name) else given

    def register(self, clouds: Clouds) -> tuple[Answer, dict[str, float]]:
        """Register two clouds.

        Parameters
        ----------
        clouds : Clouds
            Both clouds, and what is known of them.

        Returns
        -------
        answer : Answer
            The pose, and whether the pipeline trusts it.
        seconds : dict of str to float
            Wall time of each stage, in order.

        Raises
        ------
        InputError
            If clouds or options can't be worked with, or the function can't be imported. Errors of other
            libraries and of functions from outside are passed on.

        Examples
        --------
        >>> from cgroup.benchmark.pipelines import Clouds
        >>> from cgroup.benchmark.solver import make_pipeline
        >>> from cgroup.datasets import standin_pair
        >>> pair = standin_pair(pixels=60)
        >>> clouds = Clouds(
        ...     pair.source.points, pair.target.points, (0, 0, 0), (0, 0, 0), voxel=6.0
        ... )
        >>> answer, seconds = make_pipeline("", "cgroup", {}).register(clouds)
        >>> answer.ok, "matching" in seconds
        (True, True)
        """
        clock = StageClock()
        answer = _find("pipeline", self.name)(clouds, clock, **json.loads(self.options))
        if self.refined and answer.T_target_source is not None:
            clock.start("refinement")
            answer = replace(answer, T_target_source=refine(clouds, answer.T_target_source))
        return answer, clock.stop()

    def register_scans(self, scans: Scans) -> tuple[SceneAnswer, dict[str, float]]:
        """Register many scans.

        Parameters
        ----------
        scans : Scans
            All scans, and what is known of them.

        Returns
        -------
        answer : SceneAnswer
            Poses and components.
        seconds : dict of str to float
            Wall time of each stage, in order.

        Raises
        ------
        InputError
            If scans or options can't be worked with, or the function can't be imported. Errors of other
            libraries and of functions from outside are passed on.

        Examples
        --------
        >>> from cgroup.benchmark.pipelines import Scans
        >>> from cgroup.benchmark.solver import make_scene_solver
        >>> from cgroup.datasets import standin_pair
        >>> pair = standin_pair(pixels=60)
        >>> scans = Scans([pair.source.points, pair.target.points], voxel=6.0)
        >>> answer, _ = make_scene_solver("", "register-all", {}).register_scans(scans)
        >>> answer.components, answer.tried
        ([[0, 1]], 1)
        """
        clock = StageClock()
        answer = _find("scene solver", self.name)(scans, clock, **json.loads(self.options))
        return answer, clock.stop()

    def why_missing(self) -> str:
        """Name the library that isn't installed.

        Returns
        -------
        str
            The library, the reason, and how to install it; empty if all are there.

        Examples
        --------
        >>> from cgroup.benchmark.solver import make_pipeline
        >>> make_pipeline("", "cgroup", {}).why_missing()
        ''
        """
        needed = [infos[self.name].needs for infos in _BUILT_IN.values() if self.name in infos]
        for module in " ".join([*needed, "small_gicp" if self.refined else ""]).split():
            try:
                importlib.import_module(module)
            except (ImportError, OSError) as error:  # noqa: PERF203 - a few at most
                return f"{module} can't be imported ({error}); pip install {module.replace('_', '-')}"
        return ""


def candidate(label: str, name: str, options: Mapping[str, Any]) -> Solver:
    """Make a solver of a grouping method.

    Parameters
    ----------
    label : str
        Name in records; the method's if empty.
    name : str
        One of `METHODS` in any spelling, or ``module:function`` for a function that takes correspondences and
        returns a `Grouping` or a (n,) mask of bool.
    options : mapping
        Keyword arguments that JSON can hold; a name ending in ``_pr`` is a length in pr.

    Returns
    -------
    Solver
        The method with its options and label; two of the same key compute the same.

    Raises
    ------
    InputError
        For an unknown method or option, options that aren't by name, or a function that can't be imported.

    Examples
    --------
    >>> from cgroup.benchmark.solver import candidate
    >>> candidate("GTM, longer", "GTM", {"iterations": 500}).name
    'gtm'
    """
    as_named("options", options, "give a dict of values by the name of the option")
    name = name if ":" in name else find_method(name, _OTHERWISE).name
    known = [option for option in _method_options(name) if option not in _FIELDS]
    given = [each.removesuffix(IN_RESOLUTIONS) for each in options]
    return _make("method", known, given, Solver(label or name, name, _as_json(options)))


def make_pipeline(label: str, name: str, options: Mapping[str, Any], *, refined: bool = False) -> Solver:
    """Make a solver of a way to register.

    Parameters
    ----------
    label : str
        Name in records; the pipeline's if empty.
    name : str
        One of `PIPELINES`, or ``module:function`` for a function that takes a `Clouds`, a clock (call its
        `start` with the name of each stage) and options, and returns an `Answer`.
    options : mapping
        Keyword arguments that JSON can hold.
    refined : bool
        Whether small_gicp refines its pose.

    Returns
    -------
    Solver
        The way to register with its options and label.

    Raises
    ------
    InputError
        For an unknown pipeline or option, options that aren't by name, or a function that can't be imported.

    Examples
    --------
    >>> from cgroup.benchmark.solver import make_pipeline
    >>> make_pipeline("ours, quick", "cgroup", {"effort": "low"}).label
    'ours, quick'
    """
    return _make_timed("pipeline", label, name, options, refined=refined)


def make_scene_solver(label: str, name: str, options: Mapping[str, Any]) -> Solver:
    """Make a solver that registers many scans.

    Parameters
    ----------
    label : str
        Name in records; the solver's if empty.
    name : str
        One of `SCENE_SOLVERS`, or ``module:function`` for a function that takes `Scans`, a clock (call its
        `start` with the name of each stage) and options, and returns a `SceneAnswer`.
    options : mapping
        Keyword arguments that JSON can hold.

    Returns
    -------
    Solver
        The way to register with its options and label.

    Raises
    ------
    InputError
        For an unknown solver or option, options that aren't by name, or a function that can't be imported.

    Examples
    --------
    >>> from cgroup.benchmark.solver import make_scene_solver
    >>> make_scene_solver("ours, quick", "register-all", {"effort": "low"}).label
    'ours, quick'
    """
    return _make_timed("scene solver", label, name, options)


def _make_timed(
    kind: str, label: str, name: str, options: Mapping[str, Any], *, refined: bool | None = None
) -> Solver:
    """Return a solver if its function takes the options beside its input and a clock."""
    as_named("options", options, "give a dict of values by the name of the option")
    known = list(inspect.signature(_find(kind, name)).parameters)[2:]
    return _make(kind, known, options, Solver(label or name, name, _as_json(options), refined))


def _make(kind: str, known: Collection[str], given: Iterable[str], solver: Solver) -> Solver:
    """Return a solver if its function takes the options given."""
    unknown = [option for option in given if option not in known]
    parameters = inspect.signature(_find(kind, solver.name)).parameters.values()
    if unknown and not any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters):
        message = f"option: {solver.name} has no {unknown[0]!r}; it takes {', '.join(known) or 'none'}"
        raise InputError(message)
    return solver


def _as_json(options: Mapping[str, Any]) -> str:
    return json.dumps(dict(options), sort_keys=True)


@functools.cache
def _method_options(name: str) -> tuple[str, ...]:
    parameters = tuple(inspect.signature(_find("method", name)).parameters)
    return parameters[1:] if ":" in name else parameters  # without the correspondences


def _find(kind: str, name: str) -> Callable[..., Any]:
    """Find the function of a "method", "pipeline" or "scene solver"."""
    if ":" in name:
        function = load_plugin(kind, name)
        if not callable(function):
            message = f"{kind}: {name} is a {type(function).__name__}; name a function"
            raise InputError(message)
        return function
    if kind == "method":
        return find_method(name, _OTHERWISE).function
    known = _BUILT_IN[kind]
    if name not in known:
        refuse_word(kind, name, known, guess_word(name, known), _OTHERWISE)
    return known[name].run
