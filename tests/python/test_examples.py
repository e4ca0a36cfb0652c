"""Every example and notebook runs as a user would run it; notebooks are kept without their outputs."""

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from shared_data import data_folder

EXAMPLES = Path(__file__).parents[2] / "examples"
NOTEBOOKS = sorted((EXAMPLES / "notebooks").glob("*.ipynb"))
OFFLINE = {"https_proxy": "http://127.0.0.1:9", "CGROUP_DATA": "nowhere"}  # nothing listens there
NEEDED = {"reason": "the notebooks need the extra test: pip install '.[test]'"}


@pytest.mark.parametrize("example", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_example_runs(example: Path, tmp_path: Path) -> None:
    ended = subprocess.run(
        [sys.executable, str(example)],
        cwd=tmp_path,
        env=os.environ | OFFLINE,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout
    assert ("can't be read: <urlopen error" in ended.stdout) == (example.stem == "register_real_scans")


def test_real_scans_are_registered_as_stanford_did(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CGROUP_DATA", str(data_folder("stanford_views")))
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES / "register_real_scans.py"))
    printed = capsys.readouterr().out
    assert float(re.search(r"Difference ([\d.]+) degrees", printed)[1]) < 0.2
    assert "stone" not in printed
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["registration.html"]


# Jupyter's own libraries warn of each other.
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs_and_is_kept_without_outputs(path: Path, tmp_path: Path) -> None:
    nbformat, nbclient = (pytest.importorskip(name, **NEEDED) for name in ("nbformat", "nbclient"))
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert code
    assert len(NOTEBOOKS) >= 2
    assert all(not cell.outputs and cell.execution_count is None for cell in code)
    nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert any("image/png" in output.get("data", {}) for output in outputs), "no picture is shown"
