"""Self-contained HTML pages with charts and plotly's compressed script.

`page_html` makes a page around a body, which holds charts by `chart_html` at any place. Callers escape names
from outside, such as those of files: in a body by `html.escape`, in a chart by `chart_text`.
"""

from __future__ import annotations

import base64
import functools
import gzip
import html
import importlib
import json
import os
from collections.abc import Iterable, Sequence
from importlib import resources
from itertools import groupby
from operator import itemgetter
from string import Template
from typing import Any

import numpy as np

from cgroup._checks.values import as_instance, refusal
from cgroup._show.words import pose_lines
from cgroup.errors import InputError
from cgroup.io import write_file
from cgroup.io.files import number_lines
from cgroup.types import FloatArray

# Letters that could end a script or a comment; JSON has them in texts only, where escapes mean the same.
_UNSAFE_IN_SCRIPTS = {ord(letter): f"\\u{ord(letter):04x}" for letter in "<>&\u2028\u2029"}


def chart_html(name: str, figure: Any, *, label: str, height: str = "28rem", caption: str = "") -> str:  # noqa: ANN401
    """Make the HTML of one chart, for the body of `page_html`.

    The chart is drawn when it becomes visible, in the page's light or dark colours; the figure's template is
    left out.
    """
    below = f"<figcaption>{caption}</figcaption>" if caption else ""
    return (
        f'<figure class="chart" id="{html.escape(name)}" style="--height: {html.escape(height)}">'
        f'<div class="chart-area" role="img" aria-label="{html.escape(label)}"></div>'
        f'<script type="application/json">{_json(_plain(figure))}</script>{below}</figure>'
    )


def data_html(name: str, value: Any) -> str:  # noqa: ANN401 - whatever JSON can hold
    """Make the HTML of hidden data for a page's own script."""
    return f'<script type="application/json" id="{html.escape(name)}">{_json(value)}</script>'


def _json(value: Any) -> str:  # noqa: ANN401 - as above
    return json.dumps(value, separators=(",", ":"), allow_nan=False).translate(_UNSAFE_IN_SCRIPTS)


def chart_text(text: object) -> str:
    """Escape a text for a chart; plotly interprets ``<b>``, ``<br>`` and ``&lt;`` as HTML."""
    return html.escape(str(text), quote=False)


def facts_html(facts: Iterable[tuple[str, str]]) -> str:
    """Make the HTML of names and values in HTML; consecutive equal names are shown once."""
    lines = "".join(
        f"<dt>{html.escape(name)}</dt>{''.join(f'<dd>{value}</dd>' for _, value in same)}"
        for name, same in groupby(facts, itemgetter(0))
    )
    return f'<dl class="facts">{lines}</dl>' if lines else ""


def pose_html(pose: FloatArray, cloud: FloatArray) -> str:
    """Make the HTML of the pose of a cloud, with a button that copies it in full precision."""
    lines = "\n".join(pose_lines(pose, cloud.mean(axis=0), float(np.linalg.norm(np.ptp(cloud, axis=0)))))
    exact = "\n".join(number_lines(pose))
    return f'<pre>{lines}</pre><button type="button" data-copy="{exact}">Copy in full precision</button>'


def table_html(columns: Iterable[str], lines: str, *, label: str) -> str:
    """Make the HTML of a table that scrolls, from its rows."""
    head = "".join(f'<th scope="col">{html.escape(name)}</th>' for name in columns)
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{html.escape(label)}">'
        f'<table class="methods"><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table></div>'
    )


def scale_html(colors: Sequence[str], end: float) -> str:
    """Make the HTML of a colour scale from 0 to its end."""
    return (
        f'<div class="scale"><div style="background: linear-gradient(90deg, {", ".join(colors)})"></div>'
        f"<span>0</span><span>{end / 2:.2g}</span><span>≥ {end:.2g}</span></div>"
    )


def page_html(title: str, body: str, *, css: str = "", script: str = "") -> str:
    """Make a page of style, body, and the scripts that draw its charts."""
    library = _plotly_html() if '<figure class="chart"' in body else ""
    css, script = part("page.css") + css, part("page.js") + script
    return fill("page.html", title=html.escape(title), css=css, body=body, library=library, script=script)


def write_page(path: str | os.PathLike[str], page: str) -> None:
    """Write a page into a file.

    Parameters
    ----------
    path : path-like
        Usually ends in ``.html``.
    page : str
        Page from `page_html`.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "page.html")
    ...     write_page(path, page_html("Nothing yet", "<main></main>"))
    ...     path.read_text()[:15]
    '<!doctype html>'
    """
    # Bytes of file names that are no text become question marks.
    write_file(path, as_instance("page", page, str).encode("utf-8", "replace"))


def _plain(figure: Any) -> dict[str, Any]:  # noqa: ANN401 - plotly has no types
    """Return a figure for JSON; arrays of numbers become bytes in base64."""
    kind, known = load_plotly("graph_objects").Figure, load_plotly("basedatatypes").BaseFigure
    try:
        drawn = as_instance("figure", kind(figure) if isinstance(figure, dict) else figure, known)
        content = json.loads(str(drawn.to_json(validate=False)))
        data, layout = content["data"], content["layout"]
    except (TypeError, ValueError) as error:
        refused = refusal("figure", figure, "give a plotly figure, or a dict of its data and layout")
        raise refused from error
    return {"data": data, "layout": {name: value for name, value in layout.items() if name != "template"}}


@functools.cache
def _plotly_html() -> str:
    script = load_plotly("offline").get_plotlyjs()
    packed = base64.b64encode(gzip.compress(script.encode(), mtime=0)).decode("ascii")
    return f'<script type="text/plain" id="chart-library">{packed}</script>'


def load_plotly(part_of_it: str) -> Any:  # noqa: ANN401 - a module
    """Import a module of plotly, an optional dependency."""
    try:
        return importlib.import_module(f"plotly.{part_of_it}")
    except ModuleNotFoundError as error:
        message = "interactive pages need plotly; pip install 'cgroup[scans]'"
        raise InputError(message) from error


def fill(name: str, **values: object) -> str:
    """Return a template of this package with values, which are HTML."""
    return Template(part(name)).substitute(values)


@functools.cache
def part(name: str) -> str:
    """Return a file of this package: a template, a style or a script."""
    return resources.files("cgroup.pages").joinpath(name).read_text(encoding="utf-8")
