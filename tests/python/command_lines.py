"""Command lines run within the tests' own process, and small files for them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.main

from cgroup import Correspondences
from cgroup.cli import app, main
from cgroup.datasets import standin_pair
from cgroup.io import write_cloud, write_correspondences, write_transform
from cgroup.io.result_folders import LIST


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Run the command line; return its exit status and what it printed."""
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    assert isinstance(ended.value.code, int)
    return ended.value.code, out, err


def succeed(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """Run the command line without an error; return what it printed."""
    status, out, err = run(capsys, *arguments)
    assert (status, err) == (0, "")
    return out


def fail(capsys: pytest.CaptureFixture[str], *arguments: object, status: int = 2) -> str:
    """Run the command line, which ends with a status and one line alone; return the line."""
    ended, out, err = run(capsys, *arguments)
    assert (ended, out, err.count("\n")) == (status, "", 1)
    assert err.startswith("cgroup: ")
    return err


def parse_command(words: list[str]) -> None:
    """Let each command take its words, as far as running it."""
    command, context = typer.main.get_command(app), None
    while words:
        context = command.make_context(command.name, words, parent=context)
        words = [*getattr(context, "_protected_args", []), *context.args]
        if not words or not hasattr(command, "resolve_command"):
            break
        _, command, words = command.resolve_command(context, words)
        if not words:
            command.make_context(command.name, [], parent=context)
    assert getattr(command, "invoke_without_command", True), "a command is missing"


def results_in(folder: Path) -> list[str]:
    """Return the names of a folder's files, sorted, without the list that commands keep of them."""
    return sorted(file.name for file in folder.iterdir() if file.name != LIST)


def write_inputs(path: Path) -> None:
    """Write two scans, their pose, and matches with 40 right ones among 60."""
    pair = standin_pair(pixels=60)
    write_cloud(path / "source.ply", pair.source)
    write_cloud(path / "target.ply", pair.target)
    write_transform(path / "truth.txt", pair.T_target_source)
    rng = np.random.default_rng(0)
    source = rng.uniform(size=(60, 3))
    target = source + np.array([1, 2, 3])
    target[40:] = rng.uniform(size=(20, 3))
    write_correspondences(path / "matches.npz", Correspondences(source, target, resolution=0.02))
    np.savetxt(path / "matches.txt", np.hstack([source, target]))


def undocumented(document: dict[str, Any], *more: dict[str, Any]) -> set[str]:
    """Return keys of a document, its first input, its results and more that the page on commands lacks."""
    page = (Path(__file__).parents[2] / "docs" / "command-line.md").read_text(encoding="utf-8")
    keys = {key for part in (document, document["inputs"][0], document["results"], *more) for key in part}
    return {key for key in keys if f"`{key}`" not in page}
