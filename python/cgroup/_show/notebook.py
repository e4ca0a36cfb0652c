"""Notebook tables of results in HTML and SVG, for light and dark pages."""

from collections.abc import Iterable
from html import escape

from cgroup._checks.arrays import FloatArray
from cgroup._show.words import pose_lines

_BAR = 120  # pixels
_KEPT = "#0072B2"
_CELL = "text-align: left; padding: .1em .9em .1em 0; vertical-align: top; background: none; border: 0"


def result_table(title: str, share: float | None, rows: Iterable[tuple[str, str]]) -> str:
    """Return a table: a title, a bar for a fraction in [0,1], and names with values.

    Values are plain text, or what `pose_html` returned; rows without a value are left out.
    """
    lines = "".join(_row(name, value) for name, value in rows if value)
    bar = "" if share is None else _bar(share)
    return (
        '<div style="font-size: .95em; line-height: 1.4">'
        f'<div style="margin-bottom: .3em"><b>{escape(title)}</b>{bar}</div>'
        f'<table style="border-collapse: collapse; border: 0; margin: 0">{lines}</table></div>'
    )


def _row(name: str, value: str) -> str:
    shown = value if isinstance(value, _Html) else escape(value)
    return (
        f'<tr style="background: none"><th scope="row" style="{_CELL}; font-weight: normal; opacity: .7">'
        f'{escape(name)}</th><td style="{_CELL}">{shown}</td></tr>'
    )


class _Html(str):
    """A text in HTML."""

    __slots__ = ()


def pose_html(pose: FloatArray) -> str:
    """Write a transform as lines of exact numbers of one width."""
    lines = "\n".join(pose_lines(pose))
    return _Html(
        f'<pre style="margin: 0; padding: 0; background: none; color: inherit; border: 0">{lines}</pre>'
    )


def _bar(share: float) -> str:
    width = round(_BAR * min(max(share, 0.0), 1.0), 1)
    return (
        f' <svg width="{_BAR}" height="10" role="img" aria-label="{100 * share:.0f} %"'
        ' style="margin-left: .5em">'
        f'<rect width="{_BAR}" height="10" rx="2" fill="currentColor" opacity=".15"/>'
        f'<rect width="{width}" height="10" rx="2" fill="{_KEPT}"/></svg>'
    )
