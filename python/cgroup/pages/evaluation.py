"""The page of results that a benchmark scores: its tables, and recall over the limits to point at."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from cgroup.pages.page import chart_html, chart_text, page_html, part

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

_STYLE = ".methods :is(th, td):first-child { text-align: left; } .methods tbody tr { cursor: auto; }"


def evaluation_page(
    title: str,
    tables: Iterable[tuple[str, Sequence[str], Sequence[Sequence[str]]]],
    factors: Sequence[float],
    curves: Mapping[str, Sequence[float | None]],
    facts: Iterable[tuple[str, str]],
) -> str:
    """Make a page of tables by heading, columns and rows, and of recalls at limits times some factors."""
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
    axes = {
        "xaxis": {"title": {"text": "limits x"}},
        "yaxis": {"title": {"text": "recall in %"}, "range": [0, 102]},
    }
    figure = {"data": traces, "layout": {**axes, "hovermode": "x unified", "showlegend": True}}
    chart = chart_html("curves", figure, label="Recall over the limits, times a factor")
    lines = "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in facts)
    body = f'{first}{chart}{"".join(others)}<dl class="facts">{lines}</dl>'
    css = part("viewer.css") + _STYLE
    return page_html(title, f"<main><h1>{escape(title)}</h1>{body}</main>", css=css)


def _table(heading: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f'<th scope="col">{escape(name)}</th>' for name in columns)
    lines = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    table = f'<table class="methods"><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>'
    return f'<section><h2>{escape(heading)}</h2><div class="scroll">{table}</div></section>'
