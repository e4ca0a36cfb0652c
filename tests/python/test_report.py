"""The report is one page that needs nothing else, and shows what the run has and nothing that it has not."""

import json
import re
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from benchmark_frames import paper_frame, paper_timing

from cgroup.benchmark.paper import EXPERIMENTS
from cgroup.benchmark.paper.claims import CLAIMS
from cgroup.benchmark.paper.evidence import Evidence
from cgroup.benchmark.report import page as report
from cgroup.benchmark.report.cells import method_cell, number
from cgroup.benchmark.report.charts import FigureFiles
from cgroup.benchmark.report.sections import ranking_table, score_table
from cgroup.benchmark.stats import bootstrap
from cgroup.errors import InputError
from cgroup.evaluation.protocols import LEAST_PAIRS
from cgroup.plots.charts import Chart

VOID = {"meta", "img", "input", "link", "br", "hr"}
CONTENT = {"table", "figure"}
MOST_BYTES = 4_000_000


class Page(HTMLParser):
    """What a page holds; fails on tags that don't match, and on attributes that stand twice."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.outline: list[str] = []  # headings by their anchors, and tables and figures between them
        self.metas: dict[str, dict] = {}  # of charts, by their names
        self._chart = ""
        self.feed(text)
        assert not self.open, self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        assert len(given) == len(attrs), attrs
        if "id" in given:
            self.ids.append(given["id"])
        if tag == "a":
            self.links.append(given["href"])
        if tag == "figure":
            self._chart = given.get("id", "")
        if tag == "h2":
            self.outline.append("#" + given["id"])
        if tag in CONTENT:
            self.outline.append(tag)
        if tag not in VOID:
            self.open.append(tag)
        if tag == "script" and given.get("type") == "application/json":
            self.open[-1] = "script"

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "script" and data.startswith('{"data"'):
            self.metas[self._chart] = json.loads(data)["layout"]["meta"]

    def series(self, chart: str, panel: int, key: str) -> dict:
        (found,) = [each for each in self.metas[chart]["panels"][panel]["series"] if each["key"] == key]
        return found


def results(frame: pd.DataFrame, timing: pd.DataFrame, **changes: object) -> report.ReportData:
    datasets = [
        {"name": name, "title": f"Title of {name}", "role": "full-full", "citation": "somebody"}
        for name in frame["dataset"].unique()
    ]
    machine = {"id": "a", "cpu": "some", "cores": 2, "system": "Linux", "python": "3.11", "numpy": "2.0"}
    fields = {
        "results": dict.fromkeys(("registration", "scenes", "matches"), pd.DataFrame())
        | {"experiment": frame, "timing": timing},
        "skips": pd.DataFrame(columns=["method", "n", "threads", "reason", "machine"]),
        "machines": pd.DataFrame([machine]),
        "datasets": pd.DataFrame(datasets, columns=["name", "title", "role", "citation"]),
        "config": {"name": "made-up", "seed": 3, "experiment": ["noise"], "registration": None},
        "missing": {},
    }
    return report.ReportData(**(fields | changes))


def write(monkeypatch: pytest.MonkeyPatch, out: Path, given: report.ReportData) -> tuple[Page, str]:
    """Write the report of made-up results."""
    monkeypatch.setattr(report.ReportData, "load", lambda _: given)
    path = report.write_report(out)
    text = path.read_text(encoding="utf-8")
    return Page(text), text


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Page, str]:
    """One experiment with a failure, an experiment of one's own, and times."""
    frame = paper_frame("noise", "variants")
    own = frame["experiments"].map(lambda ids: "variants" in ids) & (frame["dataset"] == "u3or")
    frame = frame[~own].reset_index(drop=True)
    frame.loc[frame.index[:9], ["error", "precision", "recall", "f_score"]] = [
        "InputError: too <few>",
        *[None] * 3,
    ]
    out = tmp_path_factory.mktemp("report")
    with pytest.MonkeyPatch.context() as patch:
        page, text = write(patch, out, results(frame, paper_timing(), missing={"u3or": "get it there"}))
    return out, page, text


def test_page_fetches_nothing(written):
    out, page, text = written
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", text)
    assert not re.search(r"@import", text)
    files = [link for link in page.links if not link.startswith("#")]
    assert files
    assert all((out / link).is_file() for link in files)


def test_links_lead_somewhere_and_ids_are_unique(written):
    _, page, _ = written
    assert {link.removeprefix("#") for link in page.links if link.startswith("#")} <= set(page.ids)
    assert len(page.ids) == len(set(page.ids))


def test_charts_are_described(written):
    _, page, text = written
    # An experiment, one of one's own whose levels are none, and time.
    assert set(page.metas) == {"chart-noise-b3r", "chart-time"}
    labels = re.findall(r'role="img" aria-label="([^"]*)"', text)
    assert len(labels) == 2
    assert all(len(label) > 40 for label in labels)


def test_sections_without_records_are_left_out(written):
    _, page, text = written
    shown = [each for each in page.outline if each.startswith("#")]
    assert shown == ["#ranking", "#noise", "#further", "#time", "#scores", "#claims", "#data"]
    assert shown == page.links[: len(shown)], "the list of sections names those that there are"
    assert "No records" not in text
    assert "u3or: get it there" in text


def test_no_section_is_empty(written):
    _, page, _ = written
    empty = [one for one, other in pairwise([*page.outline, "#end"]) if one[0] == "#" and other[0] == "#"]
    assert empty == []


def test_charts_hold_the_means_and_their_intervals(written):
    _, page, _ = written
    rows = paper_frame("noise")
    chart = page.metas["chart-noise-b3r"]
    assert [panel["title"] for panel in chart["panels"][:4]] == [
        "F",
        "precision",
        "recall",
        "precision > 0.1 (the paper's)",
    ]
    series = page.series("chart-noise-b3r", 1, "gtm")
    mine = rows[rows["method"] == "gtm"].groupby(rows["level"].round(6))["precision"]
    np.testing.assert_allclose(series["y"][1:], mine.mean()[1:], rtol=1e-4)
    assert series["counts"] == [2, *[3] * 8], "one pair failed at the lowest level"
    assert set(series["low"]) == {None}, "too few pairs for an interval"
    assert chart["least"] == LEAST_PAIRS


def test_levels_of_few_pairs_are_marked_and_others_have_intervals(monkeypatch, tmp_path):
    draw_no_figures(monkeypatch)
    frame = paper_frame("overlap")
    levels = sorted(frame["overlap"].unique())
    few = (frame["overlap"] == levels[0]) & ~frame["pair"].str.endswith(("-0", "-7"))
    page, text = write(monkeypatch, tmp_path, results(frame[~few], pd.DataFrame()))
    series = page.series("chart-overlap-u3m", 0, "gtm")
    assert 0 < series["counts"][0] < LEAST_PAIRS
    assert series["low"][0] is None
    series = page.series("chart-overlap-u3m", 0, "ransac")
    rows = frame[(frame["overlap"] == levels[3]) & (frame["method"] == "ransac")]
    (interval,) = bootstrap(rows["f_score"].to_numpy()[:, None])
    found = [series[name][3] for name in ("y", "low", "high")]
    np.testing.assert_allclose(found, interval, atol=0.02)
    assert found[1] + 0.05 < found[0] < found[2] - 0.05
    assert "Hollow markers" in text


def test_labels_are_shown_as_they_are(monkeypatch, tmp_path):
    draw_no_figures(monkeypatch)
    nasty = "</script><b>my</b> & \u2028$x$ %{y}"
    frame = paper_frame("noise")
    frame = frame.assign(method=frame["method"].replace({"gtm": nasty}))
    page, text = write(monkeypatch, tmp_path, results(frame, pd.DataFrame()))
    assert page.metas["chart-noise-b3r"]["looks"][nasty]["label"] == nasty
    assert "<b>my</b>" not in text
    assert "&lt;/script&gt;&lt;b&gt;my&lt;/b&gt; &amp; \u2028$x$ %{y}" in text


def test_the_whole_evaluation_stays_small(monkeypatch, tmp_path):
    draw_no_figures(monkeypatch)
    page, text = write(monkeypatch, tmp_path, results(paper_frame(), paper_timing()))
    assert len(text.encode()) < MOST_BYTES
    assert set(EXPERIMENTS) <= set(page.ids)
    assert len(page.metas) == 11


def draw_no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out what takes most of the time, and isn't in the page."""
    monkeypatch.setattr(FigureFiles, "save", lambda _, name, *__, **___: name)
    monkeypatch.setattr(Chart, "draw", lambda *_, **__: None)


def test_failures_are_listed_with_their_errors(written):
    _, _, text = written
    assert "InputError: too &lt;few&gt;" in text
    assert re.search(r"<b>9</b>failed records", text)


def test_every_claim_is_a_row(written):
    out, page, text = written
    assert {claim.id for claim in CLAIMS} <= set(page.ids)
    assert text.count("data-verdict=") == 68
    assert (out / "claims.md").read_text(encoding="utf-8").startswith("# Claims of the paper")


def test_report_of_almost_nothing(monkeypatch, tmp_path):
    frame = paper_frame("noise").query("level == 0.05").assign(experiments=[("other",)] * 27)
    page, text = write(monkeypatch, tmp_path, results(frame, pd.DataFrame()))
    assert [each for each in page.outline if each[0] == "#"] == ["#ranking", "#further", "#scores", "#data"]
    assert "TPAMI" not in text
    assert "laim" not in text.partition("<main>")[2].partition("</main>")[0]
    assert not page.metas


def test_no_claim_is_judged_on_generated_shapes(monkeypatch, tmp_path):
    draw_no_figures(monkeypatch)
    frame = paper_frame("noise").assign(dataset="standin-full", origin="synthetic")
    page, text = write(monkeypatch, tmp_path, results(frame, pd.DataFrame()))
    assert "claims" not in page.ids
    assert "confirmed" not in text.partition("<main>")[2].partition("</main>")[0]
    assert "these are generated shapes, and the paper measured others" in text
    told = (tmp_path / "claims.md").read_text(encoding="utf-8")
    assert "68 claims: 0 confirmed, 0 partly, 0 not confirmed, 68 not testable" in told
    assert "would rest on generated shapes" in told


def test_folder_without_records(tmp_path):
    with pytest.raises(InputError, match="cgroup benchmark run"):
        report.write_report(tmp_path)


def test_ranking_marks_the_best_and_its_ties():
    sample = Evidence(paper_frame("noise"), pd.DataFrame()).sample("noise", "B3R")
    table = ranking_table(sample)
    assert [row[1].text for row in table.rows[:2]] == ["RANSAC", "ST"]
    assert [row[2].best for row in table.rows[:3]] == [True, True, False]
    assert table.numeric == [True] * 6
    assert table.right == [True, False, *[True] * 4]


def test_scores_in_the_papers_order():
    samples = Evidence(paper_frame("noise", "overlap"), pd.DataFrame()).samples()
    table = score_table(samples)
    assert [row[2].text for row in table.rows[:3]] == ["SS", "NNSR", "SI"]
    assert len(table.rows) == 18
    assert len(table.headers) == len(table.rows[0])


def test_numbers_that_are_missing_sort_last():
    assert number(float("nan")).text == "-"
    assert number(float("nan")).key < number(-1e9).key
    assert method_cell("3dhv").key < method_cell("gtm").key < method_cell("mine").key
