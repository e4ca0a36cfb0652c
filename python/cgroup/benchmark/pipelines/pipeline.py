"""Pipelines by name, with their options."""

from __future__ import annotations

import hashlib
import importlib
import inspect
import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from cgroup._checks.values import guess_word, refuse_word
from cgroup._runtime.plugins import load_plugin
from cgroup._runtime.progress import StageClock
from cgroup.benchmark.pipelines import kiss_matcher, open3d, own
from cgroup.benchmark.pipelines.refinement import refine
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from cgroup.benchmark.pipelines.problem import Answer, Problem


class PipelineInfo(NamedTuple):
    """A pipeline that comes with the package.

    Attributes
    ----------
    run : callable
        Takes a problem, a clock for its stages, and options.
    needs : str
        Module that it needs, if any.
    title : str
        What it does, for people.
    """

    run: Callable[..., Answer]
    needs: str
    title: str


PIPELINES = {
    "cgroup": PipelineInfo(own.dense, "", "register: dense front end, grouping, verification, refinement"),
    "cgroup-paper": PipelineInfo(own.paper, "", "register with the paper's front end"),
    "cgroup-matches": PipelineInfo(own.matches, "", "dense front end and grouping alone"),
    "open3d-ransac": PipelineInfo(open3d.ransac, "open3d", "Open3D: FPFH and RANSAC"),
    "open3d-fgr": PipelineInfo(open3d.fast, "open3d", "Open3D: FPFH and fast global registration"),
    "kiss-matcher": PipelineInfo(kiss_matcher.estimate, "kiss_matcher", "KISS-Matcher"),
}
"""Built-in pipelines."""

REFINED_BY = "small_gicp"
"""What `refined` stands for."""

_PACKAGES = {"kiss_matcher": "kiss-matcher", "small_gicp": "small-gicp"}


@dataclass(frozen=True)
class Pipeline:
    """A pipeline with its options, under the name that tables and figures show.

    Attributes
    ----------
    label : str
        What it is called in records.
    name : str
        One of `PIPELINES`, or ``module:function``.
    options : str
        JSON object with sorted keys.
    refined : bool
        Whether its pose is refined by small_gicp.

    Examples
    --------
    >>> from cgroup.benchmark.pipelines import make_pipeline
    >>> make_pipeline("", "cgroup", {"effort": "low"})
    Pipeline(label='cgroup', name='cgroup', options='{"effort": "low"}', refined=False)
    """

    label: str
    name: str
    options: str = "{}"
    refined: bool = False

    @property
    def key(self) -> str:
        """Hash that names what is computed, whatever the label.

        Examples
        --------
        >>> from cgroup.benchmark.pipelines import make_pipeline
        >>> mine, yours = (make_pipeline(name, "cgroup", {}) for name in "ab")
        >>> mine.key == yours.key
        True
        """
        text = json.dumps([self.name, self.options, self.refined])
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def why_missing(self) -> str:
        """Say which library isn't installed.

        Returns
        -------
        str
            The library, the reason, and how to install it; empty if all are there.

        Examples
        --------
        >>> from cgroup.benchmark.pipelines import make_pipeline
        >>> make_pipeline("", "cgroup", {}).why_missing()
        ''
        """
        needed = [PIPELINES[self.name].needs] if self.name in PIPELINES else []
        needed += [REFINED_BY] if self.refined else []
        for module in filter(None, needed):
            try:
                importlib.import_module(module)
            except (ImportError, OSError) as error:  # noqa: PERF203 - two at most
                return f"{module} can't be imported ({error}); pip install {_PACKAGES.get(module, module)}"
        return ""

    def run(self, problem: Problem) -> tuple[Answer, dict[str, float]]:
        """Register two clouds.

        Parameters
        ----------
        problem : Problem
            The clouds, and what is known of them.

        Returns
        -------
        answer : Answer
            The pose, and whether the pipeline trusts it.
        seconds : dict of str to float
            Wall time of each stage, in order.

        Raises
        ------
        InputError
            If clouds or options can't be worked with, or the function can't be imported. What other libraries
            and functions from outside raise is passed on.

        Examples
        --------
        >>> from cgroup.benchmark.pipelines import Problem, make_pipeline
        >>> from cgroup.datasets import standin_pair
        >>> pair = standin_pair(pixels=60)
        >>> problem = Problem(
        ...     pair.source.points, pair.target.points, (0, 0, 0), (0, 0, 0), voxel=6.0
        ... )
        >>> answer, seconds = make_pipeline("", "cgroup", {}).run(problem)
        >>> answer.ok, "matching" in seconds
        (True, True)
        """
        clock = StageClock()
        answer = _function(self.name)(problem, clock, **json.loads(self.options))
        if self.refined and answer.T_target_source is not None:
            clock.start("refinement")
            answer = replace(answer, T_target_source=refine(problem, answer.T_target_source))
        return answer, clock.stop()


def make_pipeline(label: str, name: str, options: Mapping[str, Any], *, refined: bool = False) -> Pipeline:
    """Make a pipeline that exists, with options that it takes.

    Parameters
    ----------
    label : str
        What to call it; the name if empty.
    name : str
        One of `PIPELINES`, or ``module:function`` for a function that takes a `Problem`, a clock (call its
        `start` with the name of each stage) and options, and returns an `Answer`.
    options : mapping
        Keyword arguments that JSON can hold.
    refined : bool
        Whether small_gicp refines its pose.

    Returns
    -------
    Pipeline
        The way to register with its options and label.

    Raises
    ------
    InputError
        For an unknown pipeline or option, or a function that can't be imported.

    Examples
    --------
    >>> from cgroup.benchmark.pipelines import PIPELINES, make_pipeline
    >>> sorted(PIPELINES)[:3]
    ['cgroup', 'cgroup-matches', 'cgroup-paper']
    >>> make_pipeline("ours, quick", "cgroup", {"effort": "low"}).label
    'ours, quick'
    """
    parameters = inspect.signature(_function(name)).parameters
    known = list(parameters)[2:]
    unknown = [option for option in options if option not in known]
    if unknown and not any(each.kind is each.VAR_KEYWORD for each in parameters.values()):
        message = f"option: {name} has no {unknown[0]!r}; it takes {', '.join(known) or 'none'}"
        raise InputError(message)
    return Pipeline(label or name, name, json.dumps(dict(options), sort_keys=True), refined)


def _function(name: str) -> Callable[..., Answer]:
    if ":" in name:
        function: Callable[..., Answer] = load_plugin("pipeline", name)
        if not inspect.isfunction(function):
            message = f"pipeline: {name} is a {type(function).__name__}; name a function"
            raise InputError(message)
        return function
    if name not in PIPELINES:
        refuse_word("pipeline", name, PIPELINES, guess_word(name, PIPELINES), ", or give module:function")
    return PIPELINES[name].run
