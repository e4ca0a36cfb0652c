"""The table of grouping methods: everything known of a method besides its signature.

Names, plot styles, help texts and tables derive from it. `METHODS` is what exists; `PAPER_METHODS` is what
the paper compared: its claims and presets are about those nine, whatever else is added.
"""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

from cgroup import _core
from cgroup._checks.values import guess_word, refuse_word
from cgroup.methods import (
    clipper,
    cv,
    gc,
    gtm,
    hough3d,
    lc,
    mac,
    nnsr,
    ransac,
    sc2pcr,
    si,
    ss,
    st,
    teaser,
    turboreg,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from cgroup.types import Grouping


__all__ = [
    "METHODS",
    "METHOD_INFO",
    "PAPER_METHODS",
    "PRESETS",
    "MethodInfo",
    "MethodName",
    "MethodOption",
    "label_of",
]


MethodName: TypeAlias = Literal[
    "ss",
    "nnsr",
    "si",
    "cv",
    "ransac",
    "st",
    "gc",
    "3dhv",
    "gtm",
    "lc",
    "mac",
    "sc2pcr",
    "turboreg",
    "teaser",
    "clipper",
]
"""The keys of `METHODS`. Functions take ``MethodName | str``: editors complete the names, labels pass too."""


class MethodOption(NamedTuple):
    """What an option of a method takes, as the compiled core describes it.

    Attributes
    ----------
    kind : str
        "flag"; "seed", "count" or "rounds" (whole numbers); "length" (in the unit of the data), "number";
        "choice" (of a few words or numbers); "cut" (a number, or "otsu"); or "scale" (a truth value, or two
        bounds).
    optional : bool
        Whether it may be None.
    default : bool, int, float, str or None
        Its value where it is not given; None for a length that follows from another one.
    range : tuple
        The least and the greatest value, or what to choose from; empty where the kind says it.

    Examples
    --------
    >>> from cgroup.registry import METHOD_INFO
    >>> METHOD_INFO["mac"].options["min_clique_size"]
    MethodOption(kind='count', optional=False, default=3, range=(3, 18446744073709551615))
    """

    kind: str
    optional: bool
    default: bool | float | str | None
    range: tuple[Any, ...]


_DESCRIBED = {
    name: (tuple(fields), tuple(optional), {each: MethodOption(*what) for each, what in options.items()})
    for name, (fields, optional, options) in _core.describe_methods()
}


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
    idea : str
        How it groups, in a few words.
    complexity : str
        Cost in the number n of correspondences.
    color, marker : str
        How figures draw it, in matplotlib's notation.
    in_paper : bool
        Whether the evaluation of Yang et al., TPAMI 2019, compares it.
    citation : str
        Who proposed it, and where.
    individual : bool
        Whether it judges correspondences one by one (paper, section 3.1) rather than in groups (3.2).

    Examples
    --------
    >>> from cgroup.registry import METHOD_INFO
    >>> METHOD_INFO["gtm"].label, METHOD_INFO["gtm"].complexity
    ('GTM', 'n² per step')
    >>> [info.name for info in METHOD_INFO.values() if "ratio" in info.fields]
    ['nnsr', 'si', 'cv']
    """

    name: str
    function: Callable[..., Grouping]
    label: str
    idea: str
    complexity: str
    color: str
    marker: str
    in_paper: bool
    citation: str
    individual: bool = False

    @property
    def fields(self) -> tuple[str, ...]:
        """Fields of `Correspondences` that it cannot do without.

        Examples
        --------
        >>> METHOD_INFO["st"].fields
        ('source', 'target')
        """
        return _DESCRIBED[self.name][0]

    @property
    def optional_fields(self) -> tuple[str, ...]:
        """Fields that it uses where they are there, by default or for some of its options.

        Examples
        --------
        >>> METHOD_INFO["st"].optional_fields
        ('similarity',)
        """
        return _DESCRIBED[self.name][1]

    @property
    def options(self) -> Mapping[str, MethodOption]:
        """What each option takes, by the option's name and in the signature's order.

        Examples
        --------
        >>> METHOD_INFO["st"].options["diagonal"].range
        ('zero', 'one', 'score')
        """
        return _DESCRIBED[self.name][2]


_TABLE = (
    MethodInfo(
        name="ss",
        function=ss,
        label="SS",
        idea="alike descriptors",
        complexity="n",
        color="#DDCC77",
        marker="o",
        in_paper=True,
        citation="Yang et al., TPAMI 2019",
        individual=True,
    ),
    MethodInfo(
        name="nnsr",
        function=nnsr,
        label="NNSR",
        idea="distinct descriptors",
        complexity="n",
        color="#999933",
        marker="s",
        in_paper=True,
        citation="Lowe, IJCV 2004",
        individual=True,
    ),
    MethodInfo(
        name="si",
        function=si,
        label="SI",
        idea="votes under its own pose",
        complexity="n log n + n k",
        color="#88CCEE",
        marker="^",
        in_paper=True,
        citation="Buch et al., CVPR 2014",
        individual=True,
    ),
    MethodInfo(
        name="cv",
        function=cv,
        label="CV",
        idea="votes by distance, frame",
        complexity="n k",
        color="#44AA99",
        marker="v",
        in_paper=True,
        citation="Yang et al., 2019",
        individual=True,
    ),
    MethodInfo(
        name="ransac",
        function=ransac,
        label="RANSAC",
        idea="best of random triples",
        complexity="n iterations",
        color="#117733",
        marker="D",
        in_paper=True,
        citation="Fischler, Bolles, CACM 1981",
    ),
    MethodInfo(
        name="st",
        function=st,
        label="ST",
        idea="principal eigenvector",
        complexity="n² per power step",
        color="#AA4499",
        marker="P",
        in_paper=True,
        citation="Leordeanu, Hebert, ICCV 2005",
    ),
    MethodInfo(
        name="gc",
        function=gc,
        label="GC",
        idea="largest star of a seed",
        complexity="n²",
        color="#882255",
        marker="X",
        in_paper=True,
        citation="Chen, Bhanu, PRL 2007",
    ),
    MethodInfo(
        name="3dhv",
        function=hough3d,
        label="3DHV",
        idea="votes for the centre",
        complexity="n log n",
        color="#CC6677",
        marker="<",
        in_paper=True,
        citation="Tombari, Di Stefano, PSIVT 2010",
    ),
    MethodInfo(
        name="gtm",
        function=gtm,
        label="GTM",
        idea="survivors of a game",
        complexity="n² per step",
        color="#332288",
        marker="*",
        in_paper=True,
        citation="Rodola et al., IJCV 2013",
    ),
    MethodInfo(
        name="lc",
        function=lc,
        label="LC",
        idea="pose that beats chance",
        complexity="n²",
        color="#000000",
        marker="h",
        in_paper=False,
        citation="this library",
    ),
    MethodInfo(
        name="mac",
        function=mac,
        label="MAC",
        idea="every maximal clique",
        complexity="n² + cliques",
        color="#0077BB",
        marker="8",
        in_paper=False,
        citation="Zhang et al., CVPR 2023",
    ),
    MethodInfo(
        name="sc2pcr",
        function=sc2pcr,
        label="SC2-PCR",
        idea="sets with common others",
        complexity="n²",
        color="#E69F00",
        marker=">",
        in_paper=False,
        citation="Chen et al., CVPR 2022",
    ),
    MethodInfo(
        name="turboreg",
        function=turboreg,
        label="TurboReg",
        idea="triangles on heavy pairs",
        complexity="n²",
        color="#56B4E9",
        marker="p",
        in_paper=False,
        citation="Yan et al., ICCV 2025",
    ),
    MethodInfo(
        name="teaser",
        function=teaser,
        label="TEASER++",
        idea="clique, truncated fit",
        complexity="n² + search",
        color="#E8601C",
        marker="H",
        in_paper=False,
        citation="Yang, Shi, Carlone, T-RO 2021",
    ),
    MethodInfo(
        name="clipper",
        function=clipper,
        label="CLIPPER",
        idea="densest agreeing set",
        complexity="n² + agreeing pairs per step",
        color="#4EB265",
        marker="d",
        in_paper=False,
        citation="Lusk, Fathian, How, ICRA 2021",
    ),
)

METHOD_INFO: Mapping[str, MethodInfo] = {info.name: info for info in _TABLE}
"""All methods by name, the paper's first and in its order."""

METHODS: Mapping[str, Callable[..., Grouping]] = {info.name: info.function for info in _TABLE}
"""The functions of all methods by name."""

PAPER_METHODS: tuple[str, ...] = tuple(info.name for info in _TABLE if info.in_paper)
"""Names of the nine methods that the paper compares, in its order."""

_NO_LETTERS = str.maketrans("", "", " -_+")


def _spell(name: str) -> str:
    """Return a name without what people write differently: case, hyphens, plus signs, raised digits."""
    return unicodedata.normalize("NFKC", name).casefold().translate(_NO_LETTERS)


_SPELLINGS = {
    _spell(spelling): info for info in _TABLE for spelling in (info.name, info.label, info.function.__name__)
}


def look_up_method(name: object) -> MethodInfo | None:
    """Return what is known of a method, or None.

    Parameters
    ----------
    name : str
        Its public name, its label or the name of its function, in any case: "3dhv", "hough3d" and "3DHV"
        are one method, as are "sc2pcr" and "SC2-PCR".
    """
    return _SPELLINGS.get(_spell(name)) if isinstance(name, str) else None


def find_method(name: object, otherwise: str = "") -> MethodInfo:
    """Return what is known of a method.

    Parameters
    ----------
    name : str
        As in `look_up_method`.
    otherwise : str
        What else may be given, for the error: ", or give module:function".

    Returns
    -------
    MethodInfo
        With its public name.

    Raises
    ------
    InputError
        If there is no such method; the message lists those that there are, and the one probably meant.

    Examples
    --------
    >>> find_method("Hough3D").name, find_method("TEASER++").name
    ('3dhv', 'teaser')
    """
    info = look_up_method(name)
    if info is None:
        similar = guess_word(_spell(name), _SPELLINGS) if isinstance(name, str) else None
        meant = None if similar is None else _SPELLINGS[similar].name
        refuse_word("method", name, METHOD_INFO, meant, otherwise)
    return info


def label_of(method: str) -> str:
    """Say what tables and messages call a method.

    Parameters
    ----------
    method : str
        Any of its names.

    Returns
    -------
    str
        Its short name.

    Raises
    ------
    InputError
        For a name that no method has.

    Examples
    --------
    >>> from cgroup.registry import label_of
    >>> label_of("hough3d"), label_of("sc2pcr")
    ('3DHV', 'SC2-PCR')
    """
    return find_method(method).label


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
    "3dmatch": {
        "mac": {"tolerance": 0.1, "max_distance_difference": 0.01},
        "sc2pcr": {"tolerance": 0.1, "max_distance_difference": 0.1, "nms_radius": 0.1},
        "turboreg": {"tolerance": 0.1, "max_distance_difference": 0.012, "nms_radius": 0.15},
        "teaser": {"tolerance": 0.05},
        "clipper": {"max_distance_difference": 0.1, "deviation": 0.05},
    },
    "kitti": {
        "mac": {"tolerance": 0.6, "max_distance_difference": 0.19, "min_weight": 0.9, "min_clique_size": 4},
        "sc2pcr": {"tolerance": 0.6, "max_distance_difference": 0.1, "nms_radius": 0.6},
        "turboreg": {"tolerance": 0.6},
        "teaser": {"tolerance": 0.3},
        "clipper": {"max_distance_difference": 0.6, "deviation": 0.3},
    },
}
"""Options of each method by where they come from: the paper's defaults, its formulas read to the letter,
the options with which each method's own author differs, PCL's variants (3DHV's needs a ``bin_size`` as
well), the evaluation group's later constants, and the constants in metres that were published for rooms
thinned to 5 cm (3DMatch) and streets thinned to 30 cm (KITTI)."""
