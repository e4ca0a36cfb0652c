"""The comparison with other libraries: seeded cases, honest records, runs that go on, a report of what is there."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

BENCHES = Path(__file__).resolve().parents[2] / "benches"
if not BENCHES.exists():
    pytest.skip("the benches are not part of this copy", allow_module_level=True)
sys.path.insert(0, str(BENCHES))

pytest.importorskip("scipy")

from typer.testing import CliRunner  # noqa: E402

from peers import cgroup_peers, measure, numpy_peers, plan, run  # noqa: E402
from peers import report as reporting  # noqa: E402
from peers.answers import judge, pack, rigid, selected_by, unpack, within  # noqa: E402
from peers.cases import ensure_case, load_case, make_case, write_case  # noqa: E402
from peers.catalogue import PEERS, selected  # noqa: E402
from peers.environment import Environment, child_environment, describe  # noqa: E402
from peers.plan import Settings, hopeless, is_settled  # noqa: E402
from peers.records import Journal, Run, summaries  # noqa: E402
from peers.report import report  # noqa: E402

N, SHARE = 300, 0.2
TIMED = {"times_s": [0.5], "base_mib": 30.0, "peak_mib": 34.0, "others": 0.1}
GOOD = {"median_s": 0.5, "f": 0.9, "differs": 3, **TIMED}
RAW = {"mask": pack(np.ones(N, bool)), **TIMED}


@pytest.fixture(scope="module")
def case_path(tmp_path_factory):
    return ensure_case(tmp_path_factory.mktemp("cases"), N, SHARE)


@pytest.fixture(scope="module")
def case(case_path):
    return load_case(case_path)


def local_environment(missing=None):
    return Environment({"cgroup": (sys.executable,), "numpy": (sys.executable,)}, {}, missing or {})


def test_a_case_is_the_same_twice_and_another_with_other_arguments(case, tmp_path, case_path):
    assert not np.array_equal(make_case(N, 0.1)["src"], case["src"])
    write_case(tmp_path / "again.bin", make_case(N, SHARE))
    assert (tmp_path / "again.bin").read_bytes() == case_path.read_bytes()
    for key, value in make_case(N, SHARE).items():
        assert value.dtype == case[key].dtype, key
        np.testing.assert_array_equal(value, case[key], err_msg=key)


def test_the_truth_holds(case):
    assert case["gt"].sum() == N * SHARE
    truth = np.flatnonzero(case["gt"])
    source, target = case["src"][truth].astype(float), case["tgt"][truth].astype(float)
    u, _, vt = np.linalg.svd((source - source.mean(0)).T @ (target - target.mean(0)))
    rotation = vt.T @ np.diag([1, 1, np.linalg.det(vt.T @ u.T)]) @ u.T
    pose = rigid(rotation, target.mean(0) - rotation @ source.mean(0))
    np.testing.assert_array_equal(within(case, pose), case["gt"] == 1)
    assert len(np.unique(case["src"], axis=0)) == N
    for key in ("lrf_src", "lrf_tgt"):
        products = np.einsum("nai,nbi->nab", case[key], case[key])
        np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), products.shape), atol=1e-5)
        np.testing.assert_allclose(np.linalg.det(case[key]), 1, atol=1e-5)


def test_every_method_of_ours_is_a_peer():
    ours = [peer for peer in PEERS.values() if peer.program == "cgroup"]
    assert {peer.name for peer in ours} == set(cgroup_peers.PEERS)
    assert {peer.method for peer in PEERS.values()} == {peer.method for peer in ours}
    assert {peer.name for peer in PEERS.values() if peer.program == "numpy"} == set(numpy_peers.PEERS)


@pytest.mark.parametrize("name", cgroup_peers.PEERS)
def test_our_record_is_complete(name, case_path):
    record = run.assess(measure.run("cgroup", name, case_path, 1), PEERS[name], case_path)
    assert len(record["times_s"]) == measure.MOST_REPETITIONS
    assert min(record["times_s"]) <= record["median_s"] <= max(record["times_s"])
    assert 0 < record["f"] <= 1
    assert 0 < record["selected"] <= N
    assert record["differs"] is None
    if sys.platform == "linux":
        assert record["peak_mib"] >= record["base_mib"] > 0
    assert json.loads(json.dumps(record)) == record


@pytest.mark.parametrize("share", [0.5, 0.1, 0.03])
@pytest.mark.parametrize("name", numpy_peers.PEERS)
def test_numpy_masks_equal_ours(name, share, tmp_path):
    path = ensure_case(tmp_path, N, share)
    case = load_case(path)
    mask = selected_by(case, numpy_peers.PEERS[name](case, 1)())
    np.testing.assert_array_equal(mask, run.our_mask(PEERS[name].method, path))


def test_a_mask_that_is_not_ours_is_counted(case):
    ours = case["gt"] == 1
    other = ours.copy()
    other[:7] = ~other[:7]
    assert judge(case, ours, ours)["differs"] == 0
    assert judge(case, other, ours)["differs"] == 7
    np.testing.assert_array_equal(unpack(pack(other), N), other)
    nothing = {"selected": 0, "precision": 0, "recall": 0, "f": 0, "differs": None}
    assert judge(case, selected_by(case, (None, None)), None) == nothing


@pytest.mark.parametrize(("bound", "calls"), [("LONG", 1), ("BUDGET", measure.LEAST_REPETITIONS)])
def test_a_long_call_is_made_once_and_others_at_least_thrice(monkeypatch, bound, calls):
    monkeypatch.setattr(measure, bound, 0.0)
    answer, times = measure.measure(lambda: (None, None))
    assert answer == (None, None)
    assert len(times) == calls


def test_what_is_recorded_is_settled():
    work = Run("np_gc", 500, 0.1, 1, 0)
    later = work._replace(round=1)
    assert not is_settled(work, {})
    assert is_settled(work, {work: GOOD})
    assert not is_settled(later, {work: GOOD})
    assert is_settled(later, {work: GOOD | {"median_s": plan.SLOW * 2}})
    assert is_settled(later, {work: {"failed": "time", "why": ""}})


def test_hopeless_runs_are_not_started():
    settings = Settings()
    small, large = Run("np_gtm", 5000, 0.1, 1, 0), Run("np_gtm", 20_000, 0.1, 1, 0)
    assert hopeless(small, {}, settings) is None
    assert hopeless(large, {}, settings)["failed"] == "memory"
    slow = {small._replace(peer="np_si"): {"failed": "time", "why": ""}}
    assert hopeless(large._replace(peer="np_si"), slow, settings)["failed"] == "time"
    assert hopeless(large._replace(peer="np_si", threads=2), slow, settings) is None
    small, middle, large = (Run("cgroup_gtm", n, 0.1, 1, 0) for n in (10_000, 20_000, 100_000))
    done = {small: GOOD | {"median_s": 2.0}, middle: GOOD | {"median_s": 8.0}}
    assert plan.extrapolated(large, done) == pytest.approx(200)
    assert hopeless(large, done, settings)["failed"] == "time"
    assert hopeless(large, done, Settings(seconds=300.0)) is None
    assert plan.extrapolated(middle, done) == 0


def test_a_journal_survives_being_cut_off(tmp_path):
    path = tmp_path / "results.jsonl"
    first, second = Run("np_gc", 500, 0.1, 1, 0), Run("np_gc", 500, 0.1, 1, 1)
    Journal(path).add(first, GOOD)
    with path.open("a") as file:
        file.write('{"peer": "np_gc", "n": 50')
    journal = Journal(path)
    assert list(journal.runs) == [first]
    journal.add(second, GOOD)
    assert list(Journal(path).runs) == [first, second]


def test_what_is_recorded_is_skipped(tmp_path, case_path, monkeypatch):
    settings = Settings(sizes=(N,), shares=(SHARE,), threads=(1,), rounds=1)
    journal = Journal(tmp_path / "results.jsonl")
    shutil.copytree(case_path.parent, tmp_path / "cases")
    peers = selected(["cgroup_ss", "cgroup_nnsr"])
    run.run_all(settings, peers[:1], local_environment(), journal)
    assert [work.peer for work in journal.runs] == ["cgroup_ss"]
    assert journal.runs[Run("cgroup_ss", N, SHARE, 1, 0)]["f"] > 0

    started = []
    monkeypatch.setattr(run, "run_process", lambda command, *_, **__: started.append(command[4]) or dict(RAW))
    run.run_all(settings, peers, local_environment(), Journal(journal.path))
    assert started == ["cgroup_nnsr"]


def test_how_a_process_ended_is_recorded():
    def ended(code, **limits):
        command = [sys.executable, "-c", code]
        return run.run_process(command, child_environment(1), **{"seconds": 30, "mib": 4096} | limits)

    assert ended("import time; time.sleep(60)", seconds=0.3)["failed"] == "time"
    failure = ended("import sys; sys.exit('no luck')")
    assert (failure["failed"], failure["why"]) == ("error", "exit code 1: no luck")
    assert ended("import os; os.kill(os.getpid(), 9)")["why"].startswith("exit code -9")
    if sys.platform == "linux":
        hungry = ended("import time; x = bytearray(b'1') * (200 << 20); time.sleep(60)", mib=100)
        assert hungry["failed"] == "memory"


def test_command_line(tmp_path, monkeypatch):
    monkeypatch.setattr(reporting, "FIGURES", {"seconds": "time"})  # drawing both takes twice as long
    options = ["--n", "50,60", "--ratio", "0.5", "--peers", "cgroup_ss", "--threads", "1"]
    options += ["--out", str(tmp_path)]
    first = CliRunner().invoke(run.app, [*options, "--rounds", "1"], catch_exceptions=False)
    assert first.exit_code == 0
    journal = Journal(tmp_path / "results.jsonl")
    assert [work.n for work in journal.runs] == [50, 60]
    for name in ("report.md", "time.png", "time.pdf"):
        assert (tmp_path / name).stat().st_size > 0

    journal.add_session(journal.sessions[0] | {"identity": {"cpu": "another"}})
    other = CliRunner().invoke(run.app, options)
    assert other.exit_code == 2
    assert "another machine or build" in " ".join(other.output.split())
    assert CliRunner().invoke(run.app, ["--peers", "nobody"]).exit_code == 2


@pytest.fixture
def journal(tmp_path):
    journal = Journal(tmp_path / "results.jsonl")
    missing = {"pcl": "cmake is missing; apt-get install libpcl-dev cmake", "_teaserpp": "build it"}
    journal.add_session(describe(local_environment(missing)))
    for n in (500, 2000, 5000, 10_000):
        for threads in (1, 2):
            for number in range(2):
                seconds = n**2 * 1e-9 / threads
                journal.add(Run("cgroup_gc", n, 0.1, threads, number), GOOD | {"median_s": seconds})
        journal.add(Run("np_gc", n, 0.1, 1, 0), GOOD | {"median_s": n**2 * 1e-8, "peak_mib": 30 + n**2 / 3e4})
    journal.add(Run("np_gtm", 20_000, 0.1, 1, 0), {"failed": "memory", "why": "not run: would take 16 GiB"})
    return journal


def test_the_report_says_what_is_there_and_what_is_not(journal):
    text = report(journal, summaries(journal))
    assert "| **cgroup GC** | 0.90 | 3 | 25.0 |  | 4.0 | 12.5 |  | 4.0 |" in text
    assert "| NumPy GC, n x n | 0.90 | 3 | 250 | 10.0 x | 833.3 | 250 | 20.0 x | 833.3 |" in text
    assert "| cgroup GC | 2.00 | 2.00 | 0.00 | 0.00 |" in text
    assert "- not available: PCL: cmake is missing; apt-get install libpcl-dev cmake" in text
    assert "- not available: TEASER++: build it" in text
    assert "- PCL Hough: not available: cmake is missing" in text
    assert "| NumPy GC, n x n | in 0 of 4 cases |  |" in text
    assert "- NumPy GTM, n = 20,000, 10% inliers, 1 thread: not run: would take 16 GiB" in text
    assert "| NumPy GTM | - | - | too much memory | - | - |" in text
    assert "- Open3D FGR: not asked for, or not yet" in text
