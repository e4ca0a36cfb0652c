"""Every method has its page with all of its options, and the pages tell what was measured."""

import inspect
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from cgroup.registry import METHOD_INFO, MethodOption, find_method

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs" / "figures"))

pytest.importorskip("matplotlib", reason="figures of the pages are drawn by matplotlib")

pd = pytest.importorskip("pandas", reason="measurements are read by pandas")

import choose  # noqa: E402 - the script of the measurements
import methods as figures  # noqa: E402 - the script of the figures

from method_figures import chooser, ideas, measured, tables  # noqa: E402
from method_figures.measure_options import measure_value  # noqa: E402
from method_figures.measured import FOLDER, load_methods, load_options, load_origin, load_table  # noqa: E402
from method_figures.sweeps import SWEEPS, VIEWS  # noqa: E402
from peers.records import Journal, Run  # noqa: E402 - found by `choose`

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


@pytest.mark.parametrize("page", tables.PAGES, ids=lambda page: page.stem)
def test_tables_are_those_of_the_measured_figures_and_docstrings(page: Path):
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


MEASURED = re.compile(r"\d (ms|MiB)\b|\d of (the |its )?\d|^\|.*[\d*] / [\d*]")
"""What measured numbers look like: units, counts of counts, columns of one number beside another."""

CHOSEN = (
    *("calls under 20 ms", "beyond 64 MiB", "other matches and 10 of the group's"),
    "**Two scans, matched:**",
    *("| a tenth or more", "| several motions", "| a first guess", "| overlap below 0.3"),
)
"""Parts of lines that look so and are parameters, an output, words about the tables of their page, or what its picture
shows, which `test_examples.py` computes."""

REPORTS = {"readings", "reproduction"}
"""Pages on one run each, which their tables name."""


@pytest.mark.parametrize(
    "page", [page for page in tables.PAGES if page.stem not in REPORTS], ids=lambda page: page.stem
)
def test_measured_numbers_come_from_their_files(page: Path):
    text = without_marked(page.read_text(encoding="utf-8"))
    lines = [line for line in text.splitlines() if MEASURED.search(line)]
    assert not [line for line in lines if not any(part in line for part in CHOSEN)], (
        "move it to docs/figures/measured, or quote it"
    )


def without_marked(text: str) -> str:
    """Leave out what is made from measurements or quotes them, and code."""
    marked = r"<!-- (\w+): [^\n]+ -->\n.*?<!-- end of \1 -->|^(`{3,})[^\n]*\n.*?^\2"
    return re.sub(marked, "", text, flags=re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("page", tables.PAGES, ids=lambda page: page.stem)
def test_quoted_numbers_stand_in_their_files(page: Path):
    text = page.read_text(encoding="utf-8")
    for names, prose in re.findall(
        r"<!-- quoted: ([^\n]+) -->\n(.*?)<!-- end of quoted -->", text, flags=re.DOTALL
    ):
        there = set().union(*(numbers_of_file(name) for name in names.split()))
        assert numbers(re.sub(r"\]\([^)]*\)", "", prose)) <= there, f"not in {names}"


def numbers(text: str) -> set[float]:
    found = re.findall(r"(?<![\w.])(?:\d{1,3}(?:,\d{3})+|\d+)?(?:\.\d+)?", text)
    return {float(number.replace(",", "")) for number in found if number}


def numbers_of_file(name: str) -> set[float]:
    table = load_table(FOLDER / f"{name}.csv")
    return numbers(" ".join([name.replace("-", " "), *table.columns, *table.to_numpy().ravel()]))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_scores_on_a_methods_page_were_measured_for_it(name: str):
    text = without_marked((PAGES / f"{name}.md").read_text(encoding="utf-8"))
    scores: set[str] = set()
    for table in (load_methods(), load_options()):
        rows = table[table["method"] == find_method(name).name]
        scores |= {tables.two(value) for value in rows[["precision", "recall", "f_score"]].to_numpy().ravel()}
    scores |= {score.removesuffix("0") for score in scores}
    assert set(re.findall(r"(?<![\w.])\.\d\d?\b", text)) <= scores


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
