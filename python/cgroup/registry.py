"""The table of grouping methods, with all facts about a method except its parameters.

Names, plot styles, help texts and tables derive from it. `METHODS` is what exists; `PAPER_METHODS` is what
the paper compared: its claims and presets are about those nine, whatever else is added.
"""

import unicodedata
from collections.abc import Callable, Mapping
from typing import Any

from cgroup._checks.values import guess_word, refuse_word
from cgroup.methods import METHOD_INFO, MethodName
from cgroup.methods._declare import MethodInfo, MethodOption
from cgroup.types import Grouping

__all__ = [
    "METHODS", "METHOD_INFO", "PAPER_METHODS", "PRESETS", "MethodInfo", "MethodName", "MethodOption",
    "label_of",
]  # fmt: skip

METHODS: Mapping[str, Callable[..., Grouping]] = {info.name: info.function for info in METHOD_INFO.values()}
"""The functions of all methods by name."""

PAPER_METHODS: tuple[str, ...] = tuple(info.name for info in METHOD_INFO.values() if info.in_paper)
"""Names of the nine methods that the paper compares, in its order."""

_NO_LETTERS = str.maketrans("", "", " -_+")


def _spell(name: str) -> str:
    """Return a name in lower case, without hyphens, plus signs and raised digits."""
    return unicodedata.normalize("NFKC", name).casefold().translate(_NO_LETTERS)


_SPELLINGS = {
    _spell(spelling): info
    for info in METHOD_INFO.values()
    for spelling in (info.name, info.label, info.function.__name__)
}


def look_up_method(name: object) -> MethodInfo | None:
    """Return the facts about a method by its public name, its label or its function, or None."""
    return _SPELLINGS.get(_spell(name)) if isinstance(name, str) else None


def find_method(name: object, otherwise: str = "") -> MethodInfo:
    """Return the facts about a method; raise `InputError` with a suggestion for an unknown one."""
    # `otherwise` lists other accepted values, for the error: ", or give module:function".
    info = look_up_method(name)
    if info is None:
        similar = guess_word(_spell(name), _SPELLINGS) if isinstance(name, str) else None
        meant = None if similar is None else _SPELLINGS[similar].name
        refuse_word("method", name, METHOD_INFO, meant, otherwise)
    return info


def label_of(method: str) -> str:
    """Return the short name of a method, which is named as for `group`.

    Returns
    -------
    str
        Its short name.
    """
    return find_method(method).label


PRESETS: Mapping[str, Mapping[str, Mapping[str, Any]]] = {
    "paper": {},
    "literal": {"nnsr": {"max_ratio": 0.2}},
    "original": {
        "si": {"global_rank": "local_score", "otsu": "covis"}, "st": {"conflict": "one_to_one"},
        "gtm": {"one_to_one": True, "dynamics": "infection_immunisation", "iterations": 10_000},
    },
    "pcl": {"gc": {"variant": "clique"}, "3dhv": {"variant": "pcl"}},
    "legacy_header": {
        "ss": {"threshold": 0.5}, "si": {"min_distance_ratio": 0.8}, "cv": {"voters": 20},
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
}  # fmt: skip
"""Options of each method by where they come from: the paper's defaults, its formulas read to the letter,
the options with which each method's own author differs, PCL's variants (3DHV's needs a ``bin_size`` as
well), the evaluation group's later constants, and the constants in metres that were published for rooms
downsampled to 5 cm (3DMatch) and streets downsampled to 30 cm (KITTI)."""
