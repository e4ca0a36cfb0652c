"""3D correspondence grouping: find the right matches between two 3D shapes among mostly wrong ones.

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

from __future__ import annotations

import warnings as _warnings
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from cgroup._runtime import interrupts

interrupts.watch_for_interrupts()  # before anything that takes time

from cgroup import _core
from cgroup._core import __version__
from cgroup._show.hooks import fill_hooks as _fill_hooks
from cgroup.errors import CgroupError, InputError, NoConsensusError, OutOfMemoryError
from cgroup.explanation import Explanation
from cgroup.group import group, group_many
from cgroup.registry import METHODS, PAPER_METHODS, PRESETS
from cgroup.types import Correspondences, Grouping

from . import methods
from .methods import *  # noqa: F403 - the methods, as they list themselves

if _TYPE_CHECKING:
    from cgroup._show.drawing import Drawing as _Drawing

__all__ = [
    "METHODS",
    "PAPER_METHODS",
    "PRESETS",
    "CgroupError",
    "Correspondences",
    "Explanation",
    "Grouping",
    "InputError",
    "NoConsensusError",
    "OutOfMemoryError",
    "__version__",
    "group",
    "group_many",
]
__all__ += methods.__all__


def _explain(grouping: Grouping, index: int) -> Explanation:
    from cgroup._explain import explain_match  # noqa: PLC0415 - loaded when it is called for

    return explain_match(grouping, index)


def _draw(drawing: _Drawing) -> _Any:  # noqa: ANN401 - matplotlib's Figure
    from cgroup.plots.matches import figure_of  # noqa: PLC0415 - as above

    return figure_of(drawing)


def _draw_interactive(drawing: _Drawing) -> _Any:  # noqa: ANN401 - plotly's Figure
    from cgroup.pages.scene import figure_of  # noqa: PLC0415 - as above

    return figure_of(drawing)


_fill_hooks(explanation=_explain, figure=_draw, chart=_draw_interactive)

if _core.DEBUG_BUILD:
    _warnings.warn(
        "cgroup was built without optimisation, many times slower; rebuild with `maturin develop --release`",
        RuntimeWarning,
        stacklevel=2,
    )
