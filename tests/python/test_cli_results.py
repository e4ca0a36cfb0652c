"""Saved runs: what ``--save`` keeps, and ``cgroup results`` lists, shows, compares and removes."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
from command_lines import fail, run, succeed, write_inputs

from cgroup.cli.saved_runs import folder_of_runs, load_run, names_of_runs, save_run
from cgroup.errors import InputError
from cgroup.rigid import rotation_error

if TYPE_CHECKING:
    from pathlib import Path

CHANGES = {
    "empty": b"",
    "text": b"nothing of the kind",
    "cut": None,
    "a list": b"[1, 2]",
    "deep": b"[" * 100_000,
    "another object": b'{"schema_version": 1}',
    "hollow": b'{"schema_version": 1, "command": "group", "inputs": [], "options": {}, "results": {}, "saved": {}}',
    "wrong types": b'{"schema_version": 1, "command": "compare", "inputs": [1], "options": {}, "results": {"methods": 3}, "saved": {"date": 1}}',
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("input")
    write_inputs(path)
    return path


@pytest.fixture(autouse=True)
def saved(folder: Path, elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """Save two runs."""
    for name, options in {
        "one": ("--method", "gtm"),
        "two": ("--method", "lc", "--tolerance", "0.05"),
    }.items():
        succeed(capsys, "group", folder / "matches.npz", *options, "--save", name)
    return elsewhere / "saved"


def test_a_saved_run_says_what_was_done(saved: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = json.loads((saved / "two.json").read_text())
    assert document["command"] == "group"
    assert document["options"]["method"] == "lc"
    assert document["options"]["tolerance"] == 0.05
    assert len(document["inputs"][0]["sha256"]) == 64
    assert set(document["saved"]) == {"date", "machine"}
    assert names_of_runs() == ["one", "two"]
    status, out, _ = run(capsys, "results", "show", "two", "--json")
    assert (status, json.loads(out)) == (0, document)


@pytest.mark.parametrize("words", [("results",), ("results", "list")])
def test_runs_are_listed(words: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    out = succeed(capsys, *words)
    assert [line.split()[0] for line in out.splitlines()] == ["name", "one", "two"]
    assert "40 of 60 by LC" in out
    succeed(capsys, "results", "remove", "one", "two")
    assert "no saved runs in" in run(capsys, *words)[1]


def test_a_run_is_shown_as_it_was(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command, name in (("register", "reg"), ("compare", "com")):
        truth = ("--truth", folder / "truth.txt") if command == "compare" else ()
        _, said, _ = run(
            capsys, command, folder / "source.ply", folder / "target.ply", *truth, "--save", name
        )
        _, shown, _ = run(capsys, "results", "show", name)
        assert said.endswith(f"saved as {name}; see: cgroup results\n")
        assert shown.splitlines()[2:] == said.splitlines()[:-1]


def test_groups_side_by_side(capsys: pytest.CaptureFixture[str]) -> None:
    out = succeed(capsys, "results", "compare", "one", "two")
    assert max(map(len, out.splitlines())) <= 80
    assert out.splitlines()[0].split() == ["run", "name", "saved", "version", "method", "tolerance"]
    _, out, _ = run(capsys, "results", "compare", "one", "two", "--json")
    compared = json.loads(out)["results"]
    poses = [np.array(load_run(name)["results"]["T_target_source"]) for name in ("one", "two")]
    assert compared["results"]["rotated_deg"] == [0, rotation_error(poses[1], poses[0])]
    assert compared["differing_options"] == {"method": ["gtm", "lc"], "tolerance": [None, 0.05]}
    assert compared["differing_inputs"] == {}


def test_the_way_between_two_poses(capsys: pytest.CaptureFixture[str]) -> None:
    """Turned by 90 degrees about z, and then shifted by (0, 0, 2)."""
    first, second = load_run("one"), load_run("two")
    first["results"]["T_target_source"] = np.eye(4).tolist()
    second["results"]["T_target_source"] = [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]]
    first["inputs"][0]["centroid"] = [1, 0, 0]
    for name, document in (("a", first), ("b", second)):
        (folder_of_runs() / f"{name}.json").write_text(json.dumps(document))
    _, out, _ = run(capsys, "results", "compare", "a", "b", "--json")
    results = json.loads(out)["results"]["results"]
    assert results["rotated_deg"][1] == pytest.approx(90)
    assert results["displaced"][1] == pytest.approx(np.sqrt(6))


def test_comparisons_side_by_side(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = (folder / "source.ply", folder / "target.ply", "--truth", folder / "truth.txt")
    for name in ("shot", "rcs"):
        succeed(capsys, "compare", *arguments, "--descriptor", name, "--save", name)
    out = succeed(capsys, "results", "compare", "shot", "rcs")
    assert max(map(len, out.splitlines())) <= 80
    head = next(line for line in out.splitlines() if line.startswith("method"))
    assert head.split()[:6] == ["method", "F", "1", "F", "2", "change"]
    assert "descriptor" in out.splitlines()[0]
    _, out, _ = run(capsys, "results", "compare", "shot", "rcs", "--json")
    saved = [load_run(name)["results"]["methods"] for name in ("shot", "rcs")]
    f_scores = [{row["method"]: row["f_score"] for row in rows} for rows in saved]
    for row in json.loads(out)["results"]["methods"]:
        assert row["f_score"] == [one[row["method"]] for one in f_scores]


def test_other_inputs_are_noticed(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changed = tmp_path / "matches.npz"
    with np.load(folder / "matches.npz") as file:
        np.savez(changed, **{**file, "resolution": 0.03})
    run(capsys, "group", changed, "--save", "three")
    assert (
        "Note: not the same in all of them: matches." in run(capsys, "results", "compare", "one", "three")[1]
    )


def test_runs_as_files(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("here.json", "made/there.json"):
        succeed(capsys, "group", folder / "matches.npz", "--save", name)
        assert (tmp_path / name).exists()
    succeed(capsys, "results", "compare", "here.json", "made/there.json")
    succeed(capsys, "results", "remove", "here.json", "made/there.json")
    assert not (tmp_path / "here.json").exists()


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("group {matches} --save one", "--save: {saved}/one.json is there already; choose another name"),
        ("group {matches} --save a*b", "give a name of letters"),
        ("group {matches} --save ../x", "--save: got '../x'; give a name"),
        ("group {matches} --save /proc/x.json", "/proc: can't be made a folder"),
        ("results show", "Missing argument 'NAME'"),
        ("results show three", "three: no such saved run; there are one, two"),
        ("results compare one", "give two or more"),
        ("results compare one three", "no such saved run"),
        ("results remove one three", "no such saved run"),
        ("results frobnicate", "frobnicate"),
    ],
)
def test_wrong_words_are_one_line(
    line: str, says: str, folder: Path, saved: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = {"matches": folder / "matches.npz", "saved": saved}
    assert says.format(**names) in fail(capsys, *line.format(**names).split())
    assert names_of_runs() == ["one", "two"]


@pytest.mark.parametrize("kind", CHANGES)
def test_broken_files_are_one_line(kind: str, saved: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = (saved / "one.json").read_bytes()
    (saved / "broken.json").write_bytes(whole[: len(whole) // 2] if kind == "cut" else CHANGES[kind] or b"")
    for words in (("show", "broken"), ("compare", "broken", "one"), ("compare", "one", "broken")):
        fail(capsys, "results", *words)
    status, out, _ = run(capsys, "results", "list")
    assert status == 0
    assert [line.split()[0] for line in out.splitlines()[1:4]] == ["broken", "one", "two"]
    assert "can't be read" in out
    succeed(capsys, "results", "remove", "broken")
    assert names_of_runs() == ["one", "two"]


def test_a_later_layout_is_refused(saved: Path, capsys: pytest.CaptureFixture[str]) -> None:
    later = {**load_run("one"), "schema_version": 99}
    (saved / "later.json").write_text(json.dumps(later))
    err = fail(capsys, "results", "show", "later")
    assert "saved in layout 99, and 1 is known; update cgroup" in err


def test_runs_of_different_commands_are_not_compared(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, "register", folder / "source.ply", folder / "target.ply", "--save", "reg")
    err = fail(capsys, "results", "compare", "one", "reg")
    assert "one of group, reg of register: give runs of the same command" in err


def test_nothing_half_written_is_left(saved: Path) -> None:
    document = load_run("one")
    (saved / "taken.json").mkdir()
    with pytest.raises(InputError, match="can't be written"):
        save_run(saved / "taken.json", document)
    assert sorted(file.name for file in saved.iterdir()) == ["one.json", "taken.json", "two.json"]


def test_the_folder_is_the_users_own_unless_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CGROUP_RESULTS")
    folder = folder_of_runs()
    assert folder.name == "results"
    assert folder.parent.name == "cgroup"
