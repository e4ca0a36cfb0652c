"""What a run may replace and remove: what an earlier run wrote, and nobody has changed since."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import trimesh
from command_lines import fail, results_in, run, succeed, write_inputs
from placed_scenes import PAIR
from scenes import stone_model, stone_scene

from cgroup import InputError
from cgroup.datasets import standin_pair
from cgroup.io import read_cloud, write_cloud, write_correspondences, write_file, write_transform
from cgroup.io.result_folders import LIST, Results
from cgroup.maps.map_files import save_arrays
from cgroup.rigid import apply
from cgroup.scenes import register_all
from cgroup.types import Correspondences

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="links, pipes and signals are Unix's")
Capture = pytest.CaptureFixture[str]

COMMANDS = {
    "register": ("register", "source.ply", "target.ply", "--html", "--merged"),
    "merge": ("merge", "source.ply", "target.ply", "--html"),
    "compare": ("compare", "source.ply", "target.ply", "--truth", "truth.txt", "--html"),
    "demo": ("demo", "--html"),
    "recognize": ("recognize", "stone.ply", "--scene", "scene.ply"),
    "locate": ("locate", "source.ply", "--map", "target.ply"),
    "group": ("group", "matches.npz", "--method", "gtm"),
    "detect": ("detect", "source.ply"),
    "describe": ("describe", "source.ply"),
}
FIRST = {
    "register": "source_on_target.txt",
    "merge": "poses.tum",
    "compare": "source_on_target_comparison.csv",
    "demo": "source.ply",
    "recognize": "stone_in_scene.txt",
    "locate": "source_in_target.txt",
    "group": "matches_gtm_mask.txt",
    "detect": "keypoints.npz",
    "describe": "descriptors.npz",
}


@pytest.fixture(name="folder")
def inputs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_inputs(tmp_path)
    model, scene = stone_model(1), stone_scene([1])[0]
    trimesh.Trimesh(model.points, model.faces, process=False).export("stone.ply")
    write_cloud("scene.ply", scene)
    return tmp_path


def link_to_file(path: Path) -> None:
    Path("precious.txt").write_text("precious")
    path.symlink_to(Path("precious.txt").absolute())


def link_to_nothing(path: Path) -> None:
    path.symlink_to(path.with_name("nothing"))


def own_file(path: Path) -> None:
    path.write_text("mine")


OBSTACLES = (own_file, link_to_file, link_to_nothing, os.mkfifo)


@POSIX
@pytest.mark.parametrize("put", OBSTACLES, ids=lambda put: put.__name__)
@pytest.mark.parametrize("command", COMMANDS)
def test_what_is_not_ours_is_refused(
    folder: Path, capsys: Capture, command: str, put: Callable[[Path], None]
) -> None:
    """Before there is any work, by all commands: files of others, links and pipes."""
    out = folder / "out"
    out.mkdir()
    put(out / FIRST[command])
    before = (out / FIRST[command]).lstat().st_ino
    said = fail(capsys, *COMMANDS[command])
    assert f"{FIRST[command]}: is " in said
    assert results_in(out) == [FIRST[command]]
    assert (out / FIRST[command]).lstat().st_ino == before
    if put is link_to_file:
        assert Path("precious.txt").read_text() == "precious"


@pytest.mark.parametrize("name", ["scene.png", "scene.html", "merged.ply", "graph.g2o"])
def test_any_output_of_a_scene_that_is_not_ours_is_refused(folder: Path, capsys: Capture, name: str) -> None:
    (folder / "out").mkdir()
    (folder / "out" / name).write_text("mine")
    assert f"{name}: is there, and not as cgroup wrote it" in fail(capsys, *COMMANDS["merge"])
    assert (folder / "out" / name).read_text() == "mine"


def test_own_files_of_names_that_are_not_written_stay(folder: Path, capsys: Capture) -> None:
    own = [folder / "out" / name for name in ("scene.html", "poses_2.tum", "merged_2.ply", "scene_2.png")]
    (folder / "out").mkdir()
    for file in own:
        file.write_text("mine")
    for line in ("source.ply", "target.ply"), ("target.ply", "source.ply"):
        succeed(capsys, "merge", *line)
    assert all(file.read_text() == "mine" for file in own)


@pytest.mark.parametrize("command", ["register", "merge", "locate", "group", "detect"])
def test_a_result_that_was_changed_is_refused(folder: Path, capsys: Capture, command: str) -> None:
    succeed(capsys, *COMMANDS[command])
    file = folder / "out" / FIRST[command]
    file.write_bytes(file.read_bytes() + b"# mine\n")
    changed = file.read_bytes()
    assert f"{FIRST[command]}: is there, and not as cgroup wrote it" in fail(capsys, *COMMANDS[command])
    assert file.read_bytes() == changed


@pytest.mark.parametrize("command", ["register", "merge"])
def test_views_stay_as_long_as_they_show_the_result(folder: Path, capsys: Capture, command: str) -> None:
    """Without ``--html`` the page of the same result stays; that of another one goes, unless it was changed."""
    line = [word for word in COMMANDS[command] if not word.startswith("--")]
    succeed(capsys, *COMMANDS[command])
    views = [name for name in results_in(folder / "out") if name.endswith(("html", "_merged.ply"))]
    succeed(capsys, *line, "--json")
    assert {*views} <= {*results_in(folder / "out")}
    kept = folder / "out" / views[0]
    own = kept.read_bytes() + b"\n"
    kept.write_bytes(own)
    write_cloud("source.ply", read_cloud("source.ply").points[:-7])
    succeed(capsys, *line)
    assert kept.read_bytes() == own
    assert not {*views[1:]} & {*results_in(folder / "out")}
    kept.unlink()
    succeed(capsys, *COMMANDS[command])
    succeed(capsys, *line, "--effort", "high")
    assert not {*views} & {*results_in(folder / "out")}


def test_a_scene_of_fewer_scans_leaves_no_older_components(folder: Path, capsys: Capture) -> None:
    other = standin_pair(seed=5, pixels=60)
    write_cloud("a.ply", other.source)
    write_cloud("b.ply", other.target)
    scans = ("source.ply", "target.ply", "a.ply", "b.ply")
    assert run(capsys, "merge", *scans, "--voxel", 5)[0] == 3
    assert "merged_2.ply" in results_in(folder / "out")
    succeed(capsys, "merge", *scans[:2], "--voxel", 5)
    assert not [name for name in results_in(folder / "out") if "_2" in name]


def test_an_input_is_not_removed(folder: Path, capsys: Capture) -> None:
    """Although an earlier run wrote it, and this one does not."""
    results = Results(Path("out"), "merge")
    with results.writing():
        shutil.copyfile("source.ply", "copy.ply")
        write_cloud("out/merged_2.ply", read_cloud("copy.ply"))
    succeed(capsys, "merge", "out/merged_2.ply", "target.ply")
    assert (folder / "out" / "merged_2.ply").exists()
    succeed(capsys, "merge", "source.ply", "target.ply")
    assert not (folder / "out" / "merged_2.ply").exists()


def test_runs_of_other_kinds_are_kept(folder: Path, capsys: Capture) -> None:
    for command in ("register", "locate", "group", "detect", "describe"):
        succeed(capsys, *COMMANDS[command])
    write_cloud("source.ply", read_cloud("source.ply").points[:-7])
    before = results_in(folder / "out")
    succeed(capsys, *COMMANDS["locate"])
    assert results_in(folder / "out") == before


@POSIX
def test_a_forged_list_removes_nothing_elsewhere(tmp_path: Path) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    with Results(elsewhere, "merge").writing():
        write_file(elsewhere / "precious.txt", b"precious")
        write_file(elsewhere / "other.txt", b"precious")
    out.mkdir()
    (out / "link").symlink_to(elsewhere)
    (out / "alias.txt").symlink_to(elsewhere / "other.txt")
    entry = json.loads((elsewhere / LIST).read_text().splitlines()[0])
    names = ("../elsewhere/precious.txt", str(elsewhere / "precious.txt"), "link/precious.txt", "alias.txt")
    junk = ["", "[]", "7", "{", '{"file": 3}', '{"file": "\\u0000", "by": [], "run": {}, "sha256": null}']
    lines = [json.dumps({**entry, "file": name}) for name in (*names, "..", "", "link")]
    (out / LIST).write_text("\n".join([*junk, *lines, "[" * 100_000, json.dumps(entry)[:40]]))
    with Results(out, "merge").writing():
        write_file(out / "poses.tum", b"new")
    assert (elsewhere / "precious.txt").read_bytes() == b"precious"
    assert (elsewhere / "other.txt").exists()
    assert (out / "alias.txt").is_symlink()


@POSIX
def test_the_list_itself_is_no_link(tmp_path: Path) -> None:
    (tmp_path / "precious").write_bytes(b"precious")
    (tmp_path / LIST).symlink_to(tmp_path / "precious")
    with pytest.raises(InputError, match="is a link, not a file"), Results(tmp_path, "merge").writing():
        write_file(tmp_path / "poses.tum", b"new")
    assert (tmp_path / "precious").read_bytes() == b"precious"


# --- pipes, links and devices ------------------------------------------------------------------------


@POSIX
@pytest.mark.parametrize("put", OBSTACLES[1:], ids=lambda put: put.__name__)
def test_no_writer_follows_a_link_or_waits_for_a_pipe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, put: Callable[[Path], None]
) -> None:
    monkeypatch.chdir(tmp_path)
    pair = standin_pair(pixels=60)
    scene = register_all([pair.source, pair.target], voxel=5.0)
    matches = Correspondences(np.eye(3), np.eye(3))
    writers: dict[str, Callable[[Path], None]] = {
        "a.ply": lambda path: write_cloud(path, pair.source),
        "a.txt": lambda path: write_transform(path, np.eye(4)),
        "a.npz": lambda path: write_correspondences(path, matches),
        **{f"a.{end}": scene.write for end in ("tum", "kitti", "log", "g2o", "json", "pcd")},
        "b.g2o": scene.graph.write,
    }
    for name, write in writers.items():
        put(tmp_path / name)
        with pytest.raises(InputError, match=f"{name}: is a (link|pipe)"):
            write(tmp_path / name)
    assert put is not link_to_file or Path("precious.txt").read_text() == "precious"
    with pytest.raises(InputError, match="/dev/null: is a pipe, a device"):
        write_file("/dev/null", b"nothing")


@POSIX
def test_pages_and_folders_are_no_pipes(folder: Path, capsys: Capture) -> None:
    os.mkfifo("page.html")
    truth = ("--protocol", "3dmatch", "--truth", "truth.tum")
    Path("truth.tum").write_text("0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n")
    assert "page.html: is a pipe" in fail(capsys, "evaluate", "truth.tum", *truth, "--html", "page.html")
    os.mkfifo("out")
    assert "out: " in fail(capsys, *COMMANDS["group"])
    assert folder


# --- killed runs -------------------------------------------------------------------------------------

HALF_WRITTEN = """
import os, sys, time
import cgroup.io.files
os.fsync = lambda _: (print("ready", flush=True), time.sleep(600))
cgroup.io.write_file(sys.argv[1], b"half")
"""


def start_writing(script: str, path: Path) -> subprocess.Popen[str]:
    """Start a process that has written a part of a path, and waits."""
    line = [sys.executable, "-c", script, str(path)]
    process = subprocess.Popen(line, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def end_all(*processes: subprocess.Popen[str]) -> None:
    """Kill processes, and close what they print to."""
    for process in processes:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


@POSIX
def test_parts_of_killed_runs_are_removed_and_those_of_living_ones_stay(
    folder: Path, capsys: Capture
) -> None:
    out = folder / "out"
    out.mkdir()
    dead, alive = (start_writing(HALF_WRITTEN, out / name) for name in ("a.txt", "b.txt"))
    try:
        parts = {*out.glob(".cgroup-*.part")}
        assert len(parts) == 2
        dead.send_signal(signal.SIGKILL)
        dead.wait()
        (out / ".cgroup-notes.txt").write_text("mine")
        (out / ".cgroup-folder.part").mkdir()
        (out / ".cgroup-link.part").symlink_to(folder / "source.ply")
        os.mkfifo(out / ".cgroup-pipe.part")
        succeed(capsys, *COMMANDS["group"])
        left = {file.name for file in out.glob(".cgroup-*")}
        assert len(left & {part.name for part in parts}) == 1
        assert left > {".cgroup-notes.txt", ".cgroup-folder.part", ".cgroup-link.part", ".cgroup-pipe.part"}
    finally:
        end_all(dead, alive)
    succeed(capsys, *COMMANDS["group"])
    assert not {*out.glob(".cgroup-*.part")} & parts


HALF_SAVED = """
import sys, time
from pathlib import Path
import numpy as np
import cgroup.maps.map_files as map_files
map_files._check_of = lambda _: (print("ready", flush=True), time.sleep(600))
map_files.save_arrays(Path(sys.argv[1]), {}, {"points": np.zeros((3, 3))})
"""


@POSIX
def test_parts_of_killed_folders_are_removed_and_those_of_living_ones_stay(tmp_path: Path) -> None:
    dead, alive = (start_writing(HALF_SAVED, tmp_path / name) for name in ("a", "b"))
    try:
        assert len([*tmp_path.glob(".cgroup-*.part/*/points.npy")]) == 2
        dead.send_signal(signal.SIGKILL)
        dead.wait()
        (tmp_path / ".cgroup-mine.part").mkdir()
        save_arrays(tmp_path / "c", {}, {"points": np.zeros((3, 3))})
        assert {file.name for file in (tmp_path / "c").iterdir()} == {"map.json", "points.npy"}
        assert len([*tmp_path.glob(".cgroup-*.part/*/points.npy")]) == 1
        assert (tmp_path / ".cgroup-mine.part").is_dir()
    finally:
        end_all(dead, alive)


@POSIX
def test_what_a_killed_run_wrote_is_replaced_by_the_next(folder: Path, capsys: Capture) -> None:
    """Each file is listed before it is there."""
    killed = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from cgroup import io\n"
        "from cgroup.cli import main\n"
        "real = io.write_transform\n"
        "io.write_transform = lambda *given: (real(*given), os.kill(os.getpid(), signal.SIGKILL))\n"
        f"main({[*COMMANDS['group']]!r})\n"
    )
    ended = subprocess.run([sys.executable, "-c", killed], check=False)
    assert ended.returncode == -signal.SIGKILL
    assert results_in(folder / "out") == ["matches_gtm_mask.txt", "matches_gtm_transform.txt"]
    matches = read = np.load("matches.npz")
    write_correspondences("matches.npz", Correspondences(matches["source"][:50], read["target"][:50]))
    succeed(capsys, *COMMANDS["group"])
    assert len(Path("out/matches_gtm_mask.txt").read_text().splitlines()) == 50


def test_many_processes_share_a_folder(folder: Path, capsys: Capture) -> None:
    lines = [
        ("group", "matches.txt", "--method", method, "--tolerance", "0.1") for method in ("gc", "ransac")
    ]
    start = partial(subprocess.Popen, stdout=subprocess.DEVNULL)
    for _ in range(2):
        running = [start([sys.executable, "-m", "cgroup", *line]) for line in lines]
        assert all(process.wait() in (0, 3) for process in running)
    entries = [json.loads(line) for line in (folder / "out" / LIST).read_text().splitlines()]
    assert {entry["file"] for entry in entries} == {*results_in(folder / "out")}
    assert capsys


# --- scans that change -------------------------------------------------------------------------------


def test_a_scan_that_changes_after_its_registration_is_refused(
    folder: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the same size and time too: the points are compared, not the file's date."""
    from cgroup.cli.commands import merge  # noqa: PLC0415

    before = Path("source.ply").stat()
    cloud = read_cloud("source.ply")
    write_cloud("other.ply", replace(cloud, points=apply(standin_pair().T_target_source, cloud.points)))
    assert Path("other.ply").stat().st_size == before.st_size

    def register_then_change(*scans: object, **options: object) -> object:
        scene = register_all(*scans, **options)  # type: ignore[arg-type]
        Path("source.ply").write_bytes(Path("other.ply").read_bytes())
        os.utime("source.ply", ns=(before.st_atime_ns, before.st_mtime_ns))
        return scene

    monkeypatch.setattr(merge, "register_all", register_then_change)
    said = fail(capsys, "merge", "source.ply", "target.ply", "--voxel", 5)
    assert "source.ply: was changed since it was registered" in said
    assert results_in(folder / "out") in ([], ["pairs.sqlite"])


@pytest.mark.parametrize("change", ["moved", "fewer", "none"])
def test_a_scene_refuses_points_that_it_did_not_register(folder: Path, change: str) -> None:
    scene = register_all([folder / "source.ply", PAIR.target], voxel=5.0)
    both = len(scene.merged())
    cloud = read_cloud("source.ply")
    if change == "none":
        write_cloud("source.ply", cloud.points)  # without its normals, or whatever else it has
        assert len(scene.merged()) == both
        return
    write_cloud("source.ply", cloud.points + 1.0 if change == "moved" else cloud.points[:-1])
    with pytest.raises(InputError, match="was changed since it was registered"):
        scene.merged()
    with pytest.raises(InputError, match="was changed since it was registered"):
        scene.write("merged.ply")
    scene.write("poses.tum")
