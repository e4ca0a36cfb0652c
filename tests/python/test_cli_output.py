"""What commands print: help and tables of 80 columns, plain where they are piped, and JSON."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import typer.main
from command_lines import parse_command, run, succeed, write_inputs

from cgroup import METHODS
from cgroup.cli import app
from cgroup.cli.commands.group import _length
from cgroup.cli.documents import as_text, make_document
from cgroup.cli.terminal import Column, print_table, show_stages
from cgroup.datasets import standin_pair
from cgroup.io import read_transform, write_cloud

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.usefixtures("elsewhere")

PROGRAM = [sys.executable, "-m", "cgroup"]
BOXES = re.compile("[\u2500-\u257f\x1b]")


def list_commands() -> Iterator[tuple[tuple[str, ...], Any]]:
    """List all commands, by the words that call them."""
    root = typer.main.get_command(app)
    yield (), root
    for name, command in root.commands.items():
        yield (name,), command
        for inner, nested in getattr(command, "commands", {}).items():
            yield (name, inner), nested


COMMANDS = dict(list_commands())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("input")
    write_inputs(path)
    write_cloud(path / "other.ply", standin_pair(seed=5, pixels=60).target)
    return path


# --- help ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_help_is_plain_and_fits_80_columns(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    out = succeed(capsys, *words, "--help")
    assert max(map(len, out.splitlines())) <= 80
    assert not BOXES.search(out)
    assert out.startswith("Usage: cgroup")
    assert "\nExamples:\n" in out
    for slip in ("{", "}", "<bool>", "<str>", "(not known)", "\u00a0"):
        assert slip not in out


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_examples_are_commands_that_exist(words: tuple[str, ...]) -> None:
    epilog = COMMANDS[words].epilog
    lines = [line.strip() for line in epilog.splitlines()[1:]]
    typed = [line.split(" > ")[0] for line in lines if line.startswith("cgroup ") and "COMMAND" not in line]
    assert typed
    for line in typed:
        parse_command(shlex.split(line)[1:])


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_option_is_explained_and_has_a_readable_value(words: tuple[str, ...]) -> None:
    for param in COMMANDS[words].params:
        assert param.help
        assert getattr(param, "is_flag", False) or param.metavar or param.name.endswith("_completion")


def test_every_command_can_print_json() -> None:
    for words, command in COMMANDS.items():
        if not hasattr(command, "commands"):
            assert "--json" in {option for param in command.params for option in param.opts}, words


# --- tables --------------------------------------------------------------------------------------

COLUMNS = (
    Column("name", is_text=True),
    Column("first"),
    Column("second", priority=1),
    Column("third", priority=2),
)
ROWS = [("n" * 30, "1" * 20, "2" * 20, "3" * 20), ("m", "1", "2", "3")]


FIRST, SECOND, THIRD = (f"  {number * 20}" for number in "123")


@pytest.mark.parametrize(
    ("room", "wide", "row", "says"),
    [
        ("80", False, "n" * 30 + FIRST + SECOND, "Left out: third. --wide shows all."),
        ("80", True, "n" * 30 + FIRST + SECOND + THIRD, ""),
        ("200", False, "n" * 30 + FIRST + SECOND + THIRD, ""),
        ("40", False, "n" * 15 + "..." + FIRST, "Left out: second, third. --wide shows all."),
    ],
)
def test_columns_go_by_priority(
    room: str,
    wide: bool,
    row: str,
    says: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", room)
    print_table(COLUMNS, ROWS, wide=wide)
    head, first, second, *rest = capsys.readouterr().out.splitlines()
    assert head.split() == ["name", "first", "second", "third"][: len(row.split())]
    assert (first, " ".join(rest)) == (row, says)
    assert second.split() == ["m", "1", "2", "3"][: len(row.split())]
    assert len(second) == len(row)


@pytest.mark.parametrize(
    "name", ["日本語の雲の名前はとても長いのでここで切れるはずですよね", "a[red]b", "x\x1b[31m\ny"]
)
def test_strange_names_keep_rows_in_line(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    from rich.cells import cell_len  # noqa: PLC0415

    print_table(COLUMNS[:2], [(name, "1" * 50), ("b", "2" * 50)])
    lines = capsys.readouterr().out.splitlines()
    assert {cell_len(line) for line in lines[:3]} == {cell_len(lines[1])}
    assert len(lines) <= 4
    assert cell_len(lines[1]) <= 80
    assert "\x1b" not in "".join(lines)


def test_the_main_table_fits_80_columns_and_has_every_method_as_json(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = (folder / "source.ply", folder / "target.ply", "--truth", folder / "truth.txt")
    document = succeed(capsys, "compare", *arguments, "--json")
    rows = parse(document)["results"]["methods"]
    assert [row["method"] for row in rows] == list(METHODS)
    assert all((row["T_target_source"] is None) == (row["rotation_error_deg"] is None) for row in rows)
    lines = succeed(capsys, "compare", *arguments).splitlines()
    head = next(line for line in lines if line.startswith("method"))
    assert head.split()[:6] == ["method", "selected", "precision", "recall", "F", "registered"]
    rows = lines[lines.index(head) + 1 :][: len(METHODS)]
    scores = [float(row.split()[4]) for row in rows]
    assert scores == sorted(scores, reverse=True)
    assert max(len(line) for line in lines if str(folder) not in line) <= 80
    assert not BOXES.search("".join(lines))


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
@pytest.mark.parametrize(
    ("environment", "colored"), [({}, True), ({"NO_COLOR": "1"}, False), ({"TERM": "dumb"}, False)]
)
def test_a_terminal_gets_colours_and_its_own_width(environment: dict[str, str], colored: bool) -> None:
    import pty  # noqa: PLC0415 - Unix only

    main, inner = pty.openpty()
    others = {"COLUMNS", "NO_COLOR", "FORCE_COLOR"}
    unset = {name: value for name, value in os.environ.items() if name not in others}
    subprocess.run(
        [*PROGRAM, "--help"],
        stdout=inner,
        stderr=inner,
        check=True,
        env={**unset, "TERM": "xterm", **environment},
    )
    os.close(inner)
    shown = b""
    while True:
        try:
            chunk = os.read(main, 65536)
        except OSError:
            break
        if not chunk:
            break
        shown += chunk
    assert (b"\x1b[" in shown) is colored


# --- JSON ----------------------------------------------------------------------------------------


def parse(text: str) -> dict[str, Any]:
    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    return json.loads(text, parse_constant=refuse)


def test_documents_are_plain() -> None:
    document = make_document("x", a=np.nan, b=np.eye(2), c=(np.float32(1), np.bool_(True)), d={"e": -np.inf})
    assert parse(as_text(document)) == document
    plain = {"a": None, "b": [[1, 0], [0, 1]], "c": [1, True], "d": {"e": None}}
    assert document == {**make_document("x"), **plain}
    assert as_text({"é": "日"}).isascii()


def test_documents_are_unicode() -> None:
    """As many readers of JSON want it: `\\udcff` by itself is no character."""
    text = as_text(
        {"a\udcff": "b\ud800\n", "c": ["d\udcff", "\\udcff", "😀"], "e": {"f": ["\udc80"], "g": [{}]}}
    )
    assert json.loads(text) == {
        "a\\udcff": "b\\ud800\n", "c": ["d\\udcff", "\\udcff", "😀"], "e": {"f": ["\\udc80"], "g": [{}]},
    }  # fmt: skip


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux only")
def test_names_that_are_no_utf8(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, target = (
        Path(os.fsdecode(os.fsencode(tmp_path) + name)) for name in (b"/s\xff.ply", b"/t\xfe.ply")
    )
    source.write_bytes((folder / "source.ply").read_bytes())
    target.write_bytes((folder / "target.ply").read_bytes())
    done = parse(succeed(capsys, "recognize", source, "--scene", target, "--out", tmp_path / "out", "--json"))
    names = [one["model"] for one in done["results"]["found"]] + [
        Path(one["file"]).name for one in done["inputs"]
    ]
    assert names == ["s\\udcff", "t\\udcfe.ply", "s\\udcff.ply"]
    "".join(names).encode()
    out = succeed(capsys, "recognize", source, "--scene", target, "--out", tmp_path / "out")
    assert "\ns\\udcff  yes" in out


def test_register_as_json(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = succeed(capsys, "register", folder / "source.ply", folder / "target.ply", "--json")
    document = parse(out)
    assert list(document) == [
        "schema_version", "cgroup_version", "command", "inputs", "options", "results", "files"
    ]  # fmt: skip
    written = read_transform(tmp_path / "out/source_on_target.txt")
    np.testing.assert_array_equal(document["results"]["T_target_source"], written)
    assert document["results"]["ok"] is True
    assert document["options"]["effort"] == "normal"
    assert [one["role"] for one in document["inputs"]] == ["source", "target"]
    assert all((tmp_path / file).exists() for file in document["files"])


def test_no_pose_as_json_has_the_guess(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "register", folder / "source.ply", folder / "other.ply", "--json")
    document = parse(out)
    assert status == document["error"]["exit_status"] == 3
    assert err == f"cgroup: {document['error']['message']}\n"
    assert document["error"]["kind"] == "NoConsensusError"
    assert document["guess"]["ok"] is False


@pytest.mark.parametrize(
    ("line", "command", "kind"),
    [
        ("register a.ply b.ply --json", "register", "InputError"),
        ("register --json", "register", "UsageError"),
        ("benchmark status --out nowhere --json", "benchmark status", "InputError"),
    ],
)
def test_errors_as_json(line: str, command: str, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, *line.split())
    document = parse(out)
    assert document["command"] == command
    parts = {
        name: document["error"].pop(name) for name in ("parameter", "got", "remedy") if kind == "InputError"
    }
    assert document["error"] == {"kind": kind, "message": err[len("cgroup: ") : -1], "exit_status": status}
    assert all(part is None or part in err for part in parts.values())
    assert status == 2


@pytest.mark.parametrize("method", ["gtm", "GTM", "3DHV", "hough3d", "SC2-PCR", "teaser++", "RANSAC"])
def test_group_as_json(method: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "group", folder / "matches.npz", "--method", method, "--json")
    if status:
        assert "source_lrf" in err
        return
    found = parse(out)["results"]
    assert found["indices"][:40] == list(range(40))
    assert found["residual_rms"] < 1e-3
    assert found["ok"] is None


def test_group_prints_pose_residuals_and_reliability(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, out, _ = run(capsys, "group", folder / "matches.npz", "--method", "LC")
    lines = out.splitlines()
    assert lines[0].startswith("40 of 60 selected by LC")
    assert lines[2].split()[-1] == "1"
    assert any(line.startswith("residuals   root mean square") and line.endswith(" pr)") for line in lines)
    assert any(line.startswith("reliable    yes: ") for line in lines)
    _, out, _ = run(capsys, "group", folder / "matches.txt", "--method", "gtm")
    assert "reliable    unknown: GTM has no estimate; --method lc has" in out


@pytest.mark.parametrize("method", ["gtm", "lc"])
def test_group_of_no_matches_says_so(method: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    nothing = np.zeros((0, 3))
    np.savez(tmp_path / "none.npz", source=nothing, target=nothing, resolution=1.0)
    line = ("group", tmp_path / "none.npz", "--method", method)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        status, out, err = run(capsys, *line)
        _, document, _ = run(capsys, *line, "--json")
    assert (status, err.startswith("cgroup: no consensus")) == ((3, True) if method == "lc" else (0, False))
    assert "no pose     no consensus" in out
    assert parse(document)["inputs"][0]["centroid"] is None


def test_far_residuals_are_plain_numbers() -> None:
    assert _length(3.48, 0.0207) == "3.48 (170 pr)"
    assert _length(1.19, 0.5655) == "1.19 (2.1 pr)"


def test_a_dumb_terminal_gets_no_spinner(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "dumb")
    with show_stages() as begin:
        begin("matching")
    assert capsys.readouterr().err == ""


# --- completion ----------------------------------------------------------------------------------


def complete(**environment: str) -> str:
    done = subprocess.run(
        PROGRAM, env={**os.environ, **environment}, capture_output=True, text=True, check=True
    )
    return done.stdout


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("cgroup re", ["register", "recognize"]),
        ("cgroup group --method s", ["ss", "si", "st", "sc2pcr"]),
        ("cgroup register --effort ", ["low", "normal", "high"]),
        ("cgroup benchmark run sm", ["smoke"]),
    ],
)
def test_bash_completes(words: str, expected: list[str]) -> None:
    place = {"COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    assert complete(_CGROUP_COMPLETE="complete_bash", **place).split() == expected


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts_are_printed(shell: str) -> None:
    assert "_CGROUP_COMPLETE=complete_" + shell in complete(_CGROUP_COMPLETE=f"source_{shell}")


SLOW = "rich matplotlib plotly pandas pydantic platformdirs scipy trimesh pypcd4 laspy"


@pytest.mark.parametrize(("loaded", "slow"), [("cgroup", f"{SLOW} typer"), ("cgroup.cli", SLOW)])
def test_starts_without_loading_what_it_may_not_need(loaded: str, slow: str) -> None:
    code = f"import sys, {loaded}; sys.exit(', '.join(set('{slow}'.split()) & set(sys.modules)) or 0)"
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


# --- the page ------------------------------------------------------------------------------------

PAGE = (Path(__file__).parents[2] / "docs" / "command-line.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```console\n(.*?)```", PAGE, flags=re.DOTALL)


def test_the_page_shows_output_of_80_columns() -> None:
    assert len(BLOCKS) >= 3
    assert max(len(line) for block in BLOCKS for line in block.splitlines()) <= 80


def test_the_page_names_every_command_and_every_key(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, command in COMMANDS.items():
        if words and not hasattr(command, "commands"):
            assert re.search(rf"`[^`]*\b{words[-1]}\b[^`]*`", PAGE), words
    for line in (
        "register {0}/source.ply {0}/target.ply",
        "compare {0}/source.ply {0}/target.ply --truth {0}/truth.txt",
        "group {0}/matches.npz",
        "describe {0}/source.ply",
    ):
        document = parse(run(capsys, *line.format(folder).split(), "--json")[1])
        for key in (*document, *document["results"], *document["inputs"][0]):
            assert f"`{key}`" in PAGE, (line, key)
