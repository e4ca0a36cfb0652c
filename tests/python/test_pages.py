"""Results as tables, figures and pages: what they show is what was found, and none of it breaks out of its place."""

import base64
import gzip
import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cgroup import Correspondences, InputError, NoConsensusError, group, ss
from cgroup.cli import main
from cgroup.comparison import compare, find_correct
from cgroup.datasets import standin_pair
from cgroup.evaluation import match_errors
from cgroup.io import write_cloud, write_transform
from cgroup.pages import comparison_page, registration_page, write_page
from cgroup.pages.matches import MAX_MATCHES, MAX_POINTS, draw_pair, line_vertices
from cgroup.pages.page import chart_html, chart_text, page_html
from cgroup.registration import Registration, correspond, register
from cgroup.rigid import apply

plotly = pytest.importorskip("plotly", reason="needs the extra cgroup[scans]")

PAIR = standin_pair(pixels=70)
MATCHES = correspond(PAIR.source, PAIR.target)
CORRECT = find_correct(MATCHES, PAIR.T_target_source)
NASTY = "</script><!--<img src=x onerror=alert(1)>&amp;\"'\u2028\u2029$title %{x}"


@pytest.fixture(scope="module")
def registered() -> Registration:
    """Return one registration for all tests."""
    return register(PAIR.source, PAIR.target)


def data_of(page: str) -> dict[str, Any]:
    """Return what the page's script is given."""
    (text,) = re.findall(r'<script type="application/json" id="stage-data">(.*?)</script>', page)
    return json.loads(text)


def test_tables_for_notebooks_say_what_there_is(registered: Registration) -> None:
    found = group(MATCHES, "lc")
    texts = {name: each._repr_html_() for name, each in (("g", found), ("m", MATCHES), ("r", registered))}
    assert f"{found.size} of {len(MATCHES)} selected" in texts["g"]
    assert f"{len(MATCHES)} matches" in texts["m"]
    assert f"{registered.probability:.3f}" in texts["r"]
    for text in texts.values():
        assert text.count("<div") == text.count("</div>")
        assert "None" not in text
    assert "cut" in group(MATCHES, "gtm")._repr_html_()
    assert "cut" in ss([0.1, 0.9])._repr_html_()
    assert "0 of 0 selected" in ss([])._repr_html_()


@pytest.mark.parametrize("interactive", [False, True])
def test_results_can_be_drawn(registered: Registration, *, interactive: bool) -> None:
    found = group(MATCHES, "gc")
    clouds = (PAIR.source, PAIR.target)
    every = np.ones(len(registered.correspondences), bool)
    figures = [
        found.plot(interactive=interactive),
        found.plot(*clouds, T_target_source=PAIR.T_target_source, correct=CORRECT, interactive=interactive),
        MATCHES.plot(*clouds, correct=CORRECT, interactive=interactive),
        registered.plot(*clouds, interactive=interactive),
        registered.plot(PAIR.source.points, correct=every, interactive=interactive),
    ]
    module = "plotly" if interactive else "matplotlib"
    assert {type(figure).__module__.partition(".")[0] for figure in figures} == {module}


def test_few_points_are_drawn_as_dots() -> None:
    assert len(MATCHES.plot().axes[0].images) == 0
    assert len(MATCHES.plot(PAIR.source, PAIR.target).axes[0].images) == 2


def test_an_interactive_figure_tells_why(registered: Registration) -> None:
    found = group(MATCHES, "gc")
    figure = found.plot(PAIR.source, PAIR.target, correct=CORRECT, interactive=True)
    names = {trace.name: trace for trace in figure.data}
    count = int(np.count_nonzero(found.mask & CORRECT))
    kept = names[f"selected, correct ({count})"]
    assert len(kept.x) == 6 * count == len(kept.hovertext)
    row = int(np.flatnonzero(found.mask & CORRECT)[0])
    assert kept.hovertext[0].replace("<br>", " ") == f"match {row}: {found.explain(row).reason}"
    assert registered.plot(interactive=True).layout.title.text.startswith("right with a probability")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"correct": [True]}, "correct: got .*; give an array of"),
        ({"correct": np.ones(len(MATCHES))}, "correct: got"),
        ({"source": np.zeros((0, 3))}, "source: got .*; give a cloud"),
        ({"source": "a"}, "source: "),
        ({"T_target_source": np.eye(3)}, "T_target_source: got shape"),
        ({"interactive": 1}, "interactive: got 1; give True or False"),
    ],
)
def test_what_cannot_be_drawn_is_refused(arguments: dict[str, Any], message: str) -> None:
    for result in (MATCHES, group(MATCHES, "gc")):
        with pytest.raises(InputError, match=message):
            result.plot(**arguments)


def test_a_group_without_points_cannot_be_drawn() -> None:
    with pytest.raises(InputError, match="plot: this group was made without points"):
        ss([0.1, 0.9]).plot()


def test_clouds_are_drawn_joined_by_the_pose_and_apart() -> None:
    shift = np.array([1e6, -2e6, 3e5])  # as geographic coordinates have it
    pose = PAIR.T_target_source.copy()
    pose[:3, 3] += shift
    target = PAIR.target.points + shift
    pair = draw_pair(PAIR.source.points, target, pose)
    assert np.allclose(pair.axes @ pair.axes.T, np.eye(3))
    source, fixed = pair.clouds
    between = source.points[0] + source.joined - fixed.points[0] - fixed.joined
    expected = apply(PAIR.T_target_source, PAIR.source.points[:1])[0] - PAIR.target.points[0]
    assert np.allclose(between, pair.axes @ expected, atol=1e-6)
    for cloud in pair.clouds:
        assert np.abs(cloud.points).max() < 1e3
    apart = np.abs(source.apart - fixed.apart)[:2]
    assert (apart > (source.size + fixed.size)[:2] / 2).any()
    start, end = pair.ends_of(Correspondences(PAIR.source.points[:3], target[:3]), np.array([1]))
    assert np.allclose(start, source.points[1], atol=1e-6)
    assert np.allclose(end, fixed.points[1], atol=1e-6)


def test_large_clouds_are_thinned() -> None:
    many = np.random.default_rng(0).uniform(size=(MAX_POINTS + 5, 3))
    pair = draw_pair(many, many[:10], np.eye(4))
    assert len(pair.clouds[0].points) == len(pair.clouds[0].light) == MAX_POINTS
    assert len(pair.clouds[1].points) == len(pair.rows[1]) == 10


def test_lines_have_vertices_on_the_way_and_gaps() -> None:
    vertices = line_vertices(np.zeros((2, 3)), np.array([[4.0, 0, 0], [0, 8.0, 0]]))
    assert vertices[:5, 0].tolist() == [0, 1, 2, 3, 4]
    assert np.isnan(vertices[[5, 11]]).all()
    assert vertices[10].tolist() == [0, 8, 0]


def test_the_page_of_a_registration(registered: Registration, tmp_path: Path) -> None:
    page = registration_page(PAIR.source, PAIR.target, registered, title=NASTY, truth=PAIR.T_target_source)
    assert "<img" not in page
    assert "<h1>&lt;/script&gt;&lt;!--&lt;img src=x" in page
    data = data_of(page)
    rows = data["matches"]["index"]
    mask = registered.grouping.mask
    assert data["count"] == len(mask)
    assert len(rows) == min(MAX_MATCHES, len(mask))
    (method,) = data["methods"]
    assert method["counts"] == [int(mask.sum()), int((~mask).sum())]
    assert method["kind"] == [0 if mask[row] else 1 for row in rows]
    assert method["why"][0] == registered.grouping.explain(rows[0]).reason
    matches = registered.correspondences
    error = match_errors(matches.source[rows], matches.target[rows], PAIR.T_target_source)
    assert np.allclose(data["matches"]["error"], error / registered.resolution, rtol=1e-3, atol=1e-6)
    write_page(tmp_path / "page.html", page)
    assert (tmp_path / "page.html").stat().st_size < 5_000_000
    assert "Refused" not in page


def levels_of(page: str) -> np.ndarray:
    """Return the distances of all points to the other cloud as bytes, of which 255 stands for none."""
    packed = data_of(page)["colors"]["distance"]
    return np.frombuffer(b"".join(base64.b64decode(each) for each in packed), np.uint8)


def test_a_page_holds_how_far_each_point_is_from_the_other_cloud(registered: Registration) -> None:
    away = registered.T_target_source.copy()
    away[:3, 3] += 1e3
    right, wrong = (
        levels_of(registration_page(PAIR.source, PAIR.target, replace(registered, T_target_source=pose)))
        for pose in (registered.T_target_source, away)
    )
    assert len(right) == len(PAIR.source) + len(PAIR.target)
    share = (right[: len(PAIR.source)] < 255).mean()
    assert share == pytest.approx(registered.fitness, abs=0.1)
    near = right[right < 255] / 254 * registered.resolution
    assert np.sqrt((near**2).mean()) == pytest.approx(registered.inlier_rmse, rel=0.5)
    assert (wrong == 255).all()


def test_a_page_holds_the_colours_of_scans_that_have_them(registered: Registration) -> None:
    page = registration_page(PAIR.source, PAIR.target, registered)
    assert data_of(page)["colors"]["own"] == [None, None]
    assert "as scanned" not in page
    colors = np.random.default_rng(0).integers(256, size=(len(PAIR.target), 3), dtype=np.uint8)
    page = registration_page(PAIR.source, replace(PAIR.target, colors=colors), registered)
    none, packed = data_of(page)["colors"]["own"]
    assert none is None
    assert base64.b64decode(packed) == colors.tobytes()
    assert "as scanned" in page


def test_the_page_of_a_comparison() -> None:
    results = list(compare(MATCHES, PAIR.T_target_source, methods=["ss", "gc", "lc"]))
    page = comparison_page(
        PAIR.source, PAIR.target, MATCHES, results, PAIR.T_target_source, correct=CORRECT, title=NASTY
    )
    data = data_of(page)
    assert [kind["id"] for kind in data["kinds"]] == ["correct", "wrong", "missed", "dropped"]
    for result, method in zip(results, data["methods"], strict=True):
        mask = result.grouping.mask
        kinds = [mask & CORRECT, mask & ~CORRECT, ~mask & CORRECT, ~mask & ~CORRECT]
        assert method["counts"] == [int(kind.sum()) for kind in kinds]
        assert all(
            kinds[kind][row] for kind, row in zip(method["kind"], data["matches"]["index"], strict=True)
        )
        assert method["agreeing"][0] == result.grouping.explain(data["matches"]["index"][0]).agreeing
        assert f"<td>{result.score.f_score:.2f}</td>" in page
    best = int(np.argmax([result.score.f_score for result in results]))
    assert re.findall(r'value="(\d)" checked', page) == [str(best)]
    assert page.count("<img") == 0


def test_of_many_matches_a_page_holds_those_that_were_kept_and_others() -> None:
    rng = np.random.default_rng(0)
    source = rng.uniform(0, 100, size=(3_000, 3))
    target = source + 5.0
    target[200:] = rng.uniform(0, 100, size=(2_800, 3))
    matches = Correspondences(source, target, resolution=1.0)
    pose = np.eye(4)
    pose[:3, 3] = 5.0
    page = comparison_page(source, target, matches, compare(matches, pose, methods=["ransac"]), pose)
    shown = data_of(page)["matches"]["index"]
    assert len(shown) == MAX_MATCHES
    assert set(range(200)) <= set(shown)
    assert "800 of 3,000 matches" in page


@pytest.mark.parametrize("results", [[], [1], 3])
def test_a_comparison_of_nothing_is_refused(results: Any) -> None:
    with pytest.raises(InputError, match="results: "):
        comparison_page(PAIR.source, PAIR.target, MATCHES, results, PAIR.T_target_source)


def test_the_guess_of_an_error_makes_a_page() -> None:
    other = standin_pair(seed=5, pixels=70)
    with pytest.raises(NoConsensusError) as error:
        register(PAIR.source, other.target)
    page = registration_page(PAIR.source, other.target, error.value.registration, refusal="no pose that <b>")
    assert "Refused" in page
    assert "No pose that &lt;b&gt;." in page


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write the pair, another target, and the truth, into the folder that commands run in."""
    monkeypatch.chdir(tmp_path)
    write_cloud(tmp_path / "a&b.ply", PAIR.source)
    write_cloud(tmp_path / "target.ply", PAIR.target)
    write_cloud(tmp_path / "other.ply", standin_pair(seed=5, pixels=70).target)
    write_transform(tmp_path / "truth.txt", PAIR.T_target_source)
    return tmp_path


def run(*arguments: str) -> int:
    """Run a command; return its exit status."""
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    return ended.value.code


@pytest.mark.parametrize(
    ("arguments", "name", "status"),
    [
        (("register", "a&b.ply", "target.ply"), "a&b_on_target.html", 0),
        (("compare", "a&b.ply", "target.ply", "--truth", "truth.txt"), "a&b_on_target_comparison.html", 0),
        (("register", "a&b.ply", "other.ply"), "a&b_on_other.html", 3),
    ],
)
def test_html_writes_a_page(
    files: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], name: str, status: int
) -> None:
    assert run(*arguments, "--html") == status
    printed = capsys.readouterr()
    assert name in (printed.err if status else printed.out)
    page = (files / "out" / name).read_text(encoding="utf-8")
    assert "<title>a&amp;b.ply" in page
    assert ("Refused" in page) == (status == 3)
    assert len(page) < 5_000_000


def test_without_html_there_is_no_page(files: Path) -> None:
    assert run("register", "a&b.ply", "target.ply") == 0
    assert not list(files.rglob("*.html"))
    assert run("register", "a&b.ply", "other.ply", "--out", "nothing") == 3
    assert not (files / "nothing").exists()


def test_without_plotly_html_is_refused_before_any_work(
    files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cgroup.cli.options.find_spec", lambda _name: None)
    assert run("register", "a&b.ply", "target.ply", "--html") == 2
    assert "--html: needs plotly; pip install 'cgroup[scans]'" in capsys.readouterr().err
    assert not (files / "out").exists()


# --- what pages are made of --------------------------------------------------------------


def content_of(chart: str) -> dict[str, object]:
    (text,) = re.findall(r'<script type="application/json">(.*?)</script>', chart, re.DOTALL)
    return json.loads(text)


def test_a_chart_keeps_its_texts_and_cannot_end_its_script() -> None:
    chart = chart_html("a", {"data": [{"y": [1, 2], "name": NASTY}], "layout": {}}, label=NASTY)
    assert chart.count("</script>") == 1
    assert not set("<&\u2028\u2029") & set(chart.partition('application/json">')[2].partition("</script>")[0])
    assert content_of(chart)["data"][0]["name"] == NASTY
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
