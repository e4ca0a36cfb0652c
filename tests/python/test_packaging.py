"""What is built and uploaded: versions agree, gaps are seen, and without Rust there is one sentence."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tools"))

import absolute_links  # noqa: E402
import check_version  # noqa: E402
import check_wheels  # noqa: E402


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """The files that name the version."""
    for name in [*check_version.PLACES, "Cargo.toml", "CHANGELOG.md"]:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    return tmp_path


@pytest.mark.parametrize("name", check_version.PLACES)
def test_another_version_is_named(copied: Path, name: str):
    text = (copied / name).read_text(encoding="utf-8")
    (copied / name).write_text(text.replace(check_version.read_version(), "9.9.9"), encoding="utf-8")
    differences = check_version.find_differences(copied)
    assert differences
    assert all(line.startswith(f"{name}: 9.9.9, but Cargo.toml has ") for line in differences)


def test_a_tag_needs_its_section_of_the_changelog(copied: Path):
    version, changelog = check_version.read_version(copied), copied / "CHANGELOG.md"
    changelog.write_text(f"# Changelog\n\n## {version} - 2026-01-02\n\n- News.\n\n## 0.0.1 - 2025-01-02\n")
    assert check_version.find_differences(copied, f"refs/tags/v{version}") == []
    assert check_version.find_differences(copied, "refs/tags/v9.9.9")[0].startswith("tag: v9.9.9")
    assert check_version.read_notes(copied) == "- News.\n"
    changelog.write_text("# Changelog\n\n## Unreleased\n")
    assert "CHANGELOG.md" in check_version.find_differences(copied, f"refs/tags/v{version}")[0]


NAMES = [
    f"cgroup-1.2.3-{python}-{system}.whl"
    for python in check_wheels.PYTHONS
    for system in [
        "manylinux_2_17_x86_64.manylinux2014_x86_64",
        "manylinux_2_28_aarch64",
        "musllinux_1_2_x86_64",
        "musllinux_1_2_aarch64",
        "macosx_10_12_x86_64",
        "macosx_11_0_arm64",
        "win_amd64",
    ]
] + ["cgroup-1.2.3.tar.gz"]


def test_a_missing_file_is_a_gap():
    assert check_wheels.find_gaps(NAMES) == []
    for name in NAMES:
        assert len(check_wheels.find_gaps([other for other in NAMES if other != name])) == 1


@pytest.mark.parametrize(
    ("programs", "why"),
    [
        ({}, "there is no `cargo` on the PATH"),
        ({"cargo": "cargo 1.85.0", "rustc": "rustc 1.85.0 (4d91de4e4)"}, "this is rustc 1.85.0 (4d91de4e4)"),
        ({"cargo": "cargo", "rustc": "error: no default is set"}, "answers 'error: no default is set'"),
    ],
)
@pytest.mark.skipif(os.name == "nt", reason="the stand-ins for Rust are shell scripts")
def test_without_rust_a_build_ends_with_one_sentence(tmp_path: Path, programs: dict[str, str], why: str):
    pytest.importorskip("maturin")
    for name, answer in programs.items():
        (tmp_path / name).write_text(f"#!/bin/sh\necho '{answer}'\n")
        (tmp_path / name).chmod(0o755)
    for hook in ("get_requires_for_build_wheel()", f"build_wheel({str(tmp_path)!r})"):
        done = subprocess.run(
            [sys.executable, "-c", f"import build_backend; build_backend.{hook}"],
            cwd=ROOT,
            env={"PATH": str(tmp_path), "PYTHONPATH": str(ROOT / "tools")},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 1
        assert done.stderr.count("\n") == 1
        assert re.match(
            r"cgroup can't be built: .*Rust 1\.\d+ or newer.*https://rustup\.rs.*\.\n", done.stderr
        )
        assert why in done.stderr


def test_no_link_of_the_readme_is_left_relative():
    text = absolute_links.make_absolute((ROOT / "README.md").read_text(encoding="utf-8"), ROOT)
    assert all(re.match("https?:|#", link) for link in re.findall(r"\]\(([^)]+)\)", text))
    assert "methods/choose.html" in text


def test_tests_of_wheels_exist():
    for line in (ROOT / "tests/python/wheel_tests.txt").read_text(encoding="utf-8").splitlines():
        assert (ROOT / line).is_file()
