"""Each kind of page works in a browser: nothing fails, controls act, and narrow and wide windows hold it."""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmark_frames import paper_frame, paper_timing
from placed_scenes import known_scene
from test_report import results, write

from cgroup.cli.targets import PAGE, fit_files, report_files
from cgroup.comparison import compare
from cgroup.datasets import standin_pair
from cgroup.io.files import number_lines
from cgroup.pages import (
    comparison_page,
    location_page,
    recognition_page,
    registration_page,
    scene_page,
    write_page,
)
from cgroup.registration import assess, correspond, register
from cgroup.scenes import prepare_map

CHROMIUM = Path("/usr/bin/chromium")
WIDTHS = (390, 1400)
WITHOUT_SCENE = ("report", "targets")

pytest.importorskip("plotly", reason="needs the extra cgroup[scans]")
playwright = pytest.importorskip("playwright.sync_api", reason="needs Playwright, of the extra cgroup[test]")
pytestmark = pytest.mark.skipif(not CHROMIUM.exists(), reason="needs Chromium: apt-get install chromium")

PAIR = standin_pair(pixels=40)
CLOUDS = PAIR.source, PAIR.target
Page = Any
Open = Callable[[str], Page]
PATIENCE = 120_000  # milliseconds that a page may take to react, drawn without a graphics card

SHARED_ROOM = """() => {
  const shown = [...document.querySelectorAll("button, input, select, summary")].filter((each) => each.checkVisibility());
  const boxes = shown.map((each) => each.getBoundingClientRect()).filter((box) => box.width && box.height);
  const clashes = [];
  boxes.forEach((one, k) => boxes.slice(k + 1).forEach((other, j) => {
    const wide = Math.min(one.right, other.right) - Math.max(one.left, other.left);
    const high = Math.min(one.bottom, other.bottom) - Math.max(one.top, other.top);
    if (wide > 1 && high > 1) clashes.push([shown[k].outerHTML, shown[k + 1 + j].outerHTML]);
  }));
  return clashes;
}"""
CHART = "document.querySelector('#scene .chart-area')"


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Write a page of each kind."""
    folder = tmp_path_factory.mktemp("pages")
    found = register(*CLOUDS)
    matches = correspond(*CLOUDS)
    away = PAIR.T_target_source.copy()
    away[:3, 3] += 30.0
    rival = replace(found, T_target_source=away)
    place = prepare_map(PAIR.target)
    texts = {
        "registration": registration_page(*CLOUDS, found),
        "assess": registration_page(*CLOUDS, assess(*CLOUDS, away), refusal="the pose is unreliable"),
        "comparison": comparison_page(
            *CLOUDS,
            matches,
            compare(matches, PAIR.T_target_source, methods=["gc", "lc"]),
            PAIR.T_target_source,
        ),
        "scene": scene_page(known_scene()),
        "locate": location_page(PAIR.source, place, [found, rival], refusal="2 places look the same"),
        "recognize": recognition_page(
            {"a very long name of a stone": PAIR.source},
            PAIR.target,
            2 * [("a very long name of a stone", found)],
        ),
    }
    for name, text in texts.items():
        write_page(folder / f"{name}.html", text)
    files = folder / "scan.csv", folder / "site.csv"
    for file, away in zip(files, (0, 5_400_000), strict=True):
        np.savetxt(file, np.c_[np.arange(9), PAIR.source.points[::99][:9] + away], "%s", ";")
    report = report_files(fit_files(files, None)[1], "scan_on_site", html=True)
    (folder / "targets.html").write_bytes(report[PAGE])
    with pytest.MonkeyPatch.context() as patch:
        write(patch, folder, results(paper_frame("noise"), paper_timing()))
    return {name: folder / f"{name}.html" for name in (*texts, *WITHOUT_SCENE)}


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        chromium = started.chromium.launch(executable_path=str(CHROMIUM), args=arguments)
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def loaded(browser: Any, pages: dict[str, Path]) -> Iterator[Callable[[str], tuple[Page, list[str]]]]:
    """Load each page once, which takes most of the time; return it with the errors in its console."""
    context = browser.new_context(viewport={"width": WIDTHS[1], "height": 360})
    context.set_default_timeout(PATIENCE)
    context.grant_permissions(["clipboard-read", "clipboard-write"])
    seen: dict[str, tuple[Page, list[str]]] = {}

    def load(name: str) -> tuple[Page, list[str]]:
        if name not in seen:
            page, errors = seen[name] = context.new_page(), []
            page.on("console", lambda message: message.type == "error" and errors.append(message.text))
            page.on("pageerror", lambda error: errors.append(str(error)))
            page.goto(pages[name].as_uri())
            wait_until_ready(name, page)
        return seen[name]

    yield load
    context.close()


def wait_until_ready(name: str, page: Page) -> None:
    if name not in WITHOUT_SCENE:
        page.wait_for_selector("body[data-ready=yes]")


@pytest.fixture
def open_page(loaded: Callable[[str], tuple[Page, list[str]]]) -> Iterator[Open]:
    """Bring a page to the front; fail at the end for each error in its console."""
    opened: list[tuple[Page, list[str]]] = []

    def open_it(name: str) -> Page:
        opened.append(loaded(name))
        opened[-1][0].bring_to_front()
        return opened[-1][0]

    yield open_it
    assert [error for _, errors in opened for error in errors] == []


@pytest.fixture
def open_anew(open_page: Open) -> Open:
    """Open a page as it is at first, whatever other tests have done to it."""

    def open_it(name: str) -> Page:
        page = open_page(name)
        page.reload()
        wait_until_ready(name, page)
        return page

    return open_it


KINDS = ("registration", "assess", "comparison", "scene", "locate", "recognize", *WITHOUT_SCENE)


def slide_to(page: Page, share: int) -> None:
    page.evaluate(
        f"(() => {{ const each = document.getElementById('place'); each.value = {share};"
        " each.dispatchEvent(new Event('input')); })()"
    )


def trace(page: Page, number: int, path: str) -> Any:
    return page.evaluate(f"{CHART}.data[{number}].{path}")


def test_a_registration_opens_joined_by_distance_without_lines(open_anew: Open) -> None:
    page = open_anew("registration")
    assert page.input_value("#place") == "100"
    assert page.input_value("#colors") == "distance"
    assert page.is_visible("#legend")
    assert [trace(page, k, "x.length") for k in (2, 3)] == [0, 0]
    page.check("#show-group")
    page.wait_for_function(f"{CHART}.data[2].x.length > 0")
    joined = trace(page, 0, "x[0]") - trace(page, 1, "x[0]")
    slide_to(page, 0)
    page.wait_for_function(f"Math.abs({CHART}.data[0].x[0] - {CHART}.data[1].x[0] - ({joined})) > 10")
    page.click("[data-copy]")
    page.wait_for_function("document.querySelector('[data-copy]').textContent === 'Copied'")
    copied = page.evaluate("navigator.clipboard.readText()")
    assert copied.split("\n") == number_lines(register(*CLOUDS).T_target_source)


def test_a_comparison_shows_the_group_of_the_chosen_method(open_anew: Open) -> None:
    page = open_anew("comparison")
    counts = set()
    for method in page.locator("input[name=method]").all():
        method.click()
        counts.add(page.inner_text("#count-correct"))
    assert len(counts) == 2
    page.fill("#number", "0")
    page.press("#number", "Enter")
    assert re.match(r"Match 0: ", page.inner_text("#about"))
    assert page.input_value("#place") == "0"


def test_an_edge_shows_its_two_scans(open_anew: Open) -> None:
    page = open_anew("scene")
    page.locator("tr[data-edge]").first.click()
    page.wait_for_function(f"{CHART}.data.filter((each) => each.visible !== false).length === 2")
    page.click("#play")
    page.wait_for_function("document.getElementById('play').textContent === 'Join'")
    page.click("#all")
    page.wait_for_function(f"{CHART}.data.filter((each) => each.visible !== false).length === 4")


@pytest.mark.parametrize("kind", ["locate", "recognize"])
def test_placed_clouds_are_hidden_and_seen_near_and_from_a_side(open_anew: Open, kind: str) -> None:
    page = open_anew(kind)
    page.uncheck("[data-cloud='2']")
    page.wait_for_function(f"{CHART}.data[2].visible === false")
    whole, rows = page.evaluate(f"{CHART}.layout.scene.xaxis.range"), page.locator(".placed .bar")
    assert rows.count() == 3
    page.click("[data-near='1']")
    page.wait_for_function(f"{CHART}.layout.scene.xaxis.range[0] !== {whole[0]}")
    page.click("text=In 3D")
    page.wait_for_function(f"{CHART}.layout.scene.camera.eye.y < -1")
    page.click("#reset")
    page.wait_for_function(f"{CHART}.layout.scene.xaxis.range[0] === {whole[0]}")
    assert page.evaluate(f"{CHART}.layout.scene.camera.eye.z") == pytest.approx(1.6)
    assert "middle at (" in page.inner_text(".placed")


@pytest.mark.parametrize("kind", KINDS)
def test_each_control_acts_without_an_error(open_page: Open, kind: str) -> None:
    page = open_page(kind)
    assert page.locator(":disabled").count() == 0
    for box in page.locator("input[type=checkbox]:visible").all()[:4]:
        before = box.is_checked()
        box.click()
        assert box.is_checked() != before
    for choice in page.locator("select:visible").all()[:3]:
        choice.select_option(index=choice.locator("option").count() - 1)
    for button in page.locator("button:visible:not(#play)").all()[:8]:
        button.click()


@pytest.mark.parametrize("kind", KINDS)
def test_a_page_fits_narrow_and_wide_windows(open_page: Open, kind: str) -> None:
    page = open_page(kind)
    page.wait_for_function("!document.querySelector('.notifier-note')")  # of an image, by another test
    page.evaluate("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
    for width in (*WIDTHS, WIDTHS[0])[1:]:
        page.set_viewport_size({"width": width, "height": 360})
        page.wait_for_function(f"document.documentElement.scrollWidth <= {width}")  # charts are drawn again
        assert page.evaluate(SHARED_ROOM) == []
