"""What a run may replace and remove: what an earlier run wrote, and nobody has changed since."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from command_lines import fail, results_in, succeed, write_inputs
from scenes import stone_model, stone_scene

from cgroup import InputError
from cgroup.datasets import standin_pair
from cgroup.io import read_cloud, write_cloud, write_correspondences, write_file, write_transform
from cgroup.io.result_folders import LIST, Results
from cgroup.rigid import apply
from cgroup.scenes import register_all
from cgroup.types import Correspondences

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="links, pipes and signals are Unix's")
Capture = pytest.CaptureFixture[str]

FIRST = {
    "register source.ply target.ply --html --merged": "source_on_target.txt",
    "merge source.ply target.ply --html": "poses.tum",
    "compare source.ply target.ply --truth truth.txt --html": "source_on_target_comparison.csv",
    "demo --html": "source.ply",
    "recognize stone.ply --scene scene.ply": "stone_in_scene.txt",
    "locate source.ply --map target.ply": "source_in_target.txt",
    "group matches.npz --method gtm": "matches_gtm_mask.txt",
    "detect source.ply": "keypoints.npz",
    "describe source.ply": "descriptors.npz",
}
"""The first file that each command writes."""

COMMANDS = {line.partition(" ")[0]: line.split() for line in FIRST}
FIRST_OF = dict(zip(COMMANDS, FIRST.values(), strict=True))


@pytest.fixture
def folder(elsewhere: Path) -> Path:
    write_inputs(elsewhere)
    model, scene = stone_model(1), stone_scene([1])[0]
    trimesh.Trimesh(model.points, model.faces, process=False).export("stone.ply")
    write_cloud("scene.ply", scene)
    return elsewhere


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
    name, out = FIRST_OF[command], folder / "out"
    out.mkdir()
    put(out / name)
    before = (out / name).lstat().st_ino
    assert f"{name}: is " in fail(capsys, *COMMANDS[command])
    assert results_in(out) == [name]
    assert (out / name).lstat().st_ino == before
    if put is link_to_file:
        assert Path("precious.txt").read_text() == "precious"


@pytest.mark.parametrize("command", ["merge", "group"])
def test_a_result_that_was_changed_is_refused(folder: Path, capsys: Capture, command: str) -> None:
    succeed(capsys, *COMMANDS[command])
    file = folder / "out" / FIRST_OF[command]
    file.write_bytes(file.read_bytes() + b"# mine\n")
    changed = file.read_bytes()
    assert f"{file.name}: is there, and not as cgroup wrote it" in fail(capsys, *COMMANDS[command])
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
def test_parts_of_killed_runs_are_removed_and_those_of_living_ones_stay(
    folder: Path, capsys: Capture
) -> None:
    """A part is locked as long as its process lives."""
    import fcntl  # noqa: PLC0415 - of Unix

    out = folder / "out"
    (out / ".cgroup-folder.part").mkdir(parents=True)
    os.mkfifo(out / ".cgroup-pipe.part")
    kept = {".cgroup-alive.part", ".cgroup-notes.txt", ".cgroup-folder.part", ".cgroup-pipe.part"}
    for name in (".cgroup-alive.part", ".cgroup-notes.txt", ".cgroup-dead.part"):
        (out / name).write_text("half")
    with (out / ".cgroup-alive.part").open() as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        succeed(capsys, *COMMANDS["group"])
        assert {path.name for path in out.glob(".cgroup-*")} >= kept
        assert not (out / ".cgroup-dead.part").exists()
    succeed(capsys, *COMMANDS["group"])
    assert not (out / ".cgroup-alive.part").exists()


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


def test_a_scan_that_changes_after_its_registration_is_refused(
    folder: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the same size and time too: the points are compared, not the file's date."""
    from cgroup.cli.commands import merge  # noqa: PLC0415

    before = Path("source.ply").stat()
    cloud = read_cloud("source.ply")
    write_cloud("other.ply", replace(cloud, points=apply(standin_pair().T_target_source, cloud.points)))

    def register_then_change(*scans: object, **options: object) -> object:
        scene = register_all(*scans, **options)  # type: ignore[arg-type]
        Path("source.ply").write_bytes(Path("other.ply").read_bytes())
        os.utime("source.ply", ns=(before.st_atime_ns, before.st_mtime_ns))
        return scene

    monkeypatch.setattr(merge, "register_all", register_then_change)
    said = fail(capsys, "merge", "source.ply", "target.ply", "--voxel", 5)
    assert "source.ply: was changed since it was registered" in said
    assert results_in(folder / "out") in ([], ["pairs.sqlite"])
