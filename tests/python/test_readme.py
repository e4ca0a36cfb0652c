"""The README says what is true: its examples run, its commands exist."""

import re
from pathlib import Path

import pytest

from cgroup.registry import METHOD_INFO

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_python_blocks_run_one_after_another(capsys):
    blocks = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    assert len(blocks) >= 3
    namespace: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, "README.md", "exec"), namespace)
    assert "ransac Grouping(200 of 1000 selected)" in capsys.readouterr().out


# It reads records, which are made for it in test_extending_docs.py.
FRAGMENTS = {"benchmark"}
MADE_WITH_THE_SITE = {"_generated", "gallery", "api"}
PAGES = [
    page
    for page in sorted((ROOT / "docs").rglob("*.md"))
    if page.stem not in FRAGMENTS and not MADE_WITH_THE_SITE & set(page.parts)
]
# What pages show cgroup together with, and the tests do without where it isn't installed.
OTHERS = {"gtsam", "open3d", "rclpy", "small_gicp", "torch"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_python_blocks_of_the_docs_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, object] = {}
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    try:
        for block in blocks:
            exec(compile(block, page.name, "exec"), namespace)
    except ModuleNotFoundError as missing:
        if missing.name not in OTHERS:
            raise
        pytest.skip(f"the rest of the page needs {missing.name}")


def test_make_targets_exist():
    targets = set(
        re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)
    )
    named = set(re.findall(r"^ +make ([a-z]+)", README, flags=re.MULTILINE))
    assert {"demo", "test"} <= named <= targets


def test_method_table_is_that_of_the_registry():
    rows = re.findall(r"^\| \[?`(\w+)`(?:\]\(\S+\))? \|.*\| ([^|]+) \|$", README, flags=re.MULTILINE)
    assert rows == [(info.function.__name__, info.complexity) for info in METHOD_INFO.values()]
