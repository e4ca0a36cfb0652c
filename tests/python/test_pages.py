"""Pages hold what they show, and nothing that is shown can break out of its place."""

import base64
import gzip
import json
import re
import sys

import numpy as np
import pytest

from cgroup import InputError
from cgroup.pages import chart_html, chart_text, page_html, write_page

plotly = pytest.importorskip("plotly", reason="needs the extra cgroup[scans]")

NASTY = "</script><!--<img src=x onerror=alert(1)>&amp;\"'\u2028\u2029$title %{x}"


def _content(chart: str) -> dict[str, object]:
    (text,) = re.findall(r'<script type="application/json">(.*?)</script>', chart, re.DOTALL)
    return json.loads(text)


def test_a_chart_keeps_its_texts_and_cannot_end_its_script() -> None:
    chart = chart_html("a", {"data": [{"y": [1, 2], "name": NASTY}], "layout": {}}, label=NASTY)
    assert chart.count("</script>") == 1
    assert not set("<&\u2028\u2029") & set(chart.partition('application/json">')[2].partition("</script>")[0])
    assert _content(chart)["data"][0]["name"] == NASTY
    assert "<img" not in chart


def test_a_page_escapes_its_title_and_keeps_dollars() -> None:
    page = page_html(NASTY, "<main>$body ${css}</main>", script="const price = `$${1}`;")
    assert "<title>&lt;/script&gt;" in page
    assert "<main>$body ${css}</main>" in page
    assert "const price = `$${1}`;" in page


def test_chart_text_leaves_no_markup() -> None:
    assert chart_text("<b>&amp;") == "&lt;b&gt;&amp;amp;"


def test_a_page_fetches_nothing_and_holds_plotly_once() -> None:
    chart = chart_html("a", {"data": [{"y": [1]}], "layout": {}}, label="A")
    page = page_html("A", chart + chart.replace('id="a"', 'id="b"'))
    (packed,) = re.findall(r'id="chart-library">(.*?)</script>', page)
    assert b"plotly.js" in gzip.decompress(base64.b64decode(packed))[:200]
    assert len(page) < 2_100_000
    assert "default-src 'none'" in page
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", page)


def test_a_page_without_charts_does_without_plotly() -> None:
    assert len(page_html("A", "<main></main>")) < 20_000


def test_arrays_stay_short() -> None:
    values = np.arange(30_000, dtype=np.float32)
    chart = chart_html("a", plotly.graph_objects.Figure({"data": [{"y": values}]}), label="A")
    assert len(chart) < 4 * len(values) * 4 / 3 + 2_000


def test_a_page_of_an_unprintable_name_can_be_written(tmp_path) -> None:
    write_page(tmp_path / "page.html", page_html("a\udcff", "<main></main>"))
    assert b"<title>a?</title>" in (tmp_path / "page.html").read_bytes()


@pytest.mark.parametrize("figure", [None, 3, {"data": [object()]}, {"data": 3}, [1]])
def test_what_is_no_figure_is_refused(figure: object) -> None:
    with pytest.raises(InputError, match="figure: got .*; give a plotly figure"):
        chart_html("a", figure, label="A")


def test_without_plotly_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "plotly.graph_objects", None)
    with pytest.raises(InputError, match=re.escape("pip install 'cgroup[scans]'")):
        chart_html("a", {"data": []}, label="A")
