"""Many pairs at once: the same answers as one by one, each scan made ready once, stopped as one."""

from dataclasses import replace

import numpy as np
import pytest

from cgroup import InputError, NoConsensusError
from cgroup.datasets import standin_pair
from cgroup.registration import prepare, register, register_many
from cgroup.rigid import rotation_error
from interrupts import interrupt, posix_only

PAIRS = [standin_pair(seed=seed, pixels=80) for seed in (0, 1)]
SCANS = [PAIRS[0].target, PAIRS[0].source, PAIRS[1].source, PAIRS[1].target]
EYES = [(0.0, 0.0, 0.0)] * len(SCANS)


def test_registers_as_one_by_one_does() -> None:
    pairs = [(1, 0), (2, 0), (2, 3)]
    found = register_many(SCANS, pairs, voxel=3.0, viewpoints=EYES)
    scans = [prepare(scan, voxel=3.0, viewpoint=EYES[0]) for scan in SCANS]
    for (source, target), one in zip(pairs, found, strict=True):
        try:
            alone = register(scans[source], scans[target])
        except NoConsensusError as error:
            alone = error.registration
        assert one.ok == alone.ok == (source // 2 == target // 2)
        assert one.probability == alone.probability
        np.testing.assert_array_equal(one.T_target_source, alone.T_target_source)
    assert rotation_error(found[0].T_target_source, PAIRS[0].T_target_source) < 0.5


def test_by_default_all_pairs_are_registered() -> None:
    told: list[str] = []
    found = register_many(SCANS[:3], threads=1, progress=told.append)
    assert [one is not None and one.ok for one in found] == [True, False, False]
    assert told == ["scan 1 of 3", "scan 2 of 3", "scan 3 of 3", *(f"pair {k} of 3" for k in (1, 2, 3))]


def test_the_number_of_threads_changes_nothing() -> None:
    one, two = (register_many(SCANS[:2], effort="low", threads=threads)[0] for threads in (1, 2))
    np.testing.assert_array_equal(one.T_target_source, two.T_target_source)


def test_a_prepared_scan_is_used_as_it_is() -> None:
    ready = prepare(SCANS[0], voxel=3.0)
    (found,) = register_many([ready, SCANS[1]])
    assert found.ok
    assert found.voxel == 3.0
    with pytest.raises(InputError, match="prepared with voxels"):
        register_many([ready, replace(ready, voxel=4.0)])


@pytest.mark.parametrize(
    ("scans", "pairs", "words"),
    [
        ([SCANS[0], np.eye(3)], None, r"scans\[1\]: got 3 points"),
        (SCANS[:2], [(0, 1), (0, 2)], r"pairs\[1\]: got \(0, 2\), but there are 2 scans"),
        (SCANS[:2], [(0, -1)], r"pairs\[0\]: got -1"),
        (SCANS[:3], None, "viewpoints: got 2 for 3"),
        ([], None, "scans: got none"),
    ],
)
def test_names_what_can_not_be_worked_with(scans: list, pairs: list | None, words: str) -> None:
    with pytest.raises(InputError, match=words):
        register_many(scans, pairs, viewpoints=EYES[:2] if len(scans) == 3 else None)


@posix_only
def test_ctrl_c_stops_all_pairs() -> None:
    program = """
import threading
from cgroup.datasets import standin_pair
from cgroup.registration import register_many
pair = standin_pair(pixels=80)
begun = threading.Event()
def tell(stage):
    if stage == "pair 3 of 2000" and not begun.is_set():
        begun.set()
        print("computing", flush=True)
try:
    register_many([pair.source, pair.target], [(0, 1)] * 2000, progress=tell)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""
    assert interrupt(program, after="computing").endswith("interrupted\n")
