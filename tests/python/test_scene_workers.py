"""Pairs of scans on threads and on a Dask cluster, whose workers and scheduler may be lost, and kept pairs."""

import pickle
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from dask_clusters import make_cluster
from scene_tasks import count_calls, count_voxels, deadly, odd_link, refuse, without_link

from benchmark_runs import make_environment, wait_until
from cgroup._runtime.cluster import reach_cluster
from cgroup.datasets import standin_pair
from cgroup.errors import InputError
from cgroup.registration import DenseFront, PreparedScan, prepare
from cgroup.scenes import workers
from cgroup.scenes.links import Link, confirm, link
from cgroup.scenes.workers import Task, open_workers

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
        source: PreparedScan, *rest: object, function: Any = without_link, rows: Any = (0, 1)
    ) -> int:
        before = count_calls(tmp_path)
        with open_workers([source, scans[1]], 1, keep=keep) as call:
            call(function, [(rows, (folder, *rest))])
        return count_calls(tmp_path) - before

    assert [calls_for(scan) for scan in (first, first, again, *others)] == [1, 0, 0, 1, 1, 1, 1]
    assert calls_for(first, rows=(1, 0)) == calls_for(first, function=odd_link) == 1
    axes: list[object] = [None, np.eye(3), np.eye(3) + 1e-16, np.eye(3)[:1], [np.eye(3)], 1, 1.0, "1"]
    assert [calls_for(first, axis) for axis in axes * 2] == [1] * 8 + [0] * 8
    monkeypatch.setattr("cgroup.scenes.kept_links.__version__", "0")
    assert calls_for(first) == 1


def link_and_keep(scans: list[PreparedScan], keep: Path) -> None:
    with open_workers(scans, 1, keep=keep) as call:
        call(link, PAIRS)


def test_a_file_of_something_else_is_refused_and_left_alone(scans: list[PreparedScan], keep: Path) -> None:
    link_and_keep(scans, keep)
    whole, other = keep.read_bytes(), keep.with_name("other.sqlite")
    for statement in ("create table links (key blob, link text)", "pragma application_id = 1667722347"):
        with closing(sqlite3.connect(other)) as connection:
            connection.execute(statement)
            connection.commit()
    for content, reason in [
        (b"ply\n" * 4000, "not a file of finished pairs"),
        (other.read_bytes(), "of this version of cgroup"),
        (whole[:5000], "damaged"),
        (whole[:4096] + bytes(len(whole) - 4096), "damaged"),
    ]:
        keep.write_bytes(content)
        with pytest.raises(InputError, match=f"keep: got .*; .*{reason}.*; give another path, or move"):
            link_and_keep(scans, keep)
        assert keep.read_bytes() == content


def test_flipped_bits_of_a_row_are_reported(scans: list[PreparedScan], keep: Path) -> None:
    link_and_keep(scans, keep)
    whole = keep.read_bytes()
    for offset in (40, 400, 800):
        place = whole.index(b'{"poses"') + offset
        keep.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        with pytest.raises(InputError, match=r"keep: got .*; damaged \("):
            link_and_keep(scans, keep)


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
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "env": make_environment()}
    started = [
        subprocess.Popen([sys.executable, "-c", program, *rest], **pipes) for rest in (["gated"], [], [])
    ]
    for process in started:
        process.stdout.readline()
    for process in started:
        process.stdin.write(b"go\n")
        process.stdin.flush()
    killed, *others = started
    for process in others:
        process.communicate()
    wait_until(lambda: count_calls(tmp_path) == 1, "no pair")
    killed.kill()
    killed.communicate()
    assert [process.returncode for process in others] == [0, 0]
    assert count_kept(keep) == 3
    with open_workers(scans, 1, keep=keep, begin=pytest.fail) as call:
        assert bits_of(call(link, PAIRS)) == expected[:3]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a scheduler with two workers, which nobody kills."""
    for address, _ in make_cluster(tmp_path_factory.mktemp("sound"), workers=2):
        yield address


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
    with reach_cluster("local", 2) as client:
        assert client.submit(pow, 2, 3).result() == 8
        connections = psutil.Process().net_connections("tcp")
        assert not [each for each in connections if each.status == psutil.CONN_LISTEN]
    with open_workers(scans, 2, "local") as call:
        assert link_and_confirm(call) == expected


def test_workers_of_another_version_are_refused(
    scans: list[PreparedScan], sound: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "__version__", "0")
    with (
        pytest.raises(InputError, match="scheduler: its workers have cgroup .*, not 0 as here; install"),
        open_workers(scans, None, sound) as call,
    ):
        call(link, PAIRS)


@pytest.fixture
def fragile(tmp_path: Path) -> Iterator[str]:
    """Address of a scheduler that gives up a task after it has lost one worker."""
    for address, _ in make_cluster(tmp_path / "dask", 1, workers=2):
        yield address


def test_a_pair_that_ends_its_workers_is_named(scans: list[PreparedScan], fragile: str) -> None:
    with (
        pytest.raises(InputError, match="scheduler: workers die of scans 2 and 1; give workers more memory"),
        open_workers(scans, None, fragile) as call,
    ):
        call(deadly, [((2, 1), ())])
