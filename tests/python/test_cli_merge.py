"""``cgroup merge``: what it prints, writes and refuses. Placing the scans is tested elsewhere."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_lines import fail, results_in, run, succeed, undocumented
from placed_scenes import PAIR, known_scene

from cgroup import InputError
from cgroup.cli import terminal
from cgroup.cli.commands import merge
from cgroup.cli.files import name_frames, write_pose
from cgroup.io import read_cloud, read_transforms, write_cloud
from cgroup.registration import FalseAccepts
from cgroup.registration.decoys import count_false_accepts
from cgroup.rigid import apply, invert, rotation_error
from cgroup.scenes import PoseGraph, Scene

Capture = pytest.CaptureFixture[str]
NAMES = ["front.ply", "side.ply", "again.ply", "stranger.ply"]


@pytest.fixture
def calls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Write the scans of a known scene; collect what they are placed with."""
    monkeypatch.chdir(tmp_path)
    for name, cloud in zip(NAMES, known_scene().scans, strict=True):
        write_cloud(name, cloud)
    given: list[dict[str, Any]] = []

    def place(scans: list[Path], **options: Any) -> Scene:
        given.append({"scans": scans, **options})
        options["progress"]("pair 1 of 6")
        options["keep"].write_bytes(b"finished")
        rows = [row for row, scan in enumerate(scans) if scan.exists()]
        components = [[row for row in rows if row < 3], [row for row in rows if row >= 3]]
        return known_scene(
            scans=tuple(scans), names=options["names"], components=[rows for rows in components if rows]
        )

    monkeypatch.setattr(merge, "register_all", place)
    return given


def test_one_scene(calls: list[dict[str, Any]], capsys: Capture) -> None:
    options = "--voxel 5 --viewpoint 0 0 0 --effort high --threads 1 --scheduler local"
    Path("stranger.ply").unlink()
    status, out, err = run(capsys, "merge", *NAMES, "--out", "scene", *options.split())
    assert (status, err) == (3, "cgroup: 1 of 4 scans left out (stranger.ply)\n")
    (given,) = calls
    assert (given["voxel"], given["viewpoint"], given["effort"]) == (5.0, (0.0, 0.0, 0.0), "high")
    assert (given["threads"], given["scheduler"], given["keep"]) == (1, "local", Path("scene/pairs.sqlite"))
    assert given["names"] == NAMES
    lines = out.splitlines()
    assert lines[0].split() == ["scan", "component", "probability", "sd", "deg", "sd", "length"]
    assert [line.split()[0] for line in lines[1:5]] == NAMES
    assert "left out" in lines[4]
    edges = lines[7:10]
    assert edges[0].split()[:2] == ["again.ply", "front.ply"]  # dropped ones first
    assert edges[0].endswith("other edges contradict it")
    assert "components  3 scans" in out
    assert "note        stranger.ply belongs to no other scan" in out
    names = ["graph.g2o", "merged.ply", "pairs.sqlite", "poses.tum", "scene.png"]
    assert results_in(Path("scene")) == names
    assert all(f"  {name}" in out for name in names)
    assert len(read_transforms("scene/poses.tum")) == 3
    assert len(PoseGraph.read("scene/graph.g2o").edges) == 2


@pytest.mark.usefixtures("calls")
def test_mirrored_scans_are_added_if_wanted(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    def count(scene: Scene, *, scans: int, **_: object) -> FalseAccepts:
        return count_false_accepts([True] * len(scene.scans), [True] + [False] * (scans - 1))

    monkeypatch.setattr(merge, "false_joins", count)
    _, out, _ = run(capsys, "merge", *NAMES, "--out", "scene", "--decoys", 4)
    assert "1 of 4 mirrored scans would be joined: about 25 %" in out
    _, out, _ = run(capsys, "merge", *NAMES, "--out", "scene", "--decoys", 4, "--json")
    assert json.loads(out)["results"]["false_joins"]["decoys"] == 1
    _, out, _ = run(capsys, "merge", *NAMES, "--out", "scene", "--json")
    assert json.loads(out)["results"]["false_joins"] is None


def test_scans_are_placed_and_finished_pairs_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    write_cloud("source.ply", PAIR.source)
    write_cloud("target.ply", PAIR.target)
    line = ("merge", "target.ply", "source.ply", "missing.ply", "--voxel", 5, "--out", "scene", "--json")
    status, out, err = run(capsys, *line)
    assert (status, err) == (3, "cgroup: 1 of 3 scans left out (missing.ply)\n")
    done = json.loads(out)["results"]
    pose = read_transforms("scene/poses.tum")[1]
    assert rotation_error(pose, PAIR.T_target_source) < 1.0
    assert done["components"] == [[0, 1]]
    assert done["scans"][2]["component"] is None
    assert "missing.ply" in done["notes"][0]
    again = json.loads(run(capsys, *line)[1])["results"]
    assert {**again, "seconds": None} == {**done, "seconds": None}


@pytest.mark.usefixtures("calls")
def test_several_components_end_with_status_3(capsys: Capture) -> None:
    status, out, err = run(capsys, "merge", *NAMES, "--out", "scene")
    assert status == 3
    assert "components  3 scans, 1 scan" in out
    assert "not all scans are connected: 2 components (3 scans, 1 scan); for single scans" in err
    assert "--viewpoint" in err
    assert not Path("scene/merged_2.ply").exists()  # of one scan
    assert "--viewpoint" not in run(capsys, "merge", *NAMES, "--viewpoint", 0, 0, 0)[2]


def test_each_component_of_several_scans_has_its_files(
    calls: list[dict[str, Any]], capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = merge.register_all
    halves = [[0, 1], [2, 3]]

    def split(*scans: Any, **options: Any) -> Scene:
        placed = place(*scans, **options)
        edges = placed.edges[:1]
        return known_scene(scans=placed.scans, names=placed.names, components=halves, edges=edges)

    monkeypatch.setattr(merge, "register_all", split)
    assert run(capsys, "merge", *NAMES, "--out", "scene")[0] == 3
    assert calls
    for number, rows in (("", 2), ("_2", 2)):
        assert len(read_transforms(f"scene/poses{number}.tum")) == rows
        assert len(read_cloud(f"scene/merged{number}.ply")) > 100
        assert Path(f"scene/graph{number}.g2o").exists()
        assert Path(f"scene/scene{number}.png").exists()
    monkeypatch.setattr(merge, "register_all", place)
    run(capsys, "merge", *NAMES, "--out", "scene")
    assert not list(Path("scene").glob("*_2*"))  # of the earlier run


@pytest.mark.usefixtures("calls")
@pytest.mark.parametrize("folder", ["scene", "moved"])
def test_the_files_of_connected_scans_are_moved(folder: str, capsys: Capture) -> None:
    status, printed, _ = run(capsys, "merge", *NAMES, "--out", folder, "--write-scans")
    assert status == 3  # the stranger is alone
    assert sorted(path.name for path in Path(folder, "moved").iterdir()) == sorted(NAMES[:3])
    for name, pose in zip(NAMES, read_transforms(f"{folder}/poses.tum"), strict=False):
        expected = read_cloud(name).transformed(pose).points
        np.testing.assert_allclose(read_cloud(f"{folder}/moved/{name}").points, expected, atol=1e-3)
    assert "moved/: 3 files, moved by the poses" in printed
    assert "poses.tum" in printed


@pytest.mark.usefixtures("calls")
def test_files_that_cannot_be_moved_are_refused_before_the_work(capsys: Capture) -> None:
    np.save("points.npy", np.eye(3))
    assert "'.npy' files are not moved" in fail(
        capsys, "merge", *NAMES, "points.npy", "--out", "scene", "--write-scans"
    )
    assert not Path("scene").exists()


@pytest.mark.usefixtures("calls")
@pytest.mark.parametrize("option", ["--full", "--e57", "--write-scans"])
def test_las_files_are_refused_before_the_work_without_laspy(
    option: str, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "laspy", None)
    Path("site.LAZ").write_bytes(b"LASF")
    said = fail(capsys, "merge", *NAMES, "site.LAZ", "--out", "scene", option)
    assert "needs laspy; pip install 'cgroup[las]'" in said
    assert not Path("scene").exists()


@pytest.mark.usefixtures("calls")
def test_the_document(capsys: Capture) -> None:
    status, out, _ = run(capsys, "merge", *NAMES, "--out", "scene", "--html", "--json")
    assert status == 3
    said = json.loads(out)
    assert said["command"] == "merge"
    assert [one["file"] for one in said["inputs"]] == NAMES
    done, known = said["results"], known_scene()
    assert done["components"] == [[0, 1, 2], [3]]
    assert [scan["component"] for scan in done["scans"]] == [0, 0, 0, 1]
    assert np.array_equal(done["scans"][1]["T_component_scan"], known.poses[1])
    assert done["scans"][0]["deviation"] == 0.0
    assert done["scans"][1]["deviation"] > 0.1
    assert [edge["kept"] for edge in done["edges"]] == [True, True, False]
    assert done["edges"][2]["reason"] == "other edges contradict it"
    assert Path("scene/scene.html").read_text(encoding="utf-8").startswith("<!doctype html>")
    assert "scene/scene.html" in said["files"]
    assert not undocumented(said, done["scans"][0], done["edges"][0])


def test_names_that_are_the_same_get_their_folder(calls: list[dict[str, Any]], capsys: Capture) -> None:
    Path("again").mkdir()
    write_cloud("again/side.ply", read_cloud("side.ply"))
    succeed(capsys, "merge", "front.ply", "side.ply", "again/side.ply")
    assert calls[0]["names"] == ["front.ply", "side.ply", "again/side.ply"]


def test_a_folder_and_a_pattern_are_their_clouds_by_name(
    calls: list[dict[str, Any]], capsys: Capture
) -> None:
    for name in ("poses.txt", "notes.md", "pairs.npz", ".hidden.ply"):
        Path(name).write_text("1 2 3\n")
    Path("sub.ply").mkdir()
    for given, taken in (
        (["."], sorted(NAMES)),
        (["*.ply"], sorted(NAMES)),
        (["[fs]*.ply", "again.ply"], ["front.ply", "side.ply", "stranger.ply", "again.ply"]),
    ):
        _, out, _ = run(capsys, "merge", *given, "--out", "scene")
        assert [Path(scan).name for scan in calls.pop()["scans"]] == taken
        assert [line.split()[0] for line in out.splitlines()[1:][: len(taken)]] == taken


def test_earlier_results_are_no_scans_and_removed_ones_are_listed(
    calls: list[dict[str, Any]], capsys: Capture
) -> None:
    _, out, _ = run(capsys, "merge", ".", "--out", ".", "--html")
    assert "removed" not in out
    _, out, _ = run(capsys, "merge", ".", "--out", ".", "--voxel", "5")
    assert [[Path(scan).name for scan in call["scans"]] for call in calls] == [sorted(NAMES)] * 2
    assert Path("merged.ply").exists()
    assert not Path("scene.html").exists()
    assert "removed     scene.html of an earlier run" in out
    _, out, _ = run(capsys, "merge", ".", "--out", ".", "--voxel", "6", "--json")
    assert json.loads(out)["results"]["removed"] == []
    write_cloud("merged.ply", read_cloud("front.ply"))  # no longer as cgroup wrote it
    run(capsys, "merge", ".", "--out", "elsewhere")
    assert "merged.ply" in [Path(scan).name for scan in calls[-1]["scans"]]
    run(capsys, "merge", *NAMES, "--out", "scene")
    assert "got a folder without clouds but results of cgroup" in fail(capsys, "merge", "scene")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("front_on_site.txt", "# pose of /scans/{} in the frame of /job/site.ply\n"),
        ("known.tum", "# scan 0: other.ply\n# scan 1: {}\n"),
    ],
)
@pytest.mark.parametrize("called", ["side.ply", "side.csv", "old/side.laz"])
def test_known_poses_are_those_of_the_named_scans(
    calls: list[dict[str, Any]], capsys: Capture, name: str, content: str, called: str
) -> None:
    pose = known_scene().poses[1]
    row = f"1 {' '.join(map(repr, pose[:3, 3].tolist()))} 0 0 0 1\n"
    Path(name).write_text(row * content.count("# ") + content.format(called))
    write_pose(Path("front_on_b.txt"), pose, name_frames(Path("front.las"), Path("b.ply")))
    run(capsys, "merge", *NAMES, "--known", name, "--known", "front_on_b.txt")
    found = calls[0]["known"]
    assert [*found] == [1, 0]
    np.testing.assert_array_equal(found[1][:3], np.column_stack([np.eye(3), pose[:3, 3]]))
    np.testing.assert_array_equal(found[0], pose)
    twice = fail(capsys, "merge", *NAMES, "--known", name, "--known", name)
    assert "--known, --targets: got several poses of side.ply; give one pose per scan" in twice
    Path(name).write_text(row)
    message = fail(capsys, "merge", *NAMES, "--known", name)
    assert f"--known: got {name}: 1 poses, 0 names, 0 of them of these scans; name the scan" in message


def test_targets_of_scans_give_their_poses(calls: list[dict[str, Any]], capsys: Capture) -> None:
    places = np.random.default_rng(0).uniform(0, 50, (6, 3))

    def write_targets(file: str, points: np.ndarray) -> None:
        lines = (f"T{row},{x!r},{y!r},{z!r}\n" for row, (x, y, z) in enumerate(points.tolist()))
        Path(file).write_text("".join(lines))

    poses = known_scene().poses
    for row, name in ((0, "front.csv"), (2, "again.csv")):
        write_targets(name, apply(invert(poses[row]), places))
    write_targets("site.csv", places)
    write_targets("side.csv", places[::-1] * [1, 2, 3])
    files = [word for name in ("site.csv", "front.csv", "again.csv") for word in ("--targets", name)]
    run(capsys, "merge", *NAMES, *files)
    found = calls[0]["known"]
    assert [*found] == [0, 2]
    for row, pose in found.items():
        np.testing.assert_allclose(pose, poses[row], rtol=0, atol=1e-9)
    for given, message in (
        (["site.csv"], "--targets: got site.csv; give the site's file, then files named as scans"),
        (["site.csv", "b.csv"], "--targets: got site.csv, b.csv; give the site's file"),
        (["site.csv", "side.csv"], "--targets: got side.csv; the pose of the targets is doubtful"),
    ):
        options = [word for name in given for word in ("--targets", name)]
        assert message in fail(capsys, "merge", *NAMES, *options)
    assert len(calls) == 1


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("nothing/*.ply", "CLOUD: nothing/*.ply: got a pattern that no file matches; check the folder and"),
        ("texts", "CLOUD: texts: got a folder without clouds; files whose names end in .asc .bin "),
        ("one", "scans: got 1; give two or more, a folder or a pattern"),
        ("front.ply", "scans: got 1; give two or more"),
    ],
)
def test_what_stands_for_no_scans_is_named(given: str, says: str, capsys: Capture, tmp_path: Path) -> None:
    for folder in ("texts", "one"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "poses.txt").write_text("1 2 3\n")
    write_cloud(tmp_path / "one" / "a.ply", PAIR.source)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)
        error = fail(capsys, "merge", given, "--out", "scene")
        assert says in " ".join(error.split())
        assert not Path("scene").exists()


def test_no_output_replaces_a_scan(calls: list[dict[str, Any]], capsys: Capture) -> None:
    write_cloud("merged.ply", read_cloud("front.ply"))
    before = Path("merged.ply").read_bytes()
    assert "merged.ply: is one of the inputs" in fail(capsys, "merge", "merged.ply", *NAMES, "--out", ".")
    assert not calls  # before there is any work
    assert Path("merged.ply").read_bytes() == before


def test_what_is_refused_leaves_no_folder(
    calls: list[dict[str, Any]], capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any, **__: Any) -> Scene:
        raise InputError("scans", "1", "give at least two; `voxel` is no matter")

    monkeypatch.setattr(merge, "register_all", refuse)
    err = fail(capsys, "merge", "front.ply", "--out", "scene")
    assert "--voxel" in err
    assert not Path("scene").exists()
    Path("mine").mkdir()
    fail(capsys, "merge", "front.ply", "--out", "mine")
    assert Path("mine").exists()
    assert not calls


def test_progress_is_written_where_nothing_can_be_overwritten(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    seconds = iter([0.0, 1.0, 14.0, 16.0, 17.0, 30.0, 31.0])
    monkeypatch.setattr(terminal, "monotonic", lambda: next(seconds))
    with terminal.show_stages(piped=True) as begin:
        for pair in range(1, 7):
            begin(f"pair {pair} of 6\x1b")
    assert capsys.readouterr().err == "pair 3 of 6\\x1b (16 s)\npair 6 of 6\\x1b (31 s)\n"


@pytest.mark.usefixtures("calls")
def test_e57_has_each_file_of_a_component_in_its_place(capsys: Capture) -> None:
    status, printed, _ = run(capsys, "merge", *NAMES, "--out", "scene", "--e57")
    assert status == 3
    assert "merged.e57    all points of the files, each file a scan with its pose" in printed
    poses = read_transforms("scene/poses.tum")
    wanted = [read_cloud(name).transformed(pose) for name, pose in zip(NAMES, poses, strict=False)]
    found = read_cloud("scene/merged.e57").points
    np.testing.assert_allclose(found, np.vstack([cloud.points for cloud in wanted]), rtol=0, atol=1e-6)
    assert not Path("scene/merged_2.e57").exists()
