"""The page of ``cgroup evaluate``: its tables, and a chart of recall over the limits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape

from cgroup.pages.page import chart_html, chart_text, facts_html, page_html, part, table_html


def evaluation_page(
    title: str,
    recall: str,
    tables: Iterable[tuple[str, Sequence[str], Sequence[Sequence[str]]]],
    factors: Sequence[float],
    curves: Mapping[str, Sequence[float | None]],
    facts: Iterable[tuple[str, str]],
) -> str:
    """Make a page of tables (heading, columns, rows) and of a recall at multiples of its limits."""
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
    described = facts_html((name, escape(text)) for name, text in facts)
    body = f"{first}{chart}{''.join(others)}{described}"
    css = part("viewer.css")
    return page_html(title, f"<main><h1>{escape(title)}</h1>{body}</main>", css=css)


def _table(heading: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = "".join(
        f'<tr><th scope="row">{escape(name)}</th>{"".join(f"<td>{escape(cell)}</td>" for cell in cells)}</tr>'
        for name, *cells in rows
    )
    return f"<section><h2>{escape(heading)}</h2>{table_html(columns, lines, label=heading)}</section>"
