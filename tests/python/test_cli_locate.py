"""``cgroup locate``: what it prints, writes and refuses. Locating is tested elsewhere."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_lines import fail, run, succeed, undocumented

from cgroup.cli.commands import locate
from cgroup.datasets import standin_pair
from cgroup.io import read_cloud, read_transform, write_cloud
from cgroup.rigid import apply, rotation_error

Capture = pytest.CaptureFixture[str]
PAIR = standin_pair(seed=1, pixels=100)
ORIGIN = PAIR.T_target_source[:3, 3]
LINE = ("locate", "scan.ply", "--map", "map.ply")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    write_cloud("scan.ply", PAIR.source)
    write_cloud("map.ply", PAIR.target)
    return tmp_path


def write_twice(name: str) -> None:
    """Write a map that shows the same in two places."""
    points = PAIR.target.points
    shift = np.array([1.5 * np.ptp(points[:, 0]), 0, 0])
    write_cloud(name, np.concatenate([points, points + shift]))


def test_a_scan_is_located(folder: Path, capsys: Capture) -> None:
    out = succeed(capsys, *LINE, "--out", "placed")
    pose = read_transform("placed/scan_in_map.txt")
    assert rotation_error(pose, PAIR.T_target_source) < 0.5
    assert np.linalg.norm(pose[:3, 3] - ORIGIN) < 2.0
    assert Path("placed/scan_in_map.txt").read_text().endswith(f"{folder / 'map.ply'}\n")
    lines = out.splitlines()
    assert lines[0] == f"scan        scan.ply: {len(PAIR.source)} points"
    assert lines[1] == f"map         map.ply: {len(PAIR.target)} points"
    assert lines[2].startswith("voxels      883 of 3.23")
    assert lines[3] == "places      1"
    assert "% of the scan overlaps the map\n" in out
    assert "\npose of the scan in the map's frame\n" in out
    assert "target" not in out
    assert lines[-2:] == ["wrote placed/scan_in_map.txt", "wrote placed/scan_in_map_aligned.ply"]
    moved = read_cloud("placed/scan_in_map_aligned.ply").points
    assert np.allclose(moved, apply(pose, PAIR.source.points), atol=1e-3)


def test_a_map_is_kept_and_opened(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    out = succeed(capsys, *LINE, "--voxel", 4, "--save-map", "maps/kept")
    assert out.endswith("wrote out/scan_in_map.txt\nwrote out/scan_in_map_aligned.ply\nwrote maps/kept\n")
    monkeypatch.delattr(locate, "prepare_map")  # it isn't prepared again
    done = json.loads(succeed(capsys, "locate", "scan.ply", "--map", "maps/kept", "--json"))
    assert done["inputs"][1]["points"] == len(PAIR.target)
    assert [level["voxel"] for level in done["results"]["levels"]] == [4.0]
    first, second = (read_transform(f"out/scan_in_{name}.txt") for name in ("map", "kept"))
    assert np.array_equal(first, second)


def test_the_document(capsys: Capture) -> None:
    said = json.loads(succeed(capsys, *LINE, "--near", *ORIGIN, "--radius", 20, "--json"))
    assert said["command"] == "locate"
    assert [one["role"] for one in said["inputs"]] == ["scan", "map"]
    assert said["options"]["radius"] == 20.0
    assert said["files"] == ["out/scan_in_map.txt", "out/scan_in_map_aligned.ply"]
    done = said["results"]
    assert done["ok"]
    (place,) = done["places"]
    assert np.array_equal(place["T_target_source"], read_transform("out/scan_in_map.txt"))
    assert not undocumented(said, done["levels"][0], place)


def test_places_that_look_the_same_are_listed(capsys: Capture) -> None:
    write_twice("twice.ply")
    line = ("locate", "scan.ply", "--map", "twice.ply")
    status, out, err = run(capsys, *line)
    assert status == 3
    assert "\nplaces      2 share the probability\n" in out
    rows = [text.split() for text in out.splitlines()[-3:]]
    assert rows[0] == ["place", "probability", "x", "y", "z"]
    assert [row[0] for row in rows[1:]] == ["1", "2"]
    nearest = min(rows[1:], key=lambda row: abs(float(row[2]) - ORIGIN[0]))
    assert np.allclose([float(number) for number in nearest[2:]], ORIGIN, atol=2.0)
    assert "pose of the scan" not in out
    assert err.startswith("cgroup: 2 places look the same, and the best is correct with a probability of 0.")
    assert err.endswith("give --near; --html draws the best guess\n")
    assert not Path("out").exists()
    succeed(capsys, *line, "--near", *ORIGIN, "--radius", 20)


def test_a_scan_of_elsewhere_is_refused(capsys: Capture) -> None:
    succeed(capsys, *LINE)
    write_cloud("scan.ply", standin_pair(seed=5, pixels=60).source)
    status, out, err = run(capsys, *LINE)
    assert status == 3
    assert "pose of the scan" not in out
    assert err.startswith("cgroup: the best place is correct with a probability of 0.")
    assert "of the scan overlaps the map; for single scans, give" in err
    assert err.endswith("--viewpoint; --html draws the best guess\n")
    assert not Path("out/scan_in_map.txt").exists()  # of the earlier run
    assert not Path("out/scan_in_map_aligned.ply").exists()
    status, out, err = run(capsys, *LINE, "--viewpoint", 0, 0, 0, "--json")
    assert status == 3
    assert "--viewpoint" not in err
    said = json.loads(out)
    assert not said["results"]["ok"]
    assert said["results"]["places"][0]["probability"] < 0.5
    assert said["files"] == []


def test_nothing_is_guessed_far_away(capsys: Capture) -> None:
    status, out, err = run(capsys, *LINE, "--near", 1e5, 0, 0)
    assert (status, err) == (3, "cgroup: no candidate place was found; give a larger --radius\n")
    assert "places" not in out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("--map few.npy", "--map: got 4 points"),
        ("--map bare", "bare: no folder that --save-map has written"),
        ("--map bare --voxel 3", "--voxel: for a map that is a cloud"),
        ("--map bare --save-map new", "--save-map: for a map that is a cloud"),
        ("--map map.ply --save-map bare", "bare: exists already; give the name of a new folder"),
        ("--map map.ply --save-map map.ply/new", "map.ply/new: can't be made a folder"),
        ("--map map.ply --radius 5", "--radius: got 5.0, but no place; give --near, too"),
    ],
)
def test_what_cannot_be_worked_with(words: str, says: str, folder: Path, capsys: Capture) -> None:
    (folder / "bare").mkdir()
    np.save("few.npy", PAIR.target.points[:4])
    assert says in fail(capsys, "locate", "scan.ply", *words.split())
    assert not Path("out").exists()


def test_no_input_and_no_other_pose_is_replaced(capsys: Capture) -> None:
    Path("out").mkdir()
    pose = Path("out/scan_in_map.txt")
    pose.write_text("mine")
    assert "is not the pose of these clouds" in fail(capsys, *LINE)
    assert pose.read_text() == "mine"
    Path("scan_in_map.txt").hardlink_to("scan.ply")
    assert "is one of the inputs" in fail(capsys, *LINE, "--out", ".")


def test_a_page_shows_each_place(capsys: Capture) -> None:
    write_twice("twice.ply")
    line = ("locate", "scan.ply", "--map", "twice.ply", "--html")
    status, out, err = run(capsys, *line)
    assert (status, "wrote out/scan_in_twice.html" in out, "--html" in err) == (3, True, False)
    page = Path("out/scan_in_twice.html").read_text(encoding="utf-8")
    assert "Refused" in page
    assert page.count("data-near=") == 2
    succeed(capsys, *line, "--near", *ORIGIN, "--radius", 20)
    assert "Refused" not in Path("out/scan_in_twice.html").read_text(encoding="utf-8")
    succeed(capsys, *line[:-1], "--near", *ORIGIN, "--radius", 20)  # of the same result
    assert Path("out/scan_in_twice.html").exists()
