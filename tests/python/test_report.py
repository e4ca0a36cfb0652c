"""The report is one page that needs nothing else, whatever the run has."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser
from typing import TYPE_CHECKING

import pandas as pd
import pytest
from benchmark_frames import paper_frame, paper_timing

from cgroup.benchmark.claims import CLAIMS
from cgroup.benchmark.evidence import Evidence
from cgroup.benchmark.paper import EXPERIMENTS
from cgroup.benchmark.report import page as report
from cgroup.benchmark.report import sections
from cgroup.benchmark.report.cells import method_cell, number
from cgroup.benchmark.report.tables import failure_table, ranking_table, score_table
from cgroup.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

VOID = {"meta", "img", "input", "link", "br", "hr"}


class Page(HTMLParser):
    """What a page holds; fails on tags that don't match."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.images: list[dict[str, str]] = []
        self.headings: list[str] = []
        self.rows = 0
        self.feed(text)
        assert not self.open, self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        if "id" in given:
            self.ids.append(given["id"])
        if tag == "a":
            self.links.append(given["href"])
        if tag == "img":
            self.images.append(given)
        self.rows += tag == "tr"
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in {"h1", "h2", "h3"}:
            self.headings.append(data.strip())


def results(frame: pd.DataFrame, timing: pd.DataFrame, **changes: object) -> report.ReportData:
    datasets = [
        {"name": name, "title": f"Title of {name}", "role": "full-full", "citation": "somebody"}
        for name in frame["dataset"].unique()
    ]
    machine = {"id": "a", "cpu": "some", "cores": 2, "system": "Linux", "python": "3.11", "numpy": "2.0"}
    fields = {
        "frame": frame,
        "timing": timing,
        "skips": pd.DataFrame(columns=["method", "n", "threads", "reason", "machine"]),
        "machines": pd.DataFrame([machine]),
        "datasets": pd.DataFrame(datasets, columns=["name", "title", "role", "citation"]),
        "config": {"name": "made-up", "seed": 3, "experiment": ["noise"], "registration": None},
        "missing": {},
        "registrations": pd.DataFrame(),
        "trials": pd.DataFrame(),
    }
    return report.ReportData(**(fields | changes))


def write(monkeypatch: pytest.MonkeyPatch, out: Path, given: report.ReportData) -> tuple[Page, str]:
    """Write the report of made-up results; pictures of pairs need a run's masks, and say so."""
    monkeypatch.setattr(report.ReportData, "load", lambda _: given)
    monkeypatch.setattr(sections, "draw_example", no_picture)
    path = report.write_report(out)
    text = path.read_text(encoding="utf-8")
    return Page(text), text


def no_picture(*_: object) -> None:
    message = "the clouds aren't there <here>"
    raise InputError(message)


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


def test_page_fetches_nothing(written: tuple[Path, Page, str]) -> None:
    _, page, text = written
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", text)
    assert not re.search(r"@import|url\(", text)
    assert all(link.startswith("#") for link in page.links)
    assert all(image["src"].startswith("data:image/png;base64,") for image in page.images)


def test_links_lead_somewhere_and_ids_are_unique(written: tuple[Path, Page, str]) -> None:
    _, page, _ = written
    assert {link.removeprefix("#") for link in page.links} <= set(page.ids)
    assert len(page.ids) == len(set(page.ids))


def test_images_are_whole_and_described(written: tuple[Path, Page, str]) -> None:
    _, page, _ = written
    # An experiment with three figures, one of one's own without levels, and time.
    assert len(page.images) == 4
    for image in page.images:
        content = base64.b64decode(image["src"].partition(",")[2])
        assert content.startswith(b"\x89PNG")
        assert len(image["alt"]) > 40


def test_figures_are_files_too(written: tuple[Path, Page, str]) -> None:
    out, page, _ = written
    names = {path.stem for path in (out / "figures").iterdir()}
    assert {path.name for path in (out / "figures").iterdir()} == {
        f"{n}.{e}" for n in names for e in ("png", "pdf")
    }
    assert len(names) == len(page.images)
    assert (out / "figures" / "time.pdf").read_bytes().startswith(b"%PDF")


def test_missing_experiments_are_named(written: tuple[Path, Page, str]) -> None:
    _, _, text = written
    assert (
        "No records: the run has no experiment &#39;density&#39; on b3r-clean or b3r or standin-full." in text
    )
    assert "u3or: get it there" in text
    assert "the clouds aren&#39;t there &lt;here&gt;" in text


def test_failures_are_listed_with_their_errors(written: tuple[Path, Page, str]) -> None:
    _, _, text = written
    assert "InputError: too &lt;few&gt;" in text
    assert re.search(r"<b>9</b>failed records", text)


def test_every_claim_is_a_row(written: tuple[Path, Page, str]) -> None:
    out, page, text = written
    assert {claim.id for claim in CLAIMS} <= set(page.ids)
    assert text.count("data-verdict=") == 68
    assert (out / "claims.md").read_text(encoding="utf-8").startswith("# Claims of the paper")


def test_experiments_of_ones_own_have_a_section(written: tuple[Path, Page, str]) -> None:
    _, page, text = written
    assert any(heading.startswith("variants: stanford") for heading in page.headings)
    assert "GC+RANSAC" in text


def test_run_and_machine_are_told(written: tuple[Path, Page, str]) -> None:
    _, _, text = written
    for told in ("made-up", "seed 3", "Linux", "Title of stanford", "real (3)"):
        assert told in text


def test_report_of_almost_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    frame = paper_frame("noise").query("level == 0.05").assign(experiments=[("other",)] * 27)
    page, text = write(monkeypatch, tmp_path, results(frame, pd.DataFrame()))
    for experiment in EXPERIMENTS.values():
        assert experiment.title in page.headings
    assert text.count("No records: ") >= 12
    assert "No times: " in text


def test_folder_without_records(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cgroup benchmark run"):
        report.write_report(tmp_path)


def test_ranking_marks_the_best_and_its_ties() -> None:
    sample = Evidence(paper_frame("noise"), pd.DataFrame()).sample("noise", "B3R")
    table = ranking_table(sample)
    assert [row[1].text for row in table.rows[:2]] == ["RANSAC", "ST"]
    assert [row[2].best for row in table.rows[:3]] == [True, True, False]
    assert table.numeric == [True] * 6
    assert table.right == [True, False, *[True] * 4]


def test_scores_in_the_papers_order() -> None:
    samples = Evidence(paper_frame("noise", "overlap"), pd.DataFrame()).samples()
    table = score_table(samples, "pooled")
    assert [row[2].text for row in table.rows[:3]] == ["SS", "NNSR", "SI"]
    assert len(table.rows) == 18
    assert len(table.headers) == len(table.rows[0])


def test_numbers_that_are_missing_sort_last() -> None:
    assert number(float("nan")).text == "-"
    assert number(float("nan")).key < number(-1e9).key
    assert method_cell("3dhv").key < method_cell("gtm").key < method_cell("mine").key


def test_no_failures() -> None:
    assert failure_table(paper_frame("noise"), pd.DataFrame(), pd.DataFrame()).rows == []


def test_one_evidence_serves_claims_and_figures() -> None:
    frame = paper_frame("noise")
    tenth = frame[frame["method"] == "gtm"].assign(method="zz")
    evidence = Evidence(pd.concat([frame, tenth], ignore_index=True), pd.DataFrame())
    claimed, shown = evidence.sample("noise", "B3R"), evidence.sample("noise", "B3R", every_method=True)
    assert claimed is not None
    assert shown is not None
    assert set(shown.rows["method"]) - set(claimed.rows["method"]) == {"zz"}
    assert evidence.samples() == [shown]
    assert [row[1].text for row in ranking_table(shown).rows].count("ZZ") == 1
    alone = Evidence(frame, pd.DataFrame()).sample("noise", "B3R")
    assert alone is not None
    pd.testing.assert_frame_equal(claimed.by_level("f_score"), alone.by_level("f_score"))
