"""What commands print: help and tables of 80 columns, plain where they are piped, and JSON."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import typer.main
from command_lines import parse_command, run, succeed, undocumented, write_inputs

from cgroup.cli import app
from cgroup.cli.commands.group import _length
from cgroup.cli.documents import as_text, make_document
from cgroup.cli.terminal import print_table, show_stages

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
    return path


# --- help ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_help_is_complete_and_fits_80_columns(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    out = succeed(capsys, *words, "--help")
    assert max(map(len, out.splitlines())) <= 80
    assert not BOXES.search(out)
    assert out.startswith("Usage: cgroup")
    assert "\nExamples:\n" in out
    for slip in ("{", "}", "<bool>", "<str>", "(not known)", "\u00a0"):
        assert slip not in out
    command = COMMANDS[words]
    lines = [line.strip().split(" > ")[0] for line in command.epilog.splitlines()[1:]]
    typed = [line for line in lines if line.startswith("cgroup ") and "COMMAND" not in line]
    assert typed
    for line in typed:
        parse_command(shlex.split(line)[1:])
    for param in command.params:
        assert param.help
        assert getattr(param, "is_flag", False) or param.metavar or param.name.endswith("_completion")
    assert hasattr(command, "commands") or "--json" in {name for each in command.params for name in each.opts}


# --- tables --------------------------------------------------------------------------------------

COLUMNS = ("name", "first", "second", "third")
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
    print_table(COLUMNS, ROWS, drop=(3, 2), wide=wide)
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
    shown = os.read(main, 65536)
    os.close(main)
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
    # Half of a pair of surrogates is no character: it is escaped.
    nested = {"a\udcff": "b\ud800\n", "c": ["d\udcff", "😀"], "e": {"f": ["\udc80"], "g": [{}]}}
    escaped = {"a\\udcff": "b\\ud800\n", "c": ["d\\udcff", "😀"], "e": {"f": ["\\udc80"], "g": [{}]}}
    assert json.loads(as_text(nested)) == escaped


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


def test_bash_completes() -> None:
    for words, expected in (
        ("cgroup group --method s", ["ss", "si", "st", "sc2pcr"]),
        ("cgroup benchmark run sm", ["smoke"]),
    ):
        place = {"COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
        environment = {**os.environ, "_CGROUP_COMPLETE": "complete_bash", **place}
        assert subprocess.check_output(PROGRAM, env=environment, text=True).split() == expected


SLOW = "rich matplotlib plotly pandas pydantic platformdirs scipy trimesh pypcd4 laspy"


@pytest.mark.parametrize(("loaded", "slow"), [("cgroup", f"{SLOW} typer"), ("cgroup.cli", SLOW)])
def test_starts_without_loading_what_it_may_not_need(loaded: str, slow: str) -> None:
    code = f"import sys, {loaded}; sys.exit(', '.join(set('{slow}'.split()) & set(sys.modules)) or 0)"
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


# --- the page ------------------------------------------------------------------------------------


def test_the_page_names_every_key(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for line in (
        "register {0}/source.ply {0}/target.ply",
        "compare {0}/source.ply {0}/target.ply --truth {0}/truth.txt",
        "group {0}/matches.npz",
        "describe {0}/source.ply",
    ):
        assert not undocumented(parse(run(capsys, *line.format(folder).split(), "--json")[1])), line
