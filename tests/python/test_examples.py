"""Every example and notebook runs as a user would run it; notebooks are kept without their outputs."""

import importlib
import io
import os
import re
import runpy
import subprocess
import sys
import tarfile
import urllib.request
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


def run_on_the_bunny(capsys: pytest.CaptureFixture[str]) -> str:
    """Return what the example with real scans prints; it registers them as Stanford did."""
    runpy.run_path(str(EXAMPLES / "register_real_scans.py"))
    printed = capsys.readouterr().out
    assert float(re.search(r"Difference ([\d.]+) degrees", printed)[1]) < 0.2
    assert "stone" not in printed
    return printed


def test_real_scans_are_read_from_a_folder_with_data(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CGROUP_DATA", str(data_folder("stanford_views")))
    monkeypatch.chdir(tmp_path)
    run_on_the_bunny(capsys)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["registration.html"]


def test_real_scans_are_downloaded_once_and_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bunny = data_folder("stanford_views") / "stanford_views" / "bunny"
    files = {
        name: (bunny / name).read_bytes().replace(b"\n", b"\r\n")  # as some copies have them
        for name in ("bun000.ply", "bun045.ply", "bun.conf")
    }

    def serve(_address: str, **_options: float) -> io.BytesIO:
        archive = io.BytesIO()
        with tarfile.open(fileobj=archive, mode="w:gz") as packed:
            for name, content in files.items():
                member = tarfile.TarInfo(f"bunny/data/{name}")
                member.size = len(content)
                packed.addfile(member, io.BytesIO(content))
        return io.BytesIO(archive.getvalue())

    monkeypatch.delenv("CGROUP_DATA", raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(urllib.request, "urlopen", serve)
    right, files["bun045.ply"] = files["bun045.ply"], b"something else"
    runpy.run_path(str(EXAMPLES / "register_real_scans.py"))
    assert "bun045.ply has changed. A generated stone replaces" in capsys.readouterr().out
    files["bun045.ply"] = right
    run_on_the_bunny(capsys)
    monkeypatch.delattr(urllib.request, "urlopen")
    run_on_the_bunny(capsys)


def test_the_home_page_tells_what_its_picture_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    root = data_folder("stanford_views")
    docs = EXAMPLES.parent / "docs"
    monkeypatch.syspath_prepend(docs / "figures")
    panels = importlib.import_module("home").Panels(root)
    page = (docs / "index.md").read_text(encoding="utf-8")
    for name in ("matches", "group"):
        numbers = re.findall(r"[\d,]+\d", panels.draw(name)[2])
        assert len(numbers) == 2
        assert all(number in page for number in numbers)


# Jupyter's own libraries warn of each other.
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs_and_is_kept_without_outputs(path: Path, tmp_path: Path) -> None:
    nbformat, nbclient = (pytest.importorskip(name, **NEEDED) for name in ("nbformat", "nbclient"))
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert code
    assert all(not cell.outputs and cell.execution_count is None for cell in code)
    nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert any("image/png" in output.get("data", {}) for output in outputs), "no picture is shown"


def test_there_are_notebooks() -> None:
    assert len(NOTEBOOKS) >= 2
