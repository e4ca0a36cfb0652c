"""Solvers of the benchmark: grouping methods, and pipelines that register two clouds or many scans."""

import functools
import hashlib
import importlib
import inspect
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from cgroup._checks.calls import load_plugin
from cgroup._checks.values import as_named, guess_word, refuse_word
from cgroup._runtime.progress import StageClock
from cgroup.benchmark.pipelines import PIPELINES, SCENE_SOLVERS
from cgroup.benchmark.pipelines.libraries import refine
from cgroup.errors import InputError
from cgroup.group import group
from cgroup.registry import find_method
from cgroup.types import OPTIONAL_FIELDS, Correspondences, Grouping

SolverKind: TypeAlias = Literal["method", "pipeline", "scene solver"]

# Suffix of options that are lengths in pr; the method gets them without it, in the data's unit
IN_RESOLUTIONS = "_pr"
_FIELDS = ("source", "target", *OPTIONAL_FIELDS)
_OTHERWISE = ", or give module:function"
_BUILT_IN = {"pipeline": PIPELINES, "scene solver": SCENE_SOLVERS}


@dataclass(frozen=True)
class Solver:
    """A method or pipeline with its options; `label` is its name in records.

    `name` is a built-in name or ``module:function``. `options` is a JSON object with sorted keys. `refined`:
    small_gicp refines the pose of a pipeline; None for other solvers.
    """

    label: str
    name: str
    options: str = "{}"
    refined: bool | None = None

    @property
    def key(self) -> str:
        """Hash of name and options, independent of the label."""
        parts = [self.name, self.options, *([] if self.refined is None else [self.refined])]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]

    def group(self, matches: Correspondences, *, seed: int = 0, threads: int | None = 1) -> Grouping:
        """Group matches by a method; seed and threads are passed to methods that take them.

        Errors of functions outside the package are passed on; `InputError` if one returns no mask.
        """
        options = self.parameters(seed, matches.resolution)
        if "threads" in _method_options(self.name):
            options["threads"] = threads
        if ":" not in self.name:
            return group(matches, self.name, **options)
        result = _find("method", self.name)(matches, **options)
        found = result if isinstance(result, Grouping) else Grouping(np.asarray(result), None, None, None, {})
        if found.mask.dtype != bool or found.mask.shape != (len(matches),):
            raise InputError(
                f"{self.name}: returned {found.mask.dtype} of shape {found.mask.shape}; "
                f"return a Grouping or a mask of {len(matches)} bool"
            )
        return replace(found, _positions=(matches.source, matches.target))

    def parameters(self, seed: int, resolution: float | None) -> dict[str, Any]:
        """Return the options of a method with lengths in the data's unit, without `threads`."""
        given: dict[str, Any] = {}
        for name, value in json.loads(self.options).items():
            bare = name.removesuffix(IN_RESOLUTIONS)
            if bare != name and resolution is None:
                raise InputError(f"{name}: a length in pr needs a resolution, and none is known; give {bare}")
            given[bare] = value if bare == name else value * resolution
        return {"seed": seed, **given} if "seed" in _method_options(self.name) else given

    def register(self, given: Any) -> tuple[Any, dict[str, float]]:  # noqa: ANN401 - by the kind
        """Register `Clouds` or `Scans`; return the answer and the seconds of each stage."""
        kind = "scene solver" if self.refined is None else "pipeline"
        clock = StageClock()
        answer = _find(kind, self.name)(given, clock, **json.loads(self.options))
        if self.refined and answer.T_target_source is not None:
            clock.start("refinement")
            answer = replace(answer, T_target_source=refine(given, answer.T_target_source))
        return answer, clock.stop()

    def why_missing(self) -> str:
        """Return the missing library and its install command; empty if none is missing."""
        needed = [infos[self.name].needs for infos in _BUILT_IN.values() if self.name in infos]
        for module in " ".join([*needed, "small_gicp" if self.refined else ""]).split():
            try:
                importlib.import_module(module)
            except (ImportError, OSError) as error:  # noqa: PERF203 - a few at most
                return f"{module} can't be imported ({error}); pip install {module.replace('_', '-')}"
        return ""


def make_solver(
    kind: SolverKind, label: str, name: str, options: Mapping[str, Any], *, refined: bool = False
) -> Solver:
    """Make a solver, and check that its function exists and takes the options.

    An empty label is replaced by the name. Options must be values that JSON can hold.
    """
    as_named("options", options, "give a dict of values by the name of the option", may_be_empty=True)
    if kind == "method" and ":" not in name:
        name = find_method(name, _OTHERWISE).name
    if kind == "method":
        known = [option for option in _method_options(name) if option not in _FIELDS]
        given = [each.removesuffix(IN_RESOLUTIONS) for each in options]
    else:
        known = list(inspect.signature(_find(kind, name)).parameters)[2:]  # after the input and the clock
        given = list(options)
    unknown = [option for option in given if option not in known]
    parameters = inspect.signature(_find(kind, name)).parameters.values()
    if unknown and not any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters):
        raise InputError(f"option: {name} has no {unknown[0]!r}; it takes {', '.join(known) or 'none'}")
    as_json = json.dumps(dict(options), sort_keys=True)
    return Solver(label or name, name, as_json, refined if kind == "pipeline" else None)


@functools.cache
def _method_options(name: str) -> tuple[str, ...]:
    parameters = tuple(inspect.signature(_find("method", name)).parameters)
    return parameters[1:] if ":" in name else parameters  # without the correspondences


def _find(kind: SolverKind, name: str) -> Callable[..., Any]:
    if ":" in name:
        function = load_plugin(kind, name)
        if not callable(function):
            raise InputError(f"{kind}: {name} is a {type(function).__name__}; name a function")
        return function
    if kind == "method":
        return find_method(name, _OTHERWISE).function
    known = _BUILT_IN[kind]
    if name not in known:
        refuse_word(kind, name, known, guess_word(name, known), _OTHERWISE)
    return known[name].run
