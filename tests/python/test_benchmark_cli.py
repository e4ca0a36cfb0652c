"""`cgroup benchmark` on the command line."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from benchmark_runs import CLOUDS
from cgroup.benchmark.config import preset_names
from cgroup.cli import main

if TYPE_CHECKING:
    from pathlib import Path


def command(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["benchmark", *map(str, arguments)])
    out, err = capsys.readouterr()
    assert isinstance(ended.value.code, int)
    return ended.value.code, out, err


def test_run_and_status(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "own.toml"
    config.write_text(CLOUDS.replace('["a", "b"]', '["a", "broken"]'))
    status, out, err = command(capsys, "run", config, "--out", tmp_path / "out", "--workers", 1)
    assert (status, err) == (0, "")
    assert "cases matched  2 of 4, 2 failed" in out
    assert "2 of 12 failed; see: cgroup benchmark status" in out
    status, out, err = command(capsys, "status", "--out", tmp_path / "out")
    assert (status, err) == (0, "")
    assert "failed     2 x correspond: OSError: this pair is broken" in out
    status, out, err = command(capsys, "status", "--out", tmp_path / "out", "--json")
    assert (status, err) == (0, "")
    results = json.loads(out)["results"]
    assert results["counts"]["correspond"] == {"done": 2, "failed": 2, "wanted": 4}
    assert results["failures"] == [
        {"method": "", "error": "OSError: this pair is broken", "times": 2},
    ]


def test_presets(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = command(capsys, "presets")
    assert (status, err) == (0, "")
    for name in preset_names():
        assert name in out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("run nowhere.toml", "nowhere.toml: no configuration that can be read"),
        ("run smoke --backend mpi", "--backend"),
        ("run smoke --workers 0", "--workers"),
        ("status --out nowhere", "nowhere: no records; make some"),
        ("frobnicate", "frobnicate"),
    ],
)
def test_wrong_input_is_one_line(
    arguments: str,
    says: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = command(capsys, *arguments.split())
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    assert says in err
