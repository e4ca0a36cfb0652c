"""Point cloud registration, and grouping of 3D correspondences that are mostly wrong.

>>> import numpy as np
>>> from cgroup import gtm
>>> rng = np.random.default_rng(0)
>>> source = rng.uniform(size=(50, 3))
>>> target = source + [1.0, 0.0, 0.0]
>>> target[30:] = rng.uniform(size=(20, 3))
>>> result = gtm(source, target)
>>> bool(result.mask[:30].all()), bool(result.mask[30:].any())
(True, False)
"""

import importlib as _importlib
import sys as _sys
import warnings as _warnings
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from cgroup._runtime import interrupts

interrupts.watch_for_interrupts()  # before anything that takes time

from cgroup import _core
from cgroup._core import __version__
from cgroup._runtime.memory import reserve_linear_algebra as _reserve_linear_algebra
from cgroup.errors import CgroupError, InputError, NoConsensusError, OutOfMemoryError
from cgroup.explanation import Explanation
from cgroup.group import certify, group, group_many, group_motions, match_probabilities
from cgroup.registry import METHODS, PAPER_METHODS, PRESETS
from cgroup.types import Correspondences, Grouping

from . import methods
from .methods import *  # noqa: F403 - the methods, as they list themselves

if _TYPE_CHECKING:
    from cgroup import comparison as comparison
    from cgroup import datasets as datasets
    from cgroup import evaluation as evaluation
    from cgroup import features as features
    from cgroup import io as io
    from cgroup import nuisances as nuisances
    from cgroup import pages as pages
    from cgroup import plots as plots
    from cgroup import registration as registration
    from cgroup import scenes as scenes
    from cgroup import targets as targets
    from cgroup import verification as verification
    from cgroup.io import read_cloud as read_cloud
    from cgroup.io import write_cloud as write_cloud
    from cgroup.registration import Registration as Registration
    from cgroup.registration import assess as assess
    from cgroup.registration import prepare as prepare
    from cgroup.registration import recognize as recognize
    from cgroup.registration import refine as refine
    from cgroup.registration import register as register
    from cgroup.registration import register_many as register_many
    from cgroup.scenes import locate as locate
    from cgroup.scenes import register_all as register_all
    from cgroup.targets import TargetFit as TargetFit
    from cgroup.targets import fit_targets as fit_targets

    merge = register_all

__all__ = [
    "METHODS", "PAPER_METHODS", "PRESETS", "CgroupError", "Correspondences", "Explanation", "Grouping",
    "InputError", "NoConsensusError", "OutOfMemoryError", "__version__", "certify", "group", "group_many",
    "group_motions", "match_probabilities",
]  # fmt: skip
__all__ += methods.__all__


_ROOMS = [
    "comparison", "datasets", "evaluation", "features", "io", "nuisances", "pages", "plots", "registration",
    "scenes", "targets", "verification",
]  # fmt: skip
_FROM_ROOMS = {
    "io": "read_cloud write_cloud",
    "registration": "Registration assess prepare recognize refine register register_many",
    "scenes": "locate register_all",
    "targets": "TargetFit fit_targets",
}
_ROOM_OF = {name: room for room, names in _FROM_ROOMS.items() for name in names.split()}
_ALIASES = {"merge": "register_all"}  # the name of the command


def __getattr__(name: str) -> _Any:  # noqa: ANN401 - a module or a function
    """Load names on first use, so that `import cgroup` stays fast."""
    if name in _ROOMS:
        return _importlib.import_module(f"cgroup.{name}")
    own = _ALIASES.get(name, name)
    if own in _ROOM_OF:
        return getattr(_importlib.import_module(f"cgroup.{_ROOM_OF[own]}"), own)
    raise AttributeError(f"module 'cgroup' has no attribute {name!r}", name=name, obj=_sys.modules[__name__])


def __dir__() -> list[str]:
    return sorted({*__all__, *_ROOMS, *_ROOM_OF, *_ALIASES, "methods"})


_reserve_linear_algebra()

if _core.DEBUG_BUILD:
    _warnings.warn(
        "cgroup was built without optimisation, many times slower; rebuild with `maturin develop --release`",
        RuntimeWarning,
        stacklevel=2,
    )
