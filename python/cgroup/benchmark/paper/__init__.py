"""The design of the paper's evaluation: experiments, data sets, complexities, from `design.toml`."""

from pydantic.dataclasses import dataclass

from cgroup._runtime.toml import load_packaged

_DESIGN = load_packaged("cgroup.benchmark.paper", "design.toml")
PAPER_EPSILON = 5.0  # a match is correct within this many pr, wherever the threshold isn't what is varied
PLACES: dict[str, list[str]] = _DESIGN["places"]
"""Data sets that can stand for a data set of the paper; the first one with records does."""

PAPER_COMPLEXITY: dict[str, str] = _DESIGN["complexity"]
"""The paper's table of complexities, section 5.3."""

QUANTITIES: dict[str, str] = _DESIGN["quantities"]
LEVELS: dict[str, list[str]] = _DESIGN["levels"]
"""Words for measures, and for one level and all levels of an experiment."""

OF_THE_PAPER = frozenset({"b3r-clean", "b3r", "u3or", "u3m"})  # data sets that the paper used
GENERATED = "standin-"  # names of generated data sets begin so


@dataclass(frozen=True)
class Experiment:
    """An experiment of the paper, section 4.3.

    `column` of the records is varied; `label` is that of the axis, with the unit. `places` are data sets of
    the paper. `sections` of the paper interpret the outcome, as claims name them.
    """

    id: str
    title: str
    column: str
    label: str
    places: tuple[str, ...]
    sections: tuple[str, ...] = ()


EXPERIMENTS = {each["id"]: Experiment(**each) for each in _DESIGN["experiment"]}
"""In the paper's order."""

# Methods in sequence, as the paper's summary recommends them
VARIANTS = Experiment("variants", "Grouping before RANSAC", "", "", ("U3OR", "U3M"))
# Methods of `VARIANTS` that a claim compares, on the cases that all of them were run on
CHAINED = ("gc+ransac", "gtm+ransac", "ransac")
