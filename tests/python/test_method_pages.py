"""Every method has its page with all of its options, and the pages tell what was measured."""

import inspect
import json
import re
import sys
from pathlib import Path

import pytest

from cgroup.registry import METHOD_INFO, MethodOption, find_method

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs" / "figures"))

pytest.importorskip("matplotlib", reason="figures of the pages are drawn by matplotlib")

import methods as figures  # noqa: E402 - the script of the figures

from method_figures import chooser, ideas, tables  # noqa: E402
from method_figures.measure_options import measure_value  # noqa: E402
from method_figures.measured import load_methods, load_options  # noqa: E402
from method_figures.sweeps import SWEEPS, VIEWS  # noqa: E402

PAGES = ROOT / "docs" / "methods"
HEADINGS = (
    "The idea",
    "Equations",
    "Use",
    "Options and what each changes",
    "Cost",
    "When it fails",
    "Reference",
)
FUNCTIONS = {info.function.__name__: info.function for info in METHOD_INFO.values()}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_page_has_all_parts_in_order(name: str):
    text = (PAGES / f"{name}.md").read_text(encoding="utf-8")
    found = re.findall(r"^## (.+)$", text, flags=re.MULTILINE)
    assert tuple(found) == HEADINGS
    assert re.findall(r"_generated/methods/([a-z0-9-]+)\.png", text) == [
        f"{name}-{kind}" for kind in ("idea", "options", "cost", "limits")
    ]
    assert f"{{py:func}}`cgroup.{name}`" in text
    assert "$$" in text
    assert "```python\n" in text


@pytest.mark.parametrize("name", FUNCTIONS)
def test_table_has_every_option_with_its_default(name: str):
    text = (PAGES / f"{name}.md").read_text(encoding="utf-8")
    fields, options = text.split(f"<!-- made: options {name} -->", maxsplit=1)
    given = re.findall(r"`(\w+)`", " ".join(re.findall(r"^\| (`.+?) \| \S+ \|", fields, flags=re.MULTILINE)))
    listed = dict(re.findall(r"^\| `(\w+)` \| (.+?) \| .+ \|$", options, flags=re.MULTILINE))
    parameters = inspect.signature(FUNCTIONS[name]).parameters
    assert sorted([*given, *listed]) == sorted(parameters)
    for option, described in find_method(name).options.items():
        assert _says(listed[option], described), (option, listed[option])


def _says(shown: str, option: MethodOption) -> bool:
    """Whether the text in a table is the default of an option, None being worded."""
    if option.default is None:
        return bool(re.fullmatch(r"none|all|.* pr|.*`.*", shown))
    if isinstance(option.default, bool | str):
        return (
            shown == f"`{json.dumps(option.default) if isinstance(option.default, str) else option.default}`"
        )
    return float(shown.replace(",", "")) == option.default


def test_all_methods_are_listed_once():
    index = (PAGES / "index.md").read_text(encoding="utf-8")
    toctree = " ".join(re.findall(r"```\{toctree\}\n(.*?)```", index, flags=re.DOTALL))
    for name in FUNCTIONS:
        assert f"]({name}.md)" in index
        assert re.search(rf"\b{name}\b", toctree)
    assert set(ideas.IDEAS) == set(FUNCTIONS) == {s.method for s in SWEEPS}


@pytest.mark.parametrize("page", sorted(PAGES.glob("*.md")), ids=lambda page: page.stem)
def test_tables_are_those_of_the_measured_figures_and_docstrings(page: Path):
    text = page.read_text(encoding="utf-8")
    assert tables.fill(text) == text, "run: python docs/figures/choose.py write"


def test_every_method_is_measured_at_every_size_and_share():
    sized = tables.sized()
    for name in METHOD_INFO:
        kinds = set(sized[sized["method"] == name][["n", "inliers"]].itertuples(index=False, name=None))
        wanted = {(n, share) for n in tables.SIZES for share in tables.SHARES if round(n * share) >= 4}
        assert kinds == wanted
    assert load_methods()[["precision", "recall", "f_score"]].stack().between(0, 1).all()


@pytest.mark.parametrize("name", FUNCTIONS)
def test_measured_figures_are_those_of_today(name: str):
    sweep = next(sweep for sweep in SWEEPS if sweep.method == name)
    data = next(kind for kind in sweep.data if kind != VIEWS)
    value = sweep.levels[-1]
    table = load_options()
    chosen = table[
        (table["method"] == name)
        & (table["option"] == sweep.option)
        & (table["value"] == str(value))
        & (table["data"] == data)
    ]
    measured = chosen[["precision", "recall", "f_score"]].to_numpy(dtype=float)[0]
    today = [float(text) for text in measure_value(sweep, value, data)[:3]]
    assert today == pytest.approx(measured, abs=1e-4), "run: python docs/figures/choose.py measure"


@pytest.mark.parametrize("sweep", SWEEPS, ids=lambda sweep: f"{sweep.method}-{sweep.option}")
def test_sweeps_mark_the_default_of_the_signature(sweep):
    if sweep.fields:
        return
    default = inspect.signature(FUNCTIONS[sweep.method]).parameters[sweep.option].default
    assert sweep.default == default or (default is None and sweep.unit == "pr")


def test_chooser_holds_the_measured_figures_and_needs_nothing_else():
    page = chooser.render_chooser()
    data = json.loads(re.search(r"const data = (\{.*\});", page)[1].replace("<\\/", "</"))
    assert [method["name"] for method in data["methods"]] == list(METHOD_INFO)
    row = next(
        row for row in data["rows"] if row["method"] == "lc" and (row["n"], row["share"]) == (1000, 0.01)
    )
    found = tables.sized(1000, 0.01).set_index("method").loc["lc"]
    assert row["f"] == pytest.approx(found["f_score"], abs=1e-3)
    assert not re.search(r"https?://|src=|@import", page)
    for method in data["methods"]:
        assert (PAGES / method["page"]).with_suffix(".md").is_file()


def test_figures_are_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(figures, "IDEAS", {"gc": ideas.IDEAS["gc"]})
    figures.make_figures(tmp_path)
    made = figures.files(tmp_path)
    assert [path.name for path in made[:-1]] == [f"gc-{kind}.png" for kind in figures.KINDS]
    assert all(path.stat().st_size > 1000 for path in made)
    times = [path.stat().st_mtime_ns for path in made]
    figures.make_figures(tmp_path)
    assert [path.stat().st_mtime_ns for path in made] == times
    made[0].unlink()
    figures.make_figures(tmp_path)
    assert made[0].is_file()


@pytest.mark.parametrize("name", sorted(set(ideas.IDEAS) - {"ss", "nnsr"}))  # those take seconds
def test_ideas_can_be_drawn(name: str):
    assert ideas.IDEAS[name]().axes
