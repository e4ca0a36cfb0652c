"""Recordings of ROS 2: clouds that are read, and located in a map."""

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="pip install 'cgroup[ros]'")

from bag_files import cloud_message, write_bag
from command_lines import fail, succeed
from test_io_mutations import mutate

from cgroup.datasets import standin_pair
from cgroup.errors import InputError
from cgroup.io import read_transforms, write_cloud
from cgroup.io.bags import read_bag
from cgroup.rigid import rotation_error

POINTS = np.array([[1.0, 2, 3], [np.nan, 0, 0], [4, 5, 6], [0, np.inf, 0]])


@pytest.mark.parametrize("mcap", [True, False])
@pytest.mark.parametrize("big", [True, False])
@pytest.mark.parametrize("kind", ["f4", "f8"])
def test_clouds_are_read(tmp_path: Path, mcap: bool, big: bool, kind: str) -> None:
    messages = [cloud_message(POINTS + row, 5.25 + row, big=big, kind=kind) for row in range(3)]
    path = write_bag(tmp_path / "bag", {"/points": messages}, mcap=mcap)
    for each in (path, tmp_path / "bag"):
        read = list(read_bag(each))
        assert [time for time, _ in read] == [5.25, 6.25, 7.25]
        for row, (_, cloud) in enumerate(read):
            np.testing.assert_array_equal(
                cloud.points, [[1.0 + row, 2 + row, 3 + row], [4 + row, 5 + row, 6 + row]]
            )
            assert cloud.dropped == 2


def test_topics(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", {"/a": [cloud_message(POINTS)], "/b": [cloud_message(POINTS[:1])]})
    assert [len(cloud.points) for _, cloud in read_bag(path, "/b")] == [1]
    with pytest.raises(InputError, match="clouds of several topics; give one of /a, /b"):
        next(read_bag(path))
    with pytest.raises(InputError, match="topic '/c' has no clouds, but /a, /b"):
        next(read_bag(path, "/c"))
    with pytest.raises(InputError, match="no such file"):
        next(read_bag(tmp_path / "no.mcap"))


@pytest.mark.parametrize(
    "changed",
    [
        {"width": 2**31},
        {"height": 2**31, "row_step": 0},
        {"point_step": 0},
        {"point_step": 3},
        {"fields": []},
    ],
)
def test_lying_messages_are_refused(tmp_path: Path, changed: dict[str, object]) -> None:
    path = write_bag(tmp_path / "bag", {"/points": [cloud_message(POINTS), cloud_message(POINTS, **changed)]})
    clouds = read_bag(path)
    next(clouds)
    with pytest.raises(InputError, match=r"\.mcap: message 2: "):
        next(clouds)


@pytest.mark.parametrize("seed", range(60))
def test_changed_recordings_are_read_or_refused(tmp_path: Path, seed: int) -> None:
    path = write_bag(tmp_path / "bag", {"/points": [cloud_message(POINTS)] * 2}, mcap=seed % 2 == 0)
    path.write_bytes(mutate(np.random.default_rng(seed), path.read_bytes()))
    try:
        list(read_bag(path))
    except InputError as error:
        message = str(error)
    else:
        message = ""
    assert not message or (message.startswith(str(path)) and message.isprintable())


def test_a_recording_is_located(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    pair = standin_pair(seed=1, pixels=100)
    write_cloud("map.ply", pair.target)
    empty = cloud_message(np.empty((0, 3)), 11.0)
    scans = [cloud_message(pair.source.points, 10.5), empty, cloud_message(pair.source.points, 12.0)]
    path = write_bag(tmp_path / "drive", {"/points": scans})
    done = json.loads(succeed(capsys, "locate", path, "--map", "map.ply", "--out", "placed", "--json"))
    found = done["results"]["scans"]
    assert [scan["ok"] for scan in found] == [True, False, True]
    assert np.shape(found[0]["covariance"]) == (6, 6)
    tum, facts = f"placed/{path.stem}_in_map.tum", f"placed/{path.stem}_in_map.json"
    assert done["files"] == [facts, tum]
    poses = read_transforms(tum)
    assert [float(line.split()[0]) for line in Path(tum).read_text().splitlines()] == [10.5, 12.0]
    assert all(rotation_error(pose, pair.T_target_source) < 0.5 for pose in poses)
    assert json.loads(Path(facts).read_text())["scans"] == found
    assert "topic" in fail(capsys, "locate", "map.ply", "--map", "map.ply", "--topic", "/points")
    assert "html" in fail(capsys, "locate", path, "--map", "map.ply", "--html")
