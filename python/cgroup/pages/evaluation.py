"""The page of results that a benchmark scores: its tables, and recall over the limits to point at."""

from __future__ import annotations

from html import escape
from itertools import groupby
from operator import itemgetter
from typing import TYPE_CHECKING

from cgroup.pages.page import chart_html, chart_text, page_html, part

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

_STYLE = ".methods tbody tr { cursor: auto; } .facts dd { grid-column: 2; }"


def evaluation_page(
    title: str,
    recall: str,
    tables: Iterable[tuple[str, Sequence[str], Sequence[Sequence[str]]]],
    factors: Sequence[float],
    curves: Mapping[str, Sequence[float | None]],
    facts: Iterable[tuple[str, str]],
) -> str:
    """Make a page of tables by heading, columns and rows, and of a recall at factors of its limits."""
    first, *others = (_table(*table) for table in tables)
    traces = [
        {
            "type": "scatter",
            "mode": "lines+markers",
            "name": chart_text(name),
            "x": list(factors),
            "y": [None if share is None else 100 * share for share in shares],
            "hovertemplate": "%{y:.2f} %",
        }
        for name, shares in curves.items()
    ]
    layout = {
        "xaxis": {"title": {"text": "limits x"}},
        "yaxis": {"title": {"text": f"{chart_text(recall)}, recall in %"}, "range": [0, 102]},
        "hovermode": "x unified",
        "showlegend": True,
        # Beside the chart, long names would leave it no room.
        "legend": {"orientation": "h", "yanchor": "top", "y": -0.2},
    }
    label = f"{recall}: recall over the limits, times a factor"
    chart = chart_html("curves", {"data": traces, "layout": layout}, label=label)
    lines = "".join(
        f"<dt>{escape(name)}</dt>{''.join(f'<dd>{escape(text)}</dd>' for _, text in same)}"
        for name, same in groupby(facts, itemgetter(0))
    )
    body = f'{first}{chart}{"".join(others)}<dl class="facts">{lines}</dl>'
    css = part("viewer.css") + _STYLE
    return page_html(title, f"<main><h1>{escape(title)}</h1>{body}</main>", css=css)


def _table(heading: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f'<th scope="col">{escape(name)}</th>' for name in columns)
    lines = "".join(
        f'<tr><th scope="row">{escape(name)}</th>{"".join(f"<td>{escape(cell)}</td>" for cell in cells)}</tr>'
        for name, *cells in rows
    )
    table = f'<table class="methods"><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>'
    scroll = f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(heading)}">{table}</div>'
    return f"<section><h2>{escape(heading)}</h2>{scroll}</section>"
