"""The way from results to what explains and draws them.

Results lie in the lowest layers, what draws them in the highest: this module, and no other, imports upwards,
when it is called.
"""

from __future__ import annotations

from typing import Any

from cgroup.errors import InputError

_EXTRA = "drawing needs {}; pip install 'cgroup[scans]'"


def explain(grouping: Any, index: int) -> Any:  # noqa: ANN401 - types lie in higher layers
    """Return the `Explanation` of one match."""
    from cgroup._explain import explain_match  # noqa: PLC0415 - upwards

    return explain_match(grouping, index)


def draw(drawing: Any, *, interactive: bool) -> Any:  # noqa: ANN401 - as above
    """Return a figure: matplotlib's, or plotly's to turn around."""
    try:
        if interactive:
            from cgroup.pages.scene import figure_of  # noqa: PLC0415 - upwards
        else:
            from cgroup.plots.results import figure_of  # noqa: PLC0415 - upwards
        return figure_of(drawing)
    except ModuleNotFoundError as missing:
        raise InputError(_EXTRA.format(missing.name)) from missing
