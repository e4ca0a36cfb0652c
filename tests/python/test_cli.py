"""The command line: what it writes, and that whatever goes wrong is one line and an exit status."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest
from command_lines import run

import cgroup
from cgroup import METHODS, Correspondences, comparison, group
from cgroup.datasets import MatchingPair, standin_pair
from cgroup.io import (
    PointCloud,
    read_cloud,
    read_correspondences,
    read_descriptors,
    read_transform,
    write_cloud,
    write_correspondences,
    write_transform,
)
from cgroup.registration import describe
from cgroup.registry import label_of

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.usefixtures("elsewhere")


@pytest.fixture(scope="module")
def pair() -> MatchingPair:
    return standin_pair(pixels=80)


@pytest.fixture(scope="module")
def folder(pair: MatchingPair, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scans, their pose, and correspondences between other points."""
    path = tmp_path_factory.mktemp("input")
    write_cloud(path / "source.ply", pair.source)
    write_cloud(path / "target.ply", pair.target)
    write_transform(path / "truth.txt", pair.T_target_source)
    write_transform(path / "inverse.txt", np.linalg.inv(pair.T_target_source))
    rng = np.random.default_rng(0)
    source = rng.uniform(size=(60, 3))
    target = source + np.array([1, 2, 3])
    target[40:] = rng.uniform(size=(20, 3))
    write_correspondences(path / "some.npz", Correspondences(source, target))
    np.savetxt(path / "some.txt", np.hstack([source, target]))
    np.save(path / "nan.npy", np.full((30, 3), np.nan))
    np.save(path / "few.npy", rng.uniform(size=(4, 3)))
    write_cloud(path / "metres.ply", PointCloud(1e-3 * pair.source.points))
    (path / "empty.ply").write_bytes(b"")
    (path / "garbage.pcd").write_bytes(b"not a cloud\n" * 10)
    (path / "cut.ply").write_bytes((path / "source.ply").read_bytes()[:5000])
    (path / "scaled.txt").write_text("2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n")
    return path


def test_register(
    folder: Path, pair: MatchingPair, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = (folder / "source.ply", folder / "target.ply", "--method", "ransac", "--out", "result/here")
    status, out, err = run(capsys, "register", *arguments)
    assert (status, err) == (0, "")
    for word in ("points", "voxel", "matches", "overlap", "residual", "probability", "pose", "wrote"):
        assert word in out
    result = tmp_path / "result" / "here"
    pose = read_transform(result / "transform.txt")
    expected = pair.source.transformed(pose).points
    np.testing.assert_allclose(read_cloud(result / "aligned.ply").points, expected)
    matches = read_correspondences(result / "correspondences.npz")
    assert matches.ratio is not None
    assert (result / "registration.png").read_bytes().startswith(b"\x89PNG")


def test_compare(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = (folder / "source.ply", folder / "target.ply", "--truth", folder / "truth.txt")
    status, out, err = run(capsys, "compare", *arguments)
    assert (status, err) == (0, "")
    rows = list(csv.DictReader((tmp_path / "out" / "comparison.csv").read_text().splitlines()))
    assert [row["method"] for row in rows] == list(METHODS)
    for row in rows:
        assert label_of(row["method"]) in out
        assert 0 <= float(row["precision"]) <= 1
        assert float(row["milliseconds"]) > 0
    for name in ("comparison.png", "precision_recall.png"):
        assert (tmp_path / "out" / name).read_bytes().startswith(b"\x89PNG")
    assert "inverse" not in out


def test_compare_judges_the_matches_once(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[object] = []

    def judge(*arguments: object, **options: float) -> object:
        calls.append(arguments)
        return correct_matches(*arguments, **options)  # pyright: ignore[reportArgumentType]

    correct_matches = comparison.correct_matches
    monkeypatch.setattr(comparison, "correct_matches", judge)
    arguments = (folder / "source.ply", folder / "target.ply", "--truth", folder / "truth.txt")
    assert run(capsys, "compare", *arguments)[0] == 0
    # Under the truth, and at most once more under its inverse.
    poses = [arguments[2] for arguments in calls]
    assert len(poses) <= 2
    assert len({np.asarray(pose).tobytes() for pose in poses}) == len(poses)


def test_compare_notices_an_inverted_truth(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = (folder / "source.ply", folder / "target.ply", "--truth", folder / "inverse.txt")
    status, out, _ = run(capsys, "compare", *arguments)
    assert status == 0
    assert "would be correct under the inverse of this truth" in out


@pytest.mark.parametrize("name", ["some.npz", "some.txt"])
def test_group(name: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "group", folder / name, "--method", "gtm")
    assert (status, err) == (0, "")
    mask = np.load(tmp_path / "some_gtm.npy")
    expected = group(read_correspondences(folder / name), "gtm").mask
    np.testing.assert_array_equal(mask, expected)
    assert f"{mask.sum()} of 60 selected by GTM" in out


def test_group_takes_lengths(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, _, err = run(capsys, "group", folder / "some.txt", "--method", "gc")
    assert status == 2
    assert "resolution" in err
    assert "tolerance" in err
    for option in ("--resolution", "--tolerance"):
        status, _, err = run(
            capsys, "group", folder / "some.txt", "--method", "gc", option, "0.01", "--out", "mask.txt"
        )
        assert (status, err) == (0, "")
        assert np.loadtxt(tmp_path / "mask.txt").sum() >= 40


def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "demo", "--out", "pictures")
    assert (status, err) == (0, "")
    assert "GTM" in out
    for name in ("source.ply", "target.ply", "truth.txt", "comparison.csv", "comparison.png"):
        assert (tmp_path / "pictures" / name).exists()


WRONG = [
    ("register missing.ply {target}", "missing.ply: no such file"),
    ("register {folder} {target}", "is a directory, not a file"),
    ("register {folder}/empty.ply {target}", "empty.ply: the file is empty"),
    ("register {folder}/garbage.pcd {target}", "garbage.pcd: not a readable PCD file"),
    ("register {folder}/cut.ply {target}", "cut.ply: not a readable PLY file, or cut off"),
    ("register {folder}/nan.npy {target}", "nan.npy: none of its 30 points is finite"),
    ("register {folder}/few.npy {target}", "source: got 4 points"),
    ("register {source} {target} --method icp", "method: got 'icp'; choose one of ss, nnsr"),
    ("register {source} {target} --detector sift", "--detector"),
    ("register {source} {target} --descriptor fpfh3", "--descriptor"),
    ("register {source} {target} --normals mesh", "--normals: belongs to --front paper"),
    ("register {source} {target} --front paper --support 4", "--support: belongs to --front dense"),
    ("register {source} {target} --front paper --normals mesh", "neither cloud has faces"),
    ("register {folder}/metres.ply {target}", "scale them to the same unit"),
    ("register {source} {target} --voxel 0", "voxel: got 0"),
    ("register {source} {target} --voxel -1", "voxel: got -1"),
    ("register {source} {target} --voxel nan", "voxel: got nan"),
    ("register {source} {target} --voxel 1e-9", "give a larger voxel"),
    ("register {source} {target} --voxel 500", "leave 1 voxels of 500"),
    ("register {source} {target} --axis 0 0 0", "axis: got a zero vector"),
    ("register {source} {target} --axis 0 1", "--axis"),
    ("register {source} {target} --viewpoint 0 0 nan", "--viewpoint: got"),
    ("register {source} {target} --target-viewpoint 0 0 1e9", "--target-viewpoint: got"),
    ("register {source} {target} --effort max", "--effort"),
    ("register {source} {target} --front fast", "--front"),
    ("register {source} {target} --support 0", "support: got 0"),
    ("register {source} {target} --keypoints 1", "keypoints"),
    ("register {source} {target} --keypoints many", "keypoints"),
    ("register {source} {target} --out {source}", "can't be made a folder"),
    ("register {source}", "Missing argument"),
    ("register {source} {target} --frobnicate", "frobnicate"),
    ("compare {source} {target}", "--truth"),
    ("compare {source} {target} --truth missing.txt", "missing.txt: no such file"),
    ("compare {source} {target} --truth {folder}/scaled.txt", "scaled or sheared, not a rotation"),
    ("compare {source} {target} --truth {source}", "source.ply"),
    ("group missing.npz", "missing.npz: no such file"),
    ("group {source}", "source.ply"),
    ("group {folder}/some.npz --method gtm --tolerance 1", "tolerance"),
    ("group {folder}/some.npz --method ss", "similarity"),
    ("group {folder}/some.npz --method cv", "ratio"),
    ("group {folder}/some.npz --method gc --resolution -1", "resolution"),
    ("group {folder}/some.npz --method gc --resolution nan", "resolution"),
    ("group {folder}/some.npz --out nowhere/mask.npy", "can't be written"),
    ("demo --seed -1", "seed"),
    ("frobnicate", "frobnicate"),
]


@pytest.mark.parametrize(("line", "says"), WRONG, ids=[line for line, _ in WRONG])
def test_wrong_input_is_one_line_and_status_2(
    line: str, says: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = {"folder": folder, "source": folder / "source.ply", "target": folder / "target.ply"}
    status, out, err = run(capsys, *(word.format(**names) for word in line.split()))
    assert status == 2
    assert out == ""
    assert err.count("\n") == 1
    assert err.startswith("cgroup: ")
    assert says in err


def test_no_pose_is_one_line_and_status_3(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_cloud(tmp_path / "other.ply", standin_pair(seed=5, pixels=60).target)
    status, out, err = run(capsys, "register", folder / "source.ply", tmp_path / "other.ply")
    assert (status, out) == (3, "")
    assert err.startswith("cgroup: no pose that can be trusted: ")
    assert err.count("\n") == 1
    assert not (tmp_path / "out" / "transform.txt").exists()


@pytest.mark.parametrize("arguments", [(), ("--help",)])
def test_help_names_the_commands(arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, *arguments)
    assert (status, err) == (0, "")
    for command in ("register", "compare", "group", "demo"):
        assert command in out


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "--version") == (0, f"cgroup {cgroup.__version__}\n", "")


# --- as a process of its own ---------------------------------------------------------------------


def test_detect(folder: Path, pair: MatchingPair, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = (folder / "source.ply", "--detector", "iss", "--keypoints", 100, "--out", "kp")
    status, out, err = run(capsys, "detect", *arguments)
    assert (status, err) == (0, "")
    with np.load(tmp_path / "kp/keypoints.npz") as file:
        found = dict(file)
    assert np.array_equal(found["points"], pair.source.points[found["indices"]])
    assert 80 <= len(found["indices"]) <= 120
    assert f"keypoints   {len(found['indices'])} by ISS" in out
    colors = read_cloud(tmp_path / "kp/keypoints.ply").colors
    assert colors is not None
    assert np.array_equal(np.flatnonzero(colors[:, 0] != colors[:, 1]), found["indices"])
    assert (tmp_path / "kp/keypoints.png").read_bytes().startswith(b"\x89PNG")


def test_describe(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = (folder / "source.ply", "--descriptor", "rcs", "--nms-radius", 4, "--out", "kp")
    status, out, err = run(capsys, "describe", *arguments)
    assert (status, err) == (0, "")
    written = read_descriptors(tmp_path / "kp/descriptors.npz")
    expected = describe(read_cloud(folder / "source.ply"), descriptor="rcs", nms_radius=4)
    for name in ("indices", "points", "lrf", "descriptors", "centroid"):
        assert np.array_equal(getattr(written, name), getattr(expected, name))
    assert written.resolution == expected.resolution
    assert "RCS, 72 numbers each" in out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--resolution", 0), "resolution: got 0"),
        (("--resolution", 500), "the whole cloud is"),
        (("--nms-radius", -1), "--nms-radius: got -1"),
    ],
)
def test_detect_says_what_is_wrong(
    arguments: tuple, says: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, err = run(capsys, "detect", folder / "source.ply", *arguments)
    assert (status, out) == (2, "")
    assert says in err


READY = "from cgroup.cli import main; print('ready', flush=True); main()"
# Says so when the first function of the compiled core is called.
COMPUTING = """
import sys
from cgroup import _core
from cgroup.cli import main

def look(_frame, event, function):
    if event == "c_call" and getattr(function, "__self__", None) is _core:
        sys.setprofile(None)
        print("computing", flush=True)

sys.setprofile(look)
main()
"""


def process(*arguments: object, code: str = READY, **options: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)  # pyright: ignore[reportCallIssue]


def test_exit_status_of_the_process(folder: Path) -> None:
    failing = process("register", "missing.ply", folder / "target.ply")
    out, err = failing.communicate(timeout=60)
    assert (failing.returncode, out) == (2, "ready\n")
    assert err == "cgroup: missing.ply: no such file\n"
    working = process("group", folder / "some.npz")
    out, err = working.communicate(timeout=60)
    assert (working.returncode, err) == (0, "")
    assert "selected by GTM" in out


@pytest.mark.skipif(os.name == "nt", reason="interrupts are sent differently there")
def test_interrupt_is_one_line_and_status_130(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    many = Correspondences(rng.uniform(size=(50_000, 3)), rng.uniform(size=(50_000, 3)))
    write_correspondences(tmp_path / "many.npz", many)
    running = process("group", tmp_path / "many.npz", "--method", "st", code=COMPUTING)
    assert running.stdout is not None
    assert running.stdout.readline() == "computing\n"
    assert running.poll() is None, "the work was over before it could be interrupted"
    running.send_signal(signal.SIGINT)
    _, err = running.communicate(timeout=20)
    assert (running.returncode, err) == (130, "cgroup: interrupted\n")
