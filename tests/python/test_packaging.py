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

PYPROJECT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
WORKFLOW = ROOT / ".github/workflows/ci.yml"


def test_one_version_everywhere():
    assert check_version.find_differences() == []


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


def test_a_whole_release_has_no_gap():
    assert check_wheels.find_gaps(NAMES) == []


@pytest.mark.parametrize("name", NAMES)
def test_a_missing_file_is_a_gap(name: str):
    assert len(check_wheels.find_gaps([other for other in NAMES if other != name])) == 1


@pytest.mark.parametrize(
    "text",
    [b"\0/root/.cargo/registry/src/lib.rs\0", b"C:\\Users\\me\\.cargo\\x", b"D:\\a\\cgroup\\cgroup\\rust"],
)
def test_folders_of_machines_are_seen(text: bytes):
    assert check_wheels.FOLDER.search(text)


@pytest.mark.parametrize(
    ("programs", "why"),
    [
        ({}, "there is no `cargo` on the PATH"),
        ({"cargo": "cargo 1.95.0"}, "there is no `rustc` on the PATH"),
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
    hooks = ["get_requires_for_build_wheel()", f"prepare_metadata_for_build_wheel({str(tmp_path)!r})"]
    for hook in [*hooks, f"build_wheel({str(tmp_path)!r})"]:
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


def test_classifiers_are_the_pythons_that_wheels_are_tested_on():
    promised = re.findall(r"Python :: 3\.(\d+)", PYPROJECT)
    assert re.findall(r'"cp3(\d+)-\*"', PYPROJECT) == promised
    assert f'requires-python = ">=3.{promised[0]}"' in PYPROJECT


@pytest.mark.parametrize(
    ("link", "address"),
    [
        ("[gc](docs/methods/gc.md)", "https://cgroup-project.github.io/cgroup/methods/gc.html"),
        (
            "[speed](docs/performance.md#time)",
            "https://cgroup-project.github.io/cgroup/performance.html#time",
        ),
        ("[more](examples)", "https://github.com/cgroup-project/cgroup/tree/main/examples"),
        ("[code](CONTRIBUTING.md)", "https://github.com/cgroup-project/cgroup/blob/main/CONTRIBUTING.md"),
        (
            "![two scans](docs/images/home.png)",
            "https://raw.githubusercontent.com/cgroup-project/cgroup/main/docs/images/home.png",
        ),
    ],
)
def test_links_of_the_readme_are_absolute_where_they_are_published(link: str, address: str):
    absolute = absolute_links.make_absolute(f"See {link}.", ROOT)
    assert absolute == f"See {link.partition('](')[0]}]({address})."
    assert absolute_links.make_absolute(absolute, ROOT) == absolute


def test_no_link_of_the_readme_is_left_relative():
    text = absolute_links.make_absolute((ROOT / "README.md").read_text(encoding="utf-8"), ROOT)
    assert all(re.match("https?:|#", link) for link in re.findall(r"\]\(([^)]+)\)", text))
    assert "methods/choose.html" in text


def test_tests_of_wheels_exist():
    for line in (ROOT / "tests/python/wheel_tests.txt").read_text(encoding="utf-8").splitlines():
        assert (ROOT / line).is_file()


@pytest.mark.skipif(not WORKFLOW.exists(), reason="the source distribution has no workflows")
def test_hosted_checks_are_those_of_a_change():
    steps = re.findall(r"^make (.+)$", (ROOT / ".ci/run").read_text(encoding="utf-8"), re.MULTILINE)
    (targets,) = re.findall(r"target: \[(.+)\]", WORKFLOW.read_text(encoding="utf-8"))
    assert targets.split(", ") == steps
