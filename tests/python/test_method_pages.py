"""Every method has a page with its options and measurements."""

import re
import sys
from pathlib import Path

import pytest

from cgroup.registry import METHOD_INFO

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "docs" / "figures"), str(ROOT / "docs")]

pytest.importorskip("matplotlib", reason="figures of the pages are drawn by matplotlib")

pd = pytest.importorskip("pandas", reason="measurements are read by pandas")


from method_figures import ideas, tables  # noqa: E402
from method_figures.measured import FOLDER, load_methods, load_origin  # noqa: E402
from method_figures.sweeps import SWEEPS  # noqa: E402

PAGES = ROOT / "docs" / "methods"
FUNCTIONS = {info.function.__name__: info.function for info in METHOD_INFO.values()}


@pytest.mark.parametrize("page", tables.PAGES, ids=lambda page: page.stem)
def test_tables_are_those_of_the_measured_figures(page: Path):
    text = page.read_text(encoding="utf-8")
    assert tables.fill(text) == text, "run: python docs/figures/choose.py write"


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.csv")), ids=lambda path: path.stem)
def test_a_file_of_measurements_says_where_it_comes_from(path: Path):
    origin = load_origin(path)
    assert re.fullmatch(r"[0-9a-f]{7,}", origin.commit)
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", origin.date)
    assert all((ROOT / code).exists() for code in origin.code.split())


def test_every_method_is_measured_at_every_size_and_share():
    sized = tables.sized()
    for name in METHOD_INFO:
        kinds = set(sized[sized["method"] == name][["n", "inliers"]].itertuples(index=False, name=None))
        wanted = {(n, share) for n in tables.SIZES for share in tables.SHARES if round(n * share) >= 4}
        assert kinds == wanted
    assert load_methods()[["precision", "recall", "f_score"]].stack().between(0, 1).all()


def test_every_method_has_a_page_an_idea_and_sweeps():
    assert all((PAGES / f"{name}.md").is_file() for name in FUNCTIONS)
    assert set(ideas.IDEAS) == set(FUNCTIONS) == {sweep.method for sweep in SWEEPS}
