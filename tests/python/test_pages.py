"""Results as tables, figures and pages: what they show is what was found, and none of it breaks out of its place."""

import base64
import gzip
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_lines import run

from cgroup import Correspondences, InputError, group, ss
from cgroup.comparison import compare, find_correct
from cgroup.datasets import standin_pair
from cgroup.evaluation import match_errors
from cgroup.io import write_cloud, write_transform
from cgroup.pages import comparison_page, registration_page, write_page
from cgroup.pages.matches import MAX_MATCHES, draw_pair
from cgroup.pages.page import chart_html, page_html
from cgroup.registration import Registration, correspond, register
from cgroup.rigid import apply
from cgroup.types import PointCloud

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
    assert all("None" not in text for text in texts.values())
    assert "0 of 0 selected" in ss([])._repr_html_()


@pytest.mark.parametrize(("interactive", "module"), [(False, "matplotlib"), (True, "plotly")])
def test_results_can_be_drawn(registered: Registration, interactive: bool, module: str) -> None:
    found, clouds = group(MATCHES, "gc"), (PAIR.source, PAIR.target)
    every = np.ones(len(registered.correspondences), bool)
    for figure in (
        found.plot(interactive=interactive),
        found.plot(*clouds, T_target_source=PAIR.T_target_source, correct=CORRECT, interactive=interactive),
        MATCHES.plot(*clouds, correct=CORRECT, interactive=interactive),
        registered.plot(PAIR.source.points, correct=every, interactive=interactive),
    ):
        assert type(figure).__module__.startswith(module)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"correct": [True]}, "correct: got .*; give an array of"),
        ({"source": np.zeros((0, 3))}, "source: got .*; give a cloud"),
        ({"T_target_source": np.eye(3)}, "T_target_source: got shape"),
        ({"interactive": 1}, "interactive: got 1; give True or False"),
    ],
)
def test_what_cannot_be_drawn_is_refused(arguments: dict[str, Any], message: str) -> None:
    for result in (MATCHES, group(MATCHES, "gc")):
        with pytest.raises(InputError, match=message):
            result.plot(**arguments)


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
    assert '<option value="distance" selected>' in page
    gray = np.full((len(PAIR.source), 3), 99, np.uint8)
    painted = PointCloud(PAIR.source.points, colors=gray)
    assert '<option value="own" selected>' in registration_page(painted, PAIR.target, registered)
    (copied,) = re.findall('data-copy="(.*?)"', page, re.DOTALL)
    assert np.array_equal(np.fromstring(copied, sep=" ").reshape(4, 4), registered.T_target_source)


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


@pytest.fixture
def files(elsewhere: Path) -> Path:
    """Write the pair, another target, and the truth, into the folder that commands run in."""
    write_cloud("a&b.ply", PAIR.source)
    write_cloud("target.ply", PAIR.target)
    write_cloud("other.ply", standin_pair(seed=5, pixels=70).target)
    write_transform("truth.txt", PAIR.T_target_source)
    return elsewhere


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
    ended, out, err = run(capsys, *arguments, "--html")
    assert ended == status
    assert name in (err if status else out)
    page = (files / "out" / name).read_text(encoding="utf-8")
    assert "<title>a&amp;b.ply" in page
    assert ("Refused" in page) == (status == 3)
    assert len(page) < 5_000_000


def test_a_chart_keeps_its_texts_and_cannot_end_its_script() -> None:
    chart = chart_html("a", {"data": [{"y": [1, 2], "name": NASTY}], "layout": {}}, label=NASTY)
    assert chart.count("</script>") == 1
    assert not set("<&\u2028\u2029") & set(chart.partition('application/json">')[2].partition("</script>")[0])
    (text,) = re.findall(r'<script type="application/json">(.*?)</script>', chart, re.DOTALL)
    assert json.loads(text)["data"][0]["name"] == NASTY
    assert "<img" not in chart


def test_a_page_fetches_nothing_and_holds_plotly_once() -> None:
    chart = chart_html("a", {"data": [{"y": [1]}], "layout": {}}, label="A")
    page = page_html("A", chart + chart.replace('id="a"', 'id="b"'))
    (packed,) = re.findall(r'id="chart-library">(.*?)</script>', page)
    assert b"plotly.js" in gzip.decompress(base64.b64decode(packed))[:200]
    assert len(page) < 2_100_000
    assert "default-src 'none'" in page
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", page)
