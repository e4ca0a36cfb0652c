"""No output replaces an input, no older result stays behind a refusal, and a file is written whole or not at all."""

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from command_lines import fail, results_in, run, succeed, write_inputs

from cgroup import InputError
from cgroup.datasets import standin_pair
from cgroup.io import read_cloud, write_cloud, write_file

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="modes and links are Unix's")
Capture = pytest.CaptureFixture[str]


@pytest.fixture(name="folder")
def inputs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_inputs(tmp_path)
    return tmp_path


def test_the_second_step_of_a_chain_keeps_its_input(folder: Path, capsys: Capture) -> None:
    succeed(capsys, "register", "source.ply", "target.ply")
    aligned = folder / "out" / "source_on_target_aligned.ply"
    before = {file: file.read_bytes() for file in aligned.parent.glob("[!.]*")}
    succeed(capsys, "register", aligned, "target.ply")
    assert {file: file.read_bytes() for file in before} == before
    assert (folder / "out" / "source_on_target_aligned_on_target.txt").exists()


def test_poses_of_several_pairs_share_a_folder(folder: Path, capsys: Capture) -> None:
    succeed(capsys, "register", "source.ply", "target.ply")
    pose = folder / "out" / "source_on_target.txt"
    before = pose.read_bytes()
    succeed(capsys, "register", "target.ply", "source.ply")
    (folder / "other").mkdir()
    for name in ("source.ply", "target.ply"):
        (folder / "other" / name).write_bytes((folder / name).read_bytes())
    said = fail(capsys, "register", "other/source.ply", "other/target.ply")
    assert "source_on_target.txt: is not the pose of these clouds; rename it, or give another" in said
    assert pose.read_bytes() == before
    write_cloud("source.ply", np.random.default_rng(0).normal(size=(3000, 3)) * 50)
    assert run(capsys, "register", "source.ply", "target.ply")[0] == 3
    assert [file.name for file in pose.parent.glob("*.txt")] == ["target_on_source.txt"]


def test_long_names_are_cut_in_that_of_the_pair(folder: Path, capsys: Capture) -> None:
    name = "wolkenwand-" * 12 + "\N{CLOUD}" * 20
    (folder / f"{name}.ply").write_bytes((folder / "source.ply").read_bytes())
    succeed(capsys, "register", f"{name}.ply", "target.ply")
    assert (folder / "out" / f"{name[:100]}_on_target.txt").exists()


@POSIX
@pytest.mark.parametrize("link", [os.link, os.symlink])
def test_inputs_are_known_by_other_names_too(folder: Path, capsys: Capture, link) -> None:
    (folder / "out").mkdir()
    link(folder / "source.ply", folder / "out" / "source_on_target_aligned.ply")
    before = (folder / "source.ply").read_bytes()
    assert "is one of the inputs" in fail(capsys, "register", "source.ply", "target.ply")
    assert (folder / "source.ply").read_bytes() == before


def test_models_are_not_replaced_by_their_posed_copies(folder: Path, capsys: Capture) -> None:
    (folder / "source_in_target.ply").write_bytes((folder / "source.ply").read_bytes())
    models = ("source.ply", "source_in_target.ply")
    before = [(folder / name).read_bytes() for name in models]
    said = fail(capsys, "recognize", *models, "--scene", "target.ply", "--out", ".")
    assert "source_in_target.ply: is one of the inputs" in said
    assert [(folder / name).read_bytes() for name in models] == before


def test_a_refusal_leaves_no_older_pose_behind(folder: Path, capsys: Capture) -> None:
    succeed(capsys, "register", "source.ply", "target.ply", "--html")
    (folder / "out" / "notes.txt").write_text("mine")
    write_cloud("target.ply", np.random.default_rng(0).normal(size=(3000, 3)) * 50)
    status, _, _ = run(capsys, "register", "source.ply", "target.ply")
    assert status == 3
    assert results_in(folder / "out") == ["notes.txt"]


def test_models_that_are_not_found_leave_no_older_pose_behind(folder: Path, capsys: Capture) -> None:
    out = folder / "out"
    succeed(capsys, "recognize", "source.ply", "--scene", "target.ply")
    file = out / "source_in_target.txt"
    pose = file.read_text()
    assert pose.endswith(f"# pose of {folder / 'source.ply'} in the frame of {folder / 'target.ply'}\n")
    file.write_text("mine")
    assert "is not the pose of these clouds" in fail(
        capsys, "recognize", "source.ply", "--scene", "target.ply"
    )
    assert file.read_text() == "mine"
    file.write_text(pose)
    mine = {f"source_in_target{ending}" for ending in ("-1.txt", "-2.txt", "-2.ply", "-4.ply", "-b.txt")}
    for name in mine:
        (out / name).write_text(pose)
    succeed(capsys, "recognize", "source.ply", "--scene", "target.ply")
    assert {*results_in(out)} == {*mine, "source_in_target.txt", "source_in_target.ply"}
    write_cloud("target.ply", standin_pair(seed=5, pixels=60).target)
    assert run(capsys, "recognize", "source.ply", "--scene", "target.ply")[0] == 3
    assert {*results_in(out)} == mine


def test_a_copy_is_not_called_as_another_model(folder: Path, capsys: Capture) -> None:
    """Nor is what was found of one removed as an older copy of the other."""
    (folder / "source-2.ply").write_bytes((folder / "source.ply").read_bytes())
    source, target = read_cloud("source.ply").points, read_cloud("target.ply").points
    write_cloud("twice.ply", np.concatenate([target, target + np.array([3 * np.ptp(source[:, 0]), 0, 0])]))
    said = json.loads(
        succeed(capsys, "recognize", "source.ply", "source-2.ply", "--scene", "twice.ply", "--json")
    )
    files = [one["file"] for one in said["results"]["found"]]
    assert len(files) == len(set(files)) == 2
    assert {*results_in(folder / "out")} == {
        *files, *(file.replace(".txt", ".ply") for file in files),
    }  # fmt: skip


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "pose.txt"
    write_file(file, b"old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(InputError, match="pose.txt: can't be written \\(No space left on device\\)"):
            write_file(file, b"new")
    assert file.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [file]
    write_file(file, b"new")
    assert file.read_bytes() == b"new"


@POSIX
def test_modes_stay(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    write_file(file, b"1")
    file.chmod(0o640)
    write_file(file, b"2")
    assert (file.read_bytes(), file.stat().st_mode & 0o777) == (b"2", 0o640)
    fresh = tmp_path / "b.txt"
    write_file(fresh, b"")
    plain = tmp_path / "c.txt"
    plain.touch()
    assert fresh.stat().st_mode == plain.stat().st_mode
