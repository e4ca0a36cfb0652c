"""``cgroup recognize``: what it prints, what it writes, and how it ends."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import command_lines
import numpy as np
import pytest
import trimesh
from scenes import stone_model, stone_scene

if TYPE_CHECKING:
    from pathlib import Path

from cgroup.io import read_cloud, read_transform, write_cloud


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("models")
    for seed in (1, 2, 3):
        model = stone_model(seed)
        trimesh.Trimesh(model.points, model.faces, process=False).export(path / f"stone{seed}.ply")
    write_cloud(path / "scene.ply", stone_scene([1, 2, 1])[0])
    write_cloud(path / "bare.ply", stone_scene([3])[0])
    (path / "again").mkdir()
    (path / "again" / "stone1.ply").write_bytes((path / "stone1.ply").read_bytes())
    return path


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    return command_lines.run(capsys, "recognize", *arguments)


def test_prints_and_writes_what_is_there(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)  # lines of long paths would be broken
    models = [f"stone{seed}.ply" for seed in (1, 2, 3)]
    options = ["--scene", "scene.ply", "--viewpoint", 0, 0, 0, "--out", "found"]
    status, out, err = run(capsys, *models, *options)
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert lines[1].split("  ")[0] == "model"
    rows = [re.split(r"  +", line) for line in lines[2:6]]
    assert [row[:2] for row in rows] == [
        ["stone1", "1 of 2"],
        ["stone1", "2 of 2"],
        ["stone2", "yes"],
        ["stone3", "no"],
    ]
    assert all(float(row[2]) > 0.9 and 0 < float(row[3]) <= 100 for row in rows[:3])
    names = sorted(file.name for file in (folder / "found").iterdir())
    assert names == ["stone1-2.ply", "stone1-2.txt", "stone1.ply", "stone1.txt", "stone2.ply", "stone2.txt"]
    assert all(name in out for name in names)
    pose = read_transform(folder / "found" / "stone2.txt")
    posed = read_cloud(folder / "found" / "stone2.ply")
    np.testing.assert_allclose(posed.points, stone_model(2).transformed(pose).points, rtol=1e-4, atol=1e-2)


def test_nothing_found_is_status_3(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = (folder / "stone3.ply", "--scene", folder / "scene.ply", "--out", tmp_path / "found")
    status, out, err = run(capsys, *arguments)
    assert status == 3
    assert "no" in out
    assert err.startswith(
        "cgroup: none of the models was found in scene.ply; if the scene is one single scan"
    )
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "found").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            "{folder}/stone1.ply {folder}/again/stone1.ply --scene {folder}/scene.ply",
            "two files named 'stone1'",
        ),
        ("{folder}/bare.ply --scene {folder}/scene.ply --viewpoint 0 0 0", "neither faces nor normals"),
        ("{folder}/stone1.ply", "--scene"),
        ("--scene {folder}/scene.ply", "Missing argument"),
        ("{folder}/stone1.ply --scene {folder}/scene.ply --most 0", "most"),
        ("{folder}/stone1.ply --scene {folder}/scene.ply --voxel 1e9", "voxel"),
    ],
)
def test_bad_input_is_status_2_and_one_line(
    arguments: str, words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, err = run(capsys, *arguments.format(folder=folder).split())
    assert status == 2
    assert words in err
    assert len(err.splitlines()) == 1
