"""Pairs of scans on threads and on a Dask cluster, whose workers and scheduler may be lost, and kept pairs."""

from __future__ import annotations

import os
import pickle
import signal
import sqlite3
import subprocess
import sys
import threading
from contextlib import closing
from dataclasses import astuple, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import psutil
import pytest
from dask_clusters import make_cluster
from scene_tasks import count_calls, count_voxels, deadly, gated, odd_link, refuse, without_link

from benchmark_runs import make_environment, wait_until
from cgroup._runtime.cluster import reach_cluster
from cgroup.datasets import standin_pair
from cgroup.errors import InputError
from cgroup.registration import DenseFront, PreparedScan, prepare
from cgroup.scenes import workers
from cgroup.scenes.links import Link, confirm, link
from cgroup.scenes.workers import open_workers
from interrupts import interrupt, posix_only

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from dask_clusters import Cluster

    from cgroup.scenes.workers import Task

dask, distributed = pytest.importorskip("dask"), pytest.importorskip("distributed")

Bits = list[list[bytes] | None]

PAIRS = [((source, target), (None, "normal")) for source in range(3) for target in range(source)]


@pytest.fixture(scope="module")
def scans() -> list[PreparedScan]:
    """Three of one object; only the last one's viewpoint is known."""
    first, second = (standin_pair(seed=1, turn=turn, pixels=60) for turn in (40, 80))
    clouds = [(first.source, None), (first.target, None), (second.target, second.target_viewpoint)]
    return [prepare(cloud, voxel=6.0, viewpoint=eye, threads=1) for cloud, eye in clouds]


def confirmations(links: Sequence[Link | None]) -> list[Task]:
    return [(rows, (one.pose,)) for (rows, _), one in zip(PAIRS, links, strict=True) if one is not None]


def bits_of(links: Sequence[Link | None]) -> Bits:
    return [None if one is None else [np.asarray(part).tobytes() for part in astuple(one)] for one in links]


@pytest.fixture(scope="module")
def expected(scans: list[PreparedScan]) -> Bits:
    links = [link(scans[source], scans[target], None, "normal") for (source, target), _ in PAIRS]
    confirmed = [confirm(scans[rows[0]], scans[rows[1]], *rest) for rows, rest in confirmations(links)]
    assert len(confirmed) == 3
    return bits_of([*links, *confirmed])


def link_and_confirm(call: Callable[..., list[Any]]) -> Bits:
    links = call(link, PAIRS)
    return bits_of([*links, *call(confirm, confirmations(links))])


# --- threads ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("threads", [1, 3])
def test_results_are_in_the_order_of_the_tasks(
    scans: list[PreparedScan], expected: Bits, threads: int, tmp_path: Path
) -> None:
    told: list[str] = []
    sizes = [len(scan) for scan in scans]
    with open_workers(scans, threads, begin=told.append) as call:
        assert link_and_confirm(call) == expected
        arguments = (str(tmp_path),)
        assert call(count_voxels, [((0, 1, 2), arguments), ((1,), arguments)]) == [sum(sizes), sizes[1]]
        assert call(link, []) == []
    assert sorted(told[:3]) == ["pair 1 of 3", "pair 2 of 3", "pair 3 of 3"]
    assert sorted(told[6:]) == ["pair 1 of 2", "pair 2 of 2"]


@posix_only
def test_ctrl_c_ends_threads_once_they_are_through_with_their_pairs() -> None:
    program = """
import threading
from cgroup.scenes.workers import open_workers
calls = []
def work(scan):
    calls.append(scan)
    if len(calls) == 2:
        print("computing", flush=True)
    threading.Event().wait(0.05)
try:
    with open_workers([None], 2) as call:
        call(work, [((0,), ())] * 20_000)
except KeyboardInterrupt:
    print("interrupted", len(calls) < 20_000)
"""
    assert interrupt(program, after="computing") == "interrupted True\n"


# --- kept pairs ------------------------------------------------------------------------------------


@pytest.fixture
def keep(tmp_path: Path) -> Path:
    return tmp_path / "pairs.sqlite"


def test_kept_pairs_are_not_computed_again(scans: list[PreparedScan], expected: Bits, keep: Path) -> None:
    told: list[str] = []
    for _ in range(2):
        with open_workers(scans, 2, keep=keep, begin=told.append) as call:
            assert link_and_confirm(call) == expected
        assert len(told) == 6


def test_every_number_and_no_link_are_kept_but_no_other_result(
    scans: list[PreparedScan], keep: Path, tmp_path: Path
) -> None:
    task, found = ((1, 0), (str(tmp_path),)), []
    for _ in range(2):
        with open_workers(scans, 1, keep=keep) as call:
            found.append([*call(odd_link, [task]), *call(without_link, [task])])
            assert call(count_voxels, [task]) == [len(scans[0]) + len(scans[1])]
    assert bits_of(found[0]) == bits_of(found[1])
    assert count_calls(tmp_path) == 4


def test_a_pair_is_found_only_by_all_that_its_result_depends_on(
    scans: list[PreparedScan], keep: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pair, first, folder = standin_pair(seed=1, turn=40, pixels=60), scans[0], str(tmp_path)
    cloud = pair.source
    moved = replace(cloud, points=cloud.points + np.eye(len(cloud.points), 3) * 1e-9)
    again = prepare(cloud, voxel=6.0, threads=2)
    others = [
        prepare(cloud, voxel=6.5),
        prepare(cloud, voxel=6.0, viewpoint=pair.source_viewpoint),
        prepare(cloud, voxel=6.0, front=DenseFront(support=6.0)),
        prepare(moved, voxel=6.0),
    ]

    def calls_for(
        source: PreparedScan, function: Callable[..., Any], *rest: object, turned: bool = False
    ) -> int:
        before = count_calls(tmp_path)
        with open_workers([source, scans[1]], 1, keep=keep) as call:
            call(function, [((1, 0) if turned else (0, 1), (folder, *rest))])
        return count_calls(tmp_path) - before

    assert calls_for(first, without_link) == 1
    assert [calls_for(scan, without_link) for scan in (first, again)] == [0, 0]
    assert [calls_for(scan, without_link) for scan in others] == [1] * 4
    assert calls_for(first, without_link, turned=True) == 1
    assert calls_for(first, odd_link) == 1
    axes: list[object] = [None, np.eye(3), np.eye(3) + 1e-16, np.eye(3)[:1], [np.eye(3)], 1, 1.0, "1"]
    assert [calls_for(first, without_link, axis) for axis in axes] == [1, 1, 1, 1, 1, 1, 1, 1]
    assert [calls_for(first, without_link, axis) for axis in axes] == [0] * 8
    monkeypatch.setattr("cgroup.scenes.kept_links.__version__", "0")
    assert calls_for(first, without_link) == 1


def link_and_keep(scans: list[PreparedScan], keep: Path) -> None:
    with open_workers(scans, 1, keep=keep) as call:
        call(link, PAIRS)


def foreign(path: Path, *statements: str) -> bytes:
    with closing(sqlite3.connect(path)) as connection:
        for statement in statements:
            connection.execute(statement)
        connection.commit()
    return path.read_bytes()


def test_a_file_of_something_else_is_refused_and_left_alone(scans: list[PreparedScan], keep: Path) -> None:
    other = "create table links (key blob, link text)"
    link_and_keep(scans, keep)
    whole = keep.read_bytes()
    for content, reason in [
        (b"ply", "not a file of finished pairs"),
        (b"ply\n" * 4000, "not a file of finished pairs"),
        (lambda: foreign(keep, other), "not a file of finished pairs of this version"),
        (lambda: foreign(keep, other, "pragma application_id = 1667722347"), "of this version of cgroup"),
        (whole[:5000], "damaged"),
        (whole[:4096] + bytes(len(whole) - 4096), "damaged"),
    ]:
        keep.unlink()
        before = content() if callable(content) else content
        keep.write_bytes(before)
        with (
            pytest.raises(
                InputError, match=f"keep: got .*; .*{reason}.*; give another path, or move"
            ) as failed,
            open_workers(scans, 1, keep=keep) as call,
        ):
            call(link, PAIRS)
        assert "\n" not in str(failed.value)
        assert keep.read_bytes() == before


def test_a_damaged_row_is_reported(scans: list[PreparedScan], keep: Path) -> None:
    for text in ("{", "[]", '{"poses": 1}', "5"):
        with open_workers(scans, 1, keep=keep) as call:
            call(link, PAIRS)
            foreign(keep, f"update links set link = '{text}'")
            with pytest.raises(InputError, match=r"keep: got .*; damaged \("):
                call(link, PAIRS)
        keep.unlink()


def test_flipped_bits_of_a_row_are_reported(scans: list[PreparedScan], keep: Path) -> None:
    def results() -> list[Any]:
        with open_workers(scans, 1, keep=keep) as call:
            return [found and found.poses.tolist() for found in call(link, PAIRS)]

    expected, reported = results(), 0
    whole = keep.read_bytes()
    for place in range(whole.index(b'{"poses"'), len(whole), 311):
        keep.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        try:
            assert results() == expected  # of bytes that no row uses
        except InputError:
            reported += 1
    assert reported > 3


def test_a_path_that_cannot_be_a_file_is_refused(scans: list[PreparedScan], tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "none" / "pairs.sqlite"):
        with pytest.raises(InputError, match="keep: got .*; can't be read or written"):
            link_and_keep(scans, path)
    with pytest.raises(InputError, match="keep: got 5"):
        link_and_keep(scans, 5)  # pyright: ignore[reportArgumentType]


def count_kept(keep: Path) -> int:
    with closing(sqlite3.connect(keep)) as connection:
        return connection.execute("select count(*) from links").fetchone()[0]


def test_processes_share_a_file_and_one_that_is_killed_leaves_what_it_has_finished(
    scans: list[PreparedScan], expected: Bits, keep: Path, tmp_path: Path
) -> None:
    """All make the file and link all pairs at the same time; then one is killed at a pair."""
    (tmp_path / "scans").write_bytes(pickle.dumps(scans))
    folder = str(tmp_path)
    program = f"""
import pickle, sys
from pathlib import Path
from scene_tasks import gated
from cgroup.scenes.links import link
from cgroup.scenes.workers import open_workers
scans = pickle.loads(Path({folder!r}, "scans").read_bytes())
print("ready", flush=True)
sys.stdin.readline()
with open_workers(scans, 2, keep={str(keep)!r}) as call:
    for source, target in ((1, 0), (2, 0), (2, 1)):
        call(link, [((source, target), (None, "normal"))])
    if sys.argv[1:]:
        call(gated, [((1, 0), ({folder!r},))])
"""
    started = [
        subprocess.Popen(
            [sys.executable, "-c", program, *rest],
            env=make_environment(),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        for rest in (["gated"], [], [])
    ]
    for process in started:
        assert process.stdout is not None
        process.stdout.readline()
    killed, *others = started
    for process in started:
        assert process.stdin is not None
        process.stdin.write(b"go\n")
        process.stdin.flush()
    for process in others:
        process.communicate()
    wait_until(lambda: count_calls(tmp_path) == 1, "no pair")
    killed.kill()
    killed.communicate()
    assert [process.returncode for process in others] == [0, 0]
    assert count_kept(keep) == 3
    with open_workers(scans, 1, keep=keep, begin=pytest.fail) as call:
        assert bits_of(call(link, PAIRS)) == expected[:3]


# --- Dask ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a scheduler with two workers, which nobody kills."""
    for address, _ in make_cluster(tmp_path_factory.mktemp("sound"), workers=2):
        yield address


@pytest.fixture
def cluster(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Cluster]:
    """Two workers and a scheduler; the parameter is how many lost workers a task may have been on."""
    yield from make_cluster(tmp_path / "dask", getattr(request, "param", 3), workers=2)


def test_a_cluster_gives_the_same_bits_and_a_client_stays_as_it_was(
    scans: list[PreparedScan], expected: Bits, sound: str, keep: Path
) -> None:
    told: list[str] = []
    with open_workers(scans, None, sound, keep, told.append) as call:
        assert link_and_confirm(call) == expected
    assert told[:3] == ["pair 1 of 3", "pair 2 of 3", "pair 3 of 3"]
    with distributed.Client(sound, set_as_default=False) as client:
        with open_workers(scans, None, client) as call:
            assert link_and_confirm(call) == expected
            assert sum("Scan" in key for key in client.futures) == 3
            with pytest.raises(InputError, match="voxel: got 3; give 4"):
                call(refuse, [((1, 0), ())] * 6)
        assert client.submit(pow, 2, 3).result() == 8
        wait_until(lambda: not client.futures, "futures are left")
    with open_workers(scans, None, sound, keep, pytest.fail) as call:
        assert link_and_confirm(call) == expected


def test_a_local_scheduler_gives_the_same_bits_and_opens_no_port(
    scans: list[PreparedScan], expected: Bits
) -> None:
    before = listening_ports()
    with reach_cluster("local", 2) as client:
        assert client.submit(pow, 2, 3).result() == 8
        assert listening_ports() == before
        address = client.scheduler_info()["address"]
        program = f"from distributed import Client; Client({address!r}, timeout=2).submit(print)"
        foreign = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
        assert foreign.returncode != 0
        assert "does not match host" in foreign.stderr
    with open_workers(scans, 2, "local") as call:
        assert link_and_confirm(call) == expected


def listening_ports() -> set[int]:
    """Ports of TCP at which this process listens."""
    connections = psutil.Process().net_connections("tcp")
    return {each.laddr.port for each in connections if each.status == psutil.CONN_LISTEN}


@pytest.mark.skipif(os.name == "nt", reason="there is no kill -9")
def test_a_lost_worker_costs_its_pairs_only(
    scans: list[PreparedScan], expected: Bits, cluster: Cluster, tmp_path: Path
) -> None:
    address, (killed, *_) = cluster
    with open_workers(scans, None, address) as call:
        assert link_and_confirm(call) == expected  # each worker has scans of its own now
        thread = threading.Thread(target=kill_at_a_pair, args=(killed, tmp_path))
        thread.start()
        found = call(gated, [(rows, (str(tmp_path),)) for rows, _ in PAIRS])
        thread.join()
    assert bits_of(found) == expected[:3]
    assert count_calls(tmp_path) > 3


def kill_at_a_pair(worker: subprocess.Popen[bytes], folder: Path) -> None:
    """Kill a worker once both are at a pair, and let the other go on."""
    wait_until(lambda: count_calls(folder) == 2, "two pairs")
    worker.kill()
    worker.wait()
    (folder / "open").touch()


@pytest.mark.parametrize("cluster", [1], indirect=True)
def test_a_pair_that_ends_its_workers_is_named(scans: list[PreparedScan], cluster: Cluster) -> None:
    with (
        pytest.raises(InputError, match="scheduler: workers die of scans 2 and 1; give workers more memory"),
        open_workers(scans, None, cluster[0]) as call,
    ):
        call(deadly, [((2, 1), ())])


def test_what_was_finished_before_the_scheduler_is_lost_is_kept(
    scans: list[PreparedScan], expected: Bits, cluster: Cluster, keep: Path
) -> None:
    address, (*_, scheduler) = cluster
    tasks = [*PAIRS, *((rows[::-1], rest) for rows, rest in PAIRS)]

    def kill_scheduler(pair: str) -> None:
        if pair == "pair 5 of 6":  # four are under way at most
            scheduler.kill()
            scheduler.wait()

    lost = pytest.raises(InputError, match=r"scheduler: the connection is lost .*; .*call again")
    quickly = dask.config.set({"distributed.comm.timeouts.connect": "1s"})
    with quickly, lost as failed, open_workers(scans, None, address, keep, kill_scheduler) as call:
        call(link, tasks)
    assert "\n" not in str(failed.value)
    kept, told = count_kept(keep), []
    assert kept >= 1
    with open_workers(scans, None, keep=keep, begin=told.append) as call:
        assert bits_of(call(link, tasks))[:3] == expected[:3]
    assert len(told) == 6 - kept


@posix_only
def test_ctrl_c_cancels_what_a_cluster_is_at(
    scans: list[PreparedScan], cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "scans").write_bytes(pickle.dumps(scans))
    folder = str(tmp_path)
    program = f"""
import pickle, threading
from pathlib import Path
from distributed import Client
from benchmark_runs import wait_until
from scene_tasks import count_calls, gated
from cgroup.scenes.workers import open_workers
folder = Path({folder!r})
def tell():
    wait_until(lambda: count_calls(folder) == 2, "two pairs")
    print("computing", flush=True)
scans = pickle.loads((folder / "scans").read_bytes())
with Client({cluster[0]!r}, set_as_default=False) as client:
    threading.Thread(target=tell).start()
    try:
        with open_workers(scans, None, client) as call:
            call(gated, [((1, 0), (str(folder),))] * 10)
    except KeyboardInterrupt:
        print("interrupted")
    wait_until(lambda: not client.futures, "futures are left")
    (folder / "open").touch()
    print(client.submit(pow, 2, 3).result(), count_calls(folder))
"""
    monkeypatch.setenv("PYTHONPATH", make_environment()["PYTHONPATH"])
    assert interrupt(program, after="computing") == "interrupted\n8 2\n"


@posix_only
def test_ctrl_c_in_a_terminal_ends_a_local_scheduler_in_silence(tmp_path: Path) -> None:
    """A terminal sends it to all processes of the group, if there are any."""
    program = tmp_path / "program.py"
    program.write_text(
        """
from cgroup.scenes.workers import open_workers
from scene_tasks import count_voxels
if __name__ == "__main__":
    def tell(pair):
        if pair.startswith("pair 9 "):  # so the first has come back
            print("computing", flush=True)
    try:
        with open_workers([range(3)], 2, "local", begin=tell) as call:
            call(count_voxels, [((0,), ("FOLDER",))] * 10_000)
    except KeyboardInterrupt:
        print("interrupted")
""".replace("FOLDER", str(tmp_path))
    )
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    command = [sys.executable, str(program)]
    with subprocess.Popen(command, env=make_environment(), start_new_session=True, **pipes) as process:  # pyright: ignore[reportCallIssue]
        assert process.stdout is not None
        assert process.stdout.readline() == b"computing\n"
        os.killpg(process.pid, signal.SIGINT)
        assert process.communicate() == (b"interrupted\n", b"")


def test_workers_of_another_version_are_refused(
    scans: list[PreparedScan], sound: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "__version__", "0")
    with (
        pytest.raises(InputError, match="scheduler: its workers have cgroup .*, not 0 as here; install"),
        open_workers(scans, None, sound) as call,
    ):
        call(link, PAIRS)


@pytest.mark.parametrize(
    ("scheduler", "reason"),
    [
        ("nowhere", "scheduler: got 'nowhere'; it can't be reached: missing port number"),
        ("tcp://127.0.0.1:1", "scheduler: got 'tcp://127.0.0.1:1'; it can't be reached: .*"),
        (5, "scheduler: got 5; give an address, a distributed.Client, or 'local'"),
    ],
)
def test_a_scheduler_that_cannot_be_reached_is_one_sentence(scheduler: object, reason: str) -> None:
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "100ms"}),
        pytest.raises(InputError, match=reason),
        open_workers([], None, scheduler),
    ):
        pass


def test_without_dask_it_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match="scheduler: dask isn't installed"), open_workers([], None, "local"):
        pass
