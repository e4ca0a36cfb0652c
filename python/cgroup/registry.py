"""The table of grouping methods: what is known of each besides its signature.

Names, plot styles, help texts and tables derive from it. `METHODS` is what exists; `PAPER_METHODS` is what
the paper compared: its claims and presets are about those nine, whatever else is added.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cgroup.methods import cv, gc, gtm, hough3d, nnsr, ransac, si, ss, st

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from cgroup.types import Grouping


@dataclass(frozen=True)
class MethodInfo:
    """What is known of a method besides its signature.

    Attributes
    ----------
    name : str
        Public name: the key of `METHODS`, of options and of records.
    function : callable
        The method.
    label : str
        Short name for figures and tables.
    fields : tuple of str
        Fields of `Correspondences` that it cannot do without.
    complexity : str
        Cost in the number n of correspondences.
    color, marker : str
        How figures draw it, in matplotlib's notation.
    in_paper : bool
        Whether the paper compares it.
    citation : str
        Who proposed it, and where.
    individual : bool
        Whether it judges correspondences one by one (paper, section 3.1) rather than in groups (3.2).
    """

    name: str
    function: Callable[..., Grouping]
    label: str
    fields: tuple[str, ...]
    complexity: str
    color: str
    marker: str
    in_paper: bool
    citation: str
    individual: bool = False


_POINTS = ("source", "target")
_FRAMES = (*_POINTS, "source_lrf", "target_lrf")

_TABLE = (
    MethodInfo(
        "ss",
        ss,
        "SS",
        ("similarity",),
        "n",
        "#DDCC77",
        "o",
        in_paper=True,
        citation="Yang et al., TPAMI 2019",
        individual=True,
    ),
    MethodInfo(
        "nnsr",
        nnsr,
        "NNSR",
        ("ratio",),
        "n",
        "#999933",
        "s",
        in_paper=True,
        citation="Lowe, IJCV 2004",
        individual=True,
    ),
    MethodInfo(
        "si",
        si,
        "SI",
        (*_FRAMES, "ratio"),
        "n log n + n k",
        "#88CCEE",
        "^",
        in_paper=True,
        citation="Buch et al., CVPR 2014",
        individual=True,
    ),
    MethodInfo(
        "cv",
        cv,
        "CV",
        (*_FRAMES, "ratio"),
        "n k",
        "#44AA99",
        "v",
        in_paper=True,
        citation="Yang et al., 2019",
        individual=True,
    ),
    MethodInfo(
        "ransac",
        ransac,
        "RANSAC",
        _POINTS,
        "n iterations",
        "#117733",
        "D",
        in_paper=True,
        citation="Fischler, Bolles, CACM 1981",
    ),
    MethodInfo(
        "st",
        st,
        "ST",
        _POINTS,
        "n² per power step",
        "#AA4499",
        "P",
        in_paper=True,
        citation="Leordeanu, Hebert, ICCV 2005",
    ),
    MethodInfo(
        "gc", gc, "GC", _POINTS, "n²", "#882255", "X", in_paper=True, citation="Chen, Bhanu, PRL 2007"
    ),
    MethodInfo(
        "3dhv",
        hough3d,
        "3DHV",
        _FRAMES,
        "n log n",
        "#CC6677",
        "<",
        in_paper=True,
        citation="Tombari, Di Stefano, PSIVT 2010",
    ),
    MethodInfo(
        "gtm",
        gtm,
        "GTM",
        _POINTS,
        "n² per step",
        "#332288",
        "*",
        in_paper=True,
        citation="Rodola et al., IJCV 2013",
    ),
)

METHOD_INFO: Mapping[str, MethodInfo] = {info.name: info for info in _TABLE}
"""All methods by name, the paper's first and in its order."""

METHODS: Mapping[str, Callable[..., Grouping]] = {info.name: info.function for info in _TABLE}
"""The functions of all methods by name."""

PAPER_METHODS: tuple[str, ...] = tuple(info.name for info in _TABLE if info.in_paper)
"""Names of the nine methods that the paper compares, in its order."""

ALIASES: Mapping[str, str] = {
    info.function.__name__: info.name for info in _TABLE if info.function.__name__ != info.name
}
"""Function names that differ from the public names."""

PRESETS: Mapping[str, Mapping[str, Mapping[str, Any]]] = {
    "paper": {},
    "literal": {"nnsr": {"max_ratio": 0.2}},
    "original": {
        "si": {"global_rank": "local_score", "otsu": "covis"},
        "st": {"conflict": "one_to_one"},
        "gtm": {"one_to_one": True, "dynamics": "infection_immunisation", "iterations": 10_000},
    },
    "pcl": {"gc": {"variant": "clique"}, "3dhv": {"variant": "pcl"}},
    "legacy_header": {
        "ss": {"threshold": 0.5},
        "si": {"min_distance_ratio": 0.8},
        "cv": {"voters": 20},
        "ransac": {"iterations": 5000},
    },
}
"""Options of each method by where they come from: the paper's defaults, its formulas read to the letter,
the options with which each method's own author differs, PCL's variants (3DHV's needs a ``bin_size`` as
well), and the evaluation group's later constants."""
