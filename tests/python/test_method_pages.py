"""Every method has a page with its options and measurements."""

import inspect
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from cgroup.registry import METHOD_INFO, MethodOption, find_method

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "docs" / "figures"), str(ROOT / "docs")]

pytest.importorskip("matplotlib", reason="figures of the pages are drawn by matplotlib")

pd = pytest.importorskip("pandas", reason="measurements are read by pandas")

import choose  # noqa: E402 - the script of the measurements
import methods as figures  # noqa: E402 - the script of the figures
from _site import tables as site_tables  # noqa: E402

from method_figures import chooser, ideas, measure_options, measured, tables  # noqa: E402
from method_figures.measured import FOLDER, load_methods, load_options, load_origin  # noqa: E402
from method_figures.sweeps import SWEEPS  # noqa: E402
from peers.records import Journal, Run  # noqa: E402 - found by `choose`

PAGES = ROOT / "docs" / "methods"
HEADINGS = ("Idea", "Equations", "Example", "Options", "Cost", "Limits", "Reference")
INCLUDED = tables.included()
FUNCTIONS = {info.function.__name__: info.function for info in METHOD_INFO.values()}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_page_has_all_parts_in_order(name: str):
    text = (PAGES / f"{name}.md").read_text(encoding="utf-8")
    found = re.findall(r"^## (.+)$", text, flags=re.MULTILINE)
    assert tuple(found) == HEADINGS
    assert f"_generated/methods/{name}-idea.png" in text
    wanted = [f"{name}-{kind}" for kind in ("options", "cost", "limits")]
    assert [include for include in includes(text) if include in wanted] == wanted
    assert f"{{py:func}}`cgroup.{name}`" in text
    assert "$$" in text
    assert "```python\n" in text


def includes(text: str) -> list[str]:
    """Return the names of the tables that a page includes."""
    return re.findall(r"^```\{include\} \S*_generated/tables/(\S+)\.md$", text, flags=re.MULTILINE)


def test_pages_include_tables_that_exist():
    used = {name for page in tables.PAGES for name in includes(page.read_text(encoding="utf-8"))}
    assert used <= set(INCLUDED)
    figures_of = re.findall(r"_generated/methods/(\S+)\.png", "".join(INCLUDED[name] for name in used))
    assert set(figures_of) == {f"{name}-{kind}" for name in FUNCTIONS for kind in figures.KINDS[1:]}


def test_included_tables_are_written_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sys, "path", [*sys.path])
    site_tables.write(tmp_path)
    written = {page.stem: page for page in (tmp_path / "_generated/tables").iterdir()}
    assert {name: page.read_text(encoding="utf-8") for name, page in written.items()} == {
        name: f"{table}\n" for name, table in INCLUDED.items()
    }
    written["gc-cost"].write_text("old", encoding="utf-8")
    times = {name: page.stat().st_mtime_ns for name, page in written.items()}
    site_tables.write(tmp_path)
    assert written["gc-cost"].read_text(encoding="utf-8") == f"{INCLUDED['gc-cost']}\n"
    assert [name for name, page in written.items() if page.stat().st_mtime_ns != times[name]] == ["gc-cost"]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_table_has_every_option_with_its_default(name: str):
    fields, options = INCLUDED[f"{name}-options"].split("| option |")
    given = re.findall(r"^\| `(\w+)` \| .*array_like|^\| `(resolution)` \|", fields, flags=re.MULTILINE)
    listed = dict(re.findall(r"^\| `(\w+)` \| (.+?) \| .+ \|$", options, flags=re.MULTILINE))
    parameters = inspect.signature(FUNCTIONS[name]).parameters
    assert sorted(["".join(found) for found in given] + [*listed]) == sorted(parameters)
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
    assert [*includes(index)] == ["all-methods", *(f"toctree-{group}" for group in tables.GROUPS)]
    listed = [name for group in tables.GROUPS for name in INCLUDED[f"toctree-{group}"].splitlines()[4:-1]]
    assert listed == re.findall(r"\]\((\w+)\.md\)", INCLUDED["all-methods"])
    assert sorted(listed) == sorted(FUNCTIONS)
    assert set(ideas.IDEAS) == set(FUNCTIONS) == {s.method for s in SWEEPS}


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


def test_what_has_changed_since_it_was_measured_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def git(*arguments: str) -> None:
        names = ["-c", "user.name=A", "-c", "user.email=a@example.org"]
        subprocess.run(["git", "-C", str(tmp_path), *names, *arguments], check=True, capture_output=True)

    monkeypatch.setattr(measured, "ROOT", tmp_path)
    monkeypatch.setattr(choose, "FOLDER", tmp_path)
    table = pd.DataFrame({"method": ["GC"], "ms": ["9"]})
    git("init")
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "code").write_text("old", encoding="utf-8")
    git("add", ".")
    git("commit", "-m", "code")
    measured.save(tmp_path / "a.csv", "make it", ["first"], table, "one thread")
    measured.save(tmp_path / "b.csv", "make it", ["second"], table, "one thread")
    assert choose.list_outdated() == []

    (tmp_path / "first" / "code").write_text("new", encoding="utf-8")
    [line] = choose.list_outdated()
    assert line.startswith("a: 1 files changed since")
    assert "first/code" in line
    with pytest.raises(SystemExit, match="commit first"):
        measured.save(tmp_path / "a.csv", "make it", ["first"], table, "one thread")

    text = (tmp_path / "b.csv").read_text(encoding="utf-8")
    (tmp_path / "b.csv").write_text(re.sub("commit: .*", "commit: abcdef0", text), encoding="utf-8")
    assert choose.list_outdated()[1] == "b: this copy lacks its commit, abcdef0"


def test_records_of_peers_become_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    saved: list[tuple[str, pd.DataFrame, str]] = []
    monkeypatch.setattr(
        choose, "save", lambda path, _command, _code, table, how: saved.append((path.stem, table, how))
    )
    records = Journal(tmp_path / "results.jsonl")
    common = {"differs": 3, "base_mib": 1.0, "peak_mib": 2.0, "others": 0.5}
    for peer, seconds, f in (("cgroup_gc", 0.01, 0.25), ("pcl_gc", 0.08, 1.0)):
        record = common | {"median_s": seconds, "times_s": [seconds], "f": f}
        records.add(Run(peer, 5000, 0.03, 1, 0), record)
    choose.record_peers(tmp_path)
    [(name, table, how)] = saved
    assert (name, how) == ("peers-5000", "0.5 of them at work for others")
    assert table[["right", "program", "F", "ms, 1 thread"]].to_numpy().tolist() == [
        ["3 %", "**cgroup GC**", "0.25", "10.0"],
        ["3 %", "PCL GC, threshold 3", "1.00", "80.0"],
    ]


def test_every_method_is_measured_at_every_size_and_share():
    sized = tables.sized()
    for name in METHOD_INFO:
        kinds = set(sized[sized["method"] == name][["n", "inliers"]].itertuples(index=False, name=None))
        wanted = {(n, share) for n in tables.SIZES for share in tables.SHARES if round(n * share) >= 4}
        assert kinds == wanted
    assert load_methods()[["precision", "recall", "f_score"]].stack().between(0, 1).all()


def test_changed_measurements_are_listed(monkeypatch: pytest.MonkeyPatch):
    assert measure_options.list_changed(["gc"]) == []
    changed = load_options().assign(f_score=lambda table: table["f_score"] + 2e-4)
    monkeypatch.setattr(measure_options, "load_options", lambda: changed)
    [line] = measure_options.list_changed(["gc"])
    assert line.startswith("gc, tolerance=")


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
