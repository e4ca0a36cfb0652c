"""Printed poses reproduce where they move a cloud, near the origin and far from it, in few digits where these do."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from command_lines import succeed
from hypothesis import example, given
from hypothesis import strategies as st

from cgroup._show.words import pose_lines
from cgroup.datasets import standin_pair
from cgroup.io import read_cloud, write_cloud
from cgroup.rigid import apply, invert
from cgroup.rigid.transforms import turn
from cgroup.types import FloatArray

UTM = np.array([431_287.25, 5_412_093.5, 312.0])


def shifted(by: FloatArray) -> FloatArray:
    pose = np.eye(4)
    pose[:3, 3] = by
    return pose


def parse(lines: list[str]) -> FloatArray:
    return np.array([[float(word) for word in line.split()] for line in lines])


@given(st.integers(0, 2**32 - 1), st.floats(-4, 7), st.floats(-4, 4), st.floats(-3, 3))
@example(seed=0, away=6.7, extent=2.0, scale=0.0)
def test_printed_poses_move_clouds_to_the_same_place(
    seed: int, away: float, extent: float, scale: float
) -> None:
    rng = np.random.default_rng(seed)
    points = 10**extent * rng.uniform(-0.5, 0.5, (50, 3)) + 10**away * rng.normal(size=3)
    quaternion = rng.normal(size=4)
    pose = np.eye(4)
    pose[:3, :3] = 10**scale * turn(*(quaternion / np.linalg.norm(quaternion)))
    pose[:3, 3] = 10**away * rng.normal(size=3) + 10**extent * rng.normal(size=3)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    read = parse(pose_lines(pose, points.mean(axis=0), size))
    rounding = (
        20 * np.finfo(float).eps * (np.abs(apply(pose, points)).max() + 10**scale * np.abs(points).max())
    )
    assert np.linalg.norm(points @ (read - pose)[:3, :3].T + (read - pose)[:3, 3], axis=1).max() <= (
        1e-9 * 10**scale * size + rounding
    )
    np.testing.assert_array_equal(parse(pose_lines(pose)), pose)


@given(st.integers(0, 2**32 - 1), st.floats(-1, 4))
def test_printed_poses_of_georeferenced_clouds_are_exact(seed: int, extent: float) -> None:
    rng = np.random.default_rng(seed)
    quaternion = rng.normal(size=4)
    pose = shifted(UTM + rng.normal(size=3))
    pose[:3, :3] = turn(*(quaternion / np.linalg.norm(quaternion)))
    np.testing.assert_array_equal(parse(pose_lines(pose, UTM, 10**extent)), pose)
    np.testing.assert_array_equal(parse(pose_lines(pose, np.zeros(3), 10**extent)), pose)


def test_few_digits_suffice_near_the_origin() -> None:
    assert pose_lines(np.eye(4), np.zeros(3), 1.0)[0].split() == ["1", "0", "0", "0"]
    pose = shifted(np.array([1 / 3, -1e-14, 0.25]))
    pose[:3, :3] = turn(0.0, 0.0, np.sin(0.1), np.cos(0.1))
    words = [line.split() for line in pose_lines(pose, np.zeros(3), 100.0)]
    assert [row[3] for row in words] == ["0.33333333", "0", "0.25", "1"]
    assert all(len(word) <= 14 for row in words for word in row)


@pytest.mark.parametrize("command", ["register", "group"])
def test_commands_and_pages_print_poses_of_georeferenced_clouds(
    elsewhere: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    pair, there = standin_pair(pixels=60), shifted(UTM)
    write_cloud("source.ply", pair.source.transformed(there))
    write_cloud("target.ply", pair.target.transformed(there))
    points = read_cloud("source.ply").points
    line: tuple[str, ...] = ("register", "source.ply", "target.ply", "--html")
    if command == "group":
        true = there @ pair.T_target_source @ invert(there)
        np.savetxt("matches.txt", np.hstack([points, apply(true, points)])[::40], fmt="%.9f")
        line = ("group", "matches.txt")
    said = succeed(capsys, *line).splitlines()
    first = next(row for row, text in enumerate(said) if text.startswith("pose of the"))
    printed = parse(said[first + 1 : first + 5])
    found = json.loads(succeed(capsys, *line, "--json"))["results"]
    pose = np.array(found["T_target_source"])
    within = 2e-9 * np.linalg.norm(np.ptp(points, axis=0)) + 1e-8  # rounding of either product
    assert np.abs(apply(printed, points) - apply(pose, points)).max() < within
    if command == "register":
        page = (elsewhere / "out/source_on_target.html").read_text(encoding="utf-8")
        shown = re.search(r"<pre>(.*?)</pre>", page, re.DOTALL)
        assert shown is not None
        assert np.abs(apply(parse(shown[1].splitlines()), points) - apply(pose, points)).max() < within
