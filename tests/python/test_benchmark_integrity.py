"""Records that aren't what was written: noticed, set aside, computed anew; and files that aren't records."""

from __future__ import annotations

import os
import shutil
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmark_runs import CLOUDS, MATCHES, contents, serial
from cgroup.benchmark import records
from cgroup.benchmark.records.checksums import checksum
from cgroup.benchmark.records.layout import TABLES
from cgroup.benchmark.records.reading import RECORDS
from cgroup.cli import main
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

FLIPS = 400 if os.environ.get("HYPOTHESIS_PROFILE") == "thorough" else 6

EVERYTHING = (
    CLOUDS
    + """
[[experiment]]
id = "mutual"
dataset = "benchmark_fakes:Clouds"
pairs = ["a"]
front = { matching = "mutual" }
[timing]
dataset = "benchmark_fakes:Clouds"
sizes = [30]
repeats = 1
threads = 1
methods = ["gc", "benchmark_fakes:wrong_length"]
[registration]
pipelines = ["benchmark_fakes:shifting"]
[[registration.sets]]
id = "views"
dataset = "benchmark_fakes:Clouds"
pairs = ["a", "b"]
loose = "kitti"
strict = "3dmatch"
[trials]
methods = ["gc"]
[[trials.sets]]
id = "matches"
dataset = "benchmark_fakes:Matches"
pairs = ["m0"]
"""
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("finished")
    serial(EVERYTHING, out)
    return out


@pytest.fixture
def out(finished: Path, tmp_path: Path) -> Path:
    return shutil.copytree(finished, tmp_path / "out")


def change(out: Path, statement: str, *values: object, affects_rows: bool = True) -> None:
    with closing(sqlite3.connect(out / RECORDS, isolation_level=None)) as connection:
        assert (connection.execute(statement, values).rowcount > 0) == affects_rows


def command(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["benchmark", *map(str, arguments)])
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err


# --- damaged rows ------------------------------------------------------------------------------------

DAMAGES = {
    "correspondences": "update correspondences set n = n + 1 where case_key = ?",
    "arrays": "update arrays set content = 'garbage' where case_key = ?",
    "groupings": "update groupings set mask = zeroblob(3) where case_key = ?",
    "scores": "update scores set correct = correct + 1 where case_key = ?",
    "timing_sets": "update timing_sets set content = zeroblob(9) where key = ?",
    "timings": "update timings set seconds = seconds / 2 where set_key = ?",
    "timing_skips": "update timing_skips set reason = cast(x'ff00' as text) where set_key = ?",
    "registrations": "update registrations set rotation_error = null where case_key = ?",
    "trials": "update trials set diagnostics = '{' where case_key = ?",
    "plan": "update plan set missing = '{' where name <> ?",
    "plan_cases": "update plan_cases set entry = 7 where case_key = ?",
    "methods": "update methods set options = '{' where key = ?",
    "machines": "update machines set checksum = null where id = ?",
    "fronts": "update fronts set changes = '' where case_key = ?",
}


def first_key(out: Path, table: str) -> str:
    with closing(sqlite3.connect(out / RECORDS)) as connection:
        column = {"plan_cases": 1}.get(table, 0)
        return connection.execute(f"select * from {table}").fetchone()[column]


def others(out: Path, table: str) -> dict[str, int]:
    whole = records.check(out).whole
    return {name: count for name, count in whole.items() if name != table}


@pytest.mark.parametrize("table", DAMAGES)
def test_a_damaged_record_is_named_set_aside_and_computed_anew(
    table: str, out: Path, finished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key = first_key(out, table)
    change(out, DAMAGES[table], key if table != "plan" else "")
    damaged = (out / RECORDS).read_bytes()

    status, printed, err = command(capsys, "check", "--out", out)
    assert (status, err) == (1, "")
    assert f"damaged: {table}" in printed
    if table not in {"arrays", "timing_sets"}:
        with pytest.raises(InputError, match=f"damaged .*{table}.*; run the same configuration again"):
            records.load(out)

    summary = serial(EVERYTHING, out)
    assert table in summary.damaged
    [kept] = out.glob("records.damaged-*.sqlite")
    assert str(kept) in summary.damaged
    assert kept.read_bytes() == damaged
    assert contents(out) == contents(finished)
    assert records.check(out).sound
    assert others(out, table) == others(finished, table)
    assert records.check(out).whole[table] == records.check(finished).whole[table]
    assert serial(EVERYTHING, out).damaged == ""


def test_damaged_matches_are_refused_where_they_are_read(out: Path) -> None:
    case = first_key(out, "arrays")
    change(out, "update arrays set truth = zeroblob(128) where case_key = ?", case)
    with pytest.raises(InputError, match=f"damaged .arrays {case}"):
        records.load_groups(out, case)


def test_every_table_bears_checksums(out: Path) -> None:
    whole = records.check(out).whole
    assert list(whole) == list(TABLES)
    assert all(whole[table] for table in DAMAGES)


def test_a_checksum_tells_columns_and_types_apart() -> None:
    rows = [("a", "b"), ("ab", ""), (b"a", "b"), (1, 2), (12, None), ("1", "2"), (None, "ab"), (1.5, 2)]
    assert len({checksum(row) for row in rows}) == len(rows)
    assert checksum((1, float("nan"), True)) == checksum((1.0, None, 1))


# --- damaged files -----------------------------------------------------------------------------------


def test_any_flipped_byte_is_noticed_or_of_no_effect(finished: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    whole = contents(finished)
    scores = records.load(finished)
    noticed = 0
    content = (finished / RECORDS).read_bytes()
    for number in range(FLIPS):
        out = tmp_path / str(number)
        out.mkdir()
        flipped = bytearray(content)
        flipped[rng.integers(100, len(content))] ^= 1 << int(rng.integers(8))
        (out / RECORDS).write_bytes(flipped)
        try:
            assert records.load(out).equals(scores)
        except InputError:
            noticed += 1
        summary = serial(EVERYTHING, out)
        assert contents(out) == whole
        if summary.damaged:
            [kept] = out.glob("records.damaged-*.sqlite")
            assert kept.read_bytes() == flipped
        assert records.check(out).sound
    assert noticed


def test_a_repair_that_was_stopped_goes_on(out: Path, finished: Path) -> None:
    (out / RECORDS).rename(out / f"{RECORDS}.new")
    summary = serial(EVERYTHING, out)
    assert summary.damaged == ""
    assert contents(out) == contents(finished)
    assert not (out / f"{RECORDS}.new").exists()


def test_a_changed_definition_of_a_table_is_noticed(out: Path, finished: Path) -> None:
    change(out, "create table more (x)", affects_rows=False)
    with pytest.raises(InputError, match="damaged .more"):
        records.load(out)
    (out / RECORDS).write_bytes(
        (finished / RECORDS).read_bytes().replace(b"translation_error real", b"Translation_error real")
    )
    with pytest.raises(InputError, match="damaged .registrations; scores"):
        records.load(out)
    assert "its definition isn't what was written" in serial(EVERYTHING, out).damaged
    assert contents(out) == contents(finished)


@pytest.mark.parametrize("size", [0.3, 0.9])
def test_what_is_left_of_a_file_is_kept(size: float, out: Path, finished: Path) -> None:
    content = (out / RECORDS).read_bytes()
    (out / RECORDS).write_bytes(content[: int(len(content) * size)])
    assert serial(EVERYTHING, out).damaged
    assert contents(out) == contents(finished)


@pytest.mark.parametrize("command_name", ["status", "claims", "report", "rankings", "check", "run"])
@pytest.mark.parametrize("kind", ["foreign", "newer", "other database", "header"])
def test_what_is_no_file_of_records_is_one_line(
    kind: str, command_name: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = out / RECORDS
    if kind == "foreign":
        file.write_text("something else\n" * 100)
    elif kind == "newer":
        change_version(file, 7)
    elif kind == "header":
        file.write_bytes(b"\0" + file.read_bytes()[1:])
    else:
        file.unlink()
        with closing(sqlite3.connect(file)) as connection:
            connection.execute("create table t (x)")
    before = file.read_bytes()
    arguments = ["smoke"] if command_name == "run" else []
    status, printed, err = command(capsys, command_name, *arguments, "--out", out)
    assert (status, printed, err.count("\n")) == (2, "", 1)
    assert ("its layout is number 7" if kind == "newer" else "not a file of records") in err
    assert file.read_bytes() == before


@pytest.mark.parametrize("command_name", ["status", "claims", "report", "rankings", "check"])
@pytest.mark.parametrize("kind", ["missing", "empty", "no plan"])
def test_no_records_is_one_line(
    kind: str, command_name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / RECORDS
    if kind == "empty":
        file.touch()
    elif kind == "no plan":
        serial(MATCHES + "pairs = 1", tmp_path)
        change(tmp_path, "delete from plan")
    status, _, err = command(capsys, command_name, "--out", tmp_path)
    if kind == "no plan" and command_name in {"check", "claims", "rankings"}:
        return
    assert (status, err.count("\n")) == (2, 1)
    assert "no records; make some with" in err
    if kind == "empty":
        serial(MATCHES + "pairs = 1", tmp_path)
        assert len(records.load(tmp_path)) == 2


def change_version(file: Path, version: int) -> None:
    with closing(sqlite3.connect(file)) as connection:
        connection.execute(f"pragma user_version = {version}")


# --- earlier layouts ---------------------------------------------------------------------------------


def make_layout_4(out: Path) -> None:
    """Take away what cases change of the front end."""
    with closing(sqlite3.connect(out / RECORDS, isolation_level=None)) as connection:
        connection.execute("drop table fronts")
    change_version(out / RECORDS, 4)


def make_layout_3(out: Path) -> None:
    """Take the checksums away, too."""
    make_layout_4(out)
    with closing(sqlite3.connect(out / RECORDS, isolation_level=None)) as connection:
        for table in TABLES:
            if table != "fronts":
                connection.execute(f"alter table {table} drop column checksum")
    change_version(out / RECORDS, 3)


def test_records_of_layout_4_are_read_and_brought_up_to_date(out: Path, finished: Path) -> None:
    make_layout_4(out)
    frame = records.load(out)
    assert frame.drop(columns="front").equals(records.load(finished).drop(columns="front"))
    assert set(frame["front"]) == {""}
    assert records.check(out).sound
    assert "fronts" not in records.check(out).whole
    assert serial(EVERYTHING, out).damaged == ""
    assert contents(out) == contents(finished)
    assert records.load(out).equals(records.load(finished))
    assert records.check(out) == records.check(finished)


def test_damaged_records_of_layout_4_are_computed_anew(out: Path, finished: Path) -> None:
    make_layout_4(out)
    change(out, DAMAGES["groupings"], first_key(out, "groupings"))
    with pytest.raises(InputError, match=r"damaged .*groupings.*; run the same configuration again"):
        records.load(out)
    assert "groupings" in serial(EVERYTHING, out).damaged
    assert contents(out) == contents(finished)
    assert records.check(out) == records.check(finished)


def test_records_of_layout_3_are_read_and_get_checksums(out: Path, finished: Path) -> None:
    make_layout_3(out)
    assert records.load(out).drop(columns="front").equals(records.load(finished).drop(columns="front"))
    assert records.check(out).whole == {}
    serial(EVERYTHING, out)
    assert contents(out) == contents(finished)
    assert records.check(out) == records.check(finished)


@pytest.mark.parametrize("column", ["facts", "protocols"])
def test_bad_json_in_records_without_checksums_is_one_line(
    column: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make_layout_3(out)
    change(out, f"update {'scores' if column == 'protocols' else 'correspondences'} set {column} = '[1'")
    status, _, err = command(capsys, "claims", "--out", out)
    assert (status, err.count("\n")) == (2, 1)
    assert "no JSON" in err


def test_a_locked_file_is_one_line(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    connect: Callable[..., sqlite3.Connection] = sqlite3.connect
    monkeypatch.setattr(sqlite3, "connect", lambda *a, **k: connect(*a, **{**k, "timeout": 0.1}))
    with closing(connect(out / RECORDS, isolation_level=None)) as other:
        other.execute("begin immediate")
        with pytest.raises(
            InputError, match=r"records.sqlite: can't be read or written \(database is locked\)"
        ):
            serial(EVERYTHING + "\n", out)
    assert serial(EVERYTHING, out).failed == 0


def test_check_says_what_is_whole(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, printed, err = command(capsys, "check", "--out", out)
    assert (status, err) == (0, "")
    assert printed.endswith("all records are whole\n")
    assert "groupings            10 whole" in printed
    key = first_key(out, "groupings")
    change(out, "update groupings set pose = null where case_key = ?", key)
    status, printed, err = command(capsys, "check", "--out", out)
    assert (status, err) == (1, "")
    assert printed.count(f"damaged: groupings {key}") == 2
    assert "(benchmark_fakes:Clouds a)" in printed or "(benchmark_fakes:Clouds b)" in printed
