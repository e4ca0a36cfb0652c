"""The public face of the methods: what it accepts, what it refuses, and what it promises."""

import inspect
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from wrong_values import HUGE

import cgroup
from cgroup import METHODS, PRESETS, Correspondences, InputError, NoConsensusError, group, group_many
from cgroup.registry import METHOD_INFO
from interrupts import assert_hears_interrupt, assert_holds_in_a_fork, posix_only
from strategies import make_problem

PROBLEM = make_problem(np.random.default_rng(3), 120, inlier_ratio=0.4)
OPTIONS = {"3dhv": {"bin_size": 5.0}}


def correspondences(n: int = 120) -> Correspondences:
    return PROBLEM.subset(np.arange(n)).correspondences()


def read_only(array: np.ndarray) -> np.ndarray:
    copy = array.copy()
    copy.flags.writeable = False
    return copy


class Wrapped:
    """Anything with ``__array__``."""

    def __init__(self, array: np.ndarray) -> None:
        self.array = array

    def __array__(self, dtype: object = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.array, dtype=dtype, copy=copy)


def packed_record(array: np.ndarray) -> np.ndarray:
    record = np.zeros(len(array), dtype=[("tag", "u1"), ("values", array.dtype, array.shape[1:])])
    record["values"] = array
    return record["values"]


LAYOUTS = (
    packed_record,
    lambda array: np.repeat(array, 2, axis=0)[::2],
    lambda array: array[::-1].copy()[::-1],
    np.asfortranarray,
    read_only,
    lambda array: array.astype(array.dtype.newbyteorder()),
    lambda array: array.tolist(),
    Wrapped,
)
ARRAYS = ("source", "target", "similarity", "ratio", "source_lrf", "target_lrf", "source_centroid")


def grouped(method, arrays):
    return group(Correspondences(**arrays, resolution=1.0), method)


def directly(method, arrays):
    """Call the method's own function, with no `Correspondences` in between."""
    taken = inspect.signature(METHODS[method]).parameters
    given = arrays | {"resolution": 1.0}
    return METHODS[method](**{name: value for name, value in given.items() if name in taken})


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("method", METHODS)
def test_layout_and_precision_change_nothing_and_input_stays(method, dtype):
    arrays = {name: getattr(PROBLEM, name).astype(dtype) for name in ARRAYS}
    expected = grouped(method, {name: array.astype(np.float64) for name, array in arrays.items()})
    for layout in LAYOUTS:
        given = {name: layout(array) for name, array in arrays.items()}
        for call in (grouped, directly):
            got = call(method, given)
            np.testing.assert_array_equal(got.mask, expected.mask)
            np.testing.assert_array_equal(got.scores, expected.scores)
            if call is grouped and got.size > 2:
                np.testing.assert_array_equal(got.transform(), expected.transform())
        for name, array in given.items():
            np.testing.assert_array_equal(np.asarray(array), arrays[name])


def test_correspondences_keep_precision_and_nothing_else():
    given = PROBLEM.source.astype(np.float32)
    before, kept = given.copy(), Correspondences(given, PROBLEM.target)
    given[:] = 7.0  # the buffer gets the next frame
    assert kept.source.dtype == np.float32
    np.testing.assert_array_equal(kept.source, before)
    with pytest.raises(ValueError, match="read-only"):
        kept.source[:] = 0.0


@pytest.mark.parametrize("method", ["sc2pcr", "turboreg"])
def test_a_search_that_memory_cuts_short_says_so(method):
    whole, cut = (group(correspondences(), method, max_memory=memory) for memory in (2048, 600))
    assert whole.complete
    assert "vertices" not in whole.diagnostics
    assert not cut.complete
    assert cut.diagnostics["vertices"] == 64
    assert cut.mask[PROBLEM.inlier_mask].mean() > 0.9


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"source": PROBLEM.source.T}, "source.*transpose"),
        ({"target": PROBLEM.target[:-1]}, "target.*119"),
        ({"source": PROBLEM.source.astype(complex)}, "source.*complex"),
        ({"ratio": PROBLEM.ratio[:5]}, r"ratio.*\(5\).*\(120,\)"),
        ({"ratio": PROBLEM.ratio + 1.0}, "ratio.*row 0.*between 0 and 1"),
        ({"similarity": np.full(120, np.nan)}, "similarity.*row 0"),
        ({"source_lrf": PROBLEM.source_lrf * 2.0}, "source_lrf.*row .*orthonormal"),
        ({"source_lrf": PROBLEM.source_lrf[:, ::-1]}, "source_lrf.*right-handed"),
        ({"source_lrf": PROBLEM.source_lrf.reshape(120, 9)}, r"source_lrf.*\(120,3,3\)"),
        ({"target_lrf": None}, "target_lrf.*both sides"),
        ({"resolution": 0.0}, "resolution.*greater than 0"),
        ({"source_centroid": [0.0, np.inf, 0.0]}, "source_centroid.*finite"),
        ({"source": np.full((120, 3), 1e200)}, "source.*1e150"),
        ({"candidates": PROBLEM.target}, r"candidates.*\(120,3\).*\(120,k,3\)"),
        ({"candidates": np.full((120, 2, 3), np.nan)}, "candidates.*finite"),
    ],
)
def test_bad_fields(change, words):
    method = {"similarity": "ss", "source_centroid": "3dhv", "candidates": "sc2pcr"}.get(
        next(iter(change)), "cv"
    )
    fields = {name: getattr(PROBLEM, name, None) for name in cgroup.types.OPTIONAL_FIELDS}
    fields = {"source": PROBLEM.source, "target": PROBLEM.target, **fields, **change}
    with pytest.raises(InputError, match=f"(?s){words}"):
        group(Correspondences(**fields), method)


@pytest.mark.parametrize("name", ["source", "target", "source_lrf", "target_lrf"])
def test_the_first_wrong_row_is_named(name):
    arrays = {each: getattr(PROBLEM, each).copy() for each in ("source", "target", *ARRAYS[4:6])}
    if "lrf" in name:
        arrays[name][[17, 23]] *= 1.1
    else:
        arrays[name][[17, 23], 1] = np.nan, np.inf
    with pytest.raises(InputError, match=f"{name}.*row 17"):
        cgroup.hough3d(**arrays)


@pytest.mark.parametrize(
    ("method", "options", "words"),
    [
        ("ransac", {"threads": 10**6}, "threads.*at most"),
        ("st", {"eigensolver": "dense", "max_memory": 1000}, "eigensolver.*MiB.*power"),
        ("3dhv", {"variant": "pcl"}, "bin_size.*side"),
        ("3dhv", {"bin_size": 1e-12}, "bin_size.*larger"),
        ("gc", {"tolerance": HUGE}, r"tolerance: got 1000.*\.\.\..*000; give a number that fits"),
        ("gc", {"variant": "x" * 10**6}, "variant: got 'xxx.*; choose one of"),
        ("gtm", {"tolerance": 1.0}, "tolerance.*distance_difference"),
        ("gtm", {"preset": "best"}, "preset.*literal"),
    ],
)
def test_bad_options(method, options, words):
    with pytest.raises(InputError, match=f"(?s){words}"):
        group(correspondences(), method, **options)


def test_extents_too_small_to_square():
    with pytest.raises(InputError, match="smaller unit"):
        cgroup.gtm(PROBLEM.source * 1e-100, PROBLEM.target * 1e-100)


@pytest.mark.parametrize("method", ["ransac", "cv"])
def test_a_length_or_the_resolution_is_needed(method):
    given = correspondences()
    fields = {name: getattr(given, name) for name in ("ratio", "source_lrf", "target_lrf")}
    without = Correspondences(given.source, given.target, **fields)
    with pytest.raises(ValueError, match="(?s)resolution.*mean nearest-neighbour.*length"):
        group(without, method)


@pytest.mark.parametrize(
    "method", [i.name for i in METHOD_INFO.values() if {*i.fields} - {"source", "target"}]
)
def test_missing_fields_are_named(method):
    with pytest.raises(InputError, match=f"{method} needs"):
        group(Correspondences(PROBLEM.source, PROBLEM.target, resolution=1.0), method)


def test_pose_is_that_of_the_points_grouped():
    source, target = PROBLEM.source.copy(), PROBLEM.target.copy()
    result = cgroup.gtm(source, target)
    np.testing.assert_array_equal(result.indices, np.flatnonzero(result.mask))
    np.testing.assert_array_equal(result.mask, result.scores > result.threshold)
    expected = result.transform()
    source[:] = 0.0  # the buffer gets the next frame
    np.testing.assert_array_equal(result.transform(), expected)


@pytest.mark.parametrize("seed", range(6))
def test_a_line_fixes_no_pose(seed):
    rng = np.random.default_rng(seed)
    line = rng.normal(size=3) + np.outer(rng.normal(size=20), rng.normal(size=3)) * 10.0 ** rng.uniform(-9, 9)
    result = cgroup.gc(line, line, tolerance=1.0)
    with pytest.raises(NoConsensusError, match="line"):
        result.transform()


@pytest.mark.parametrize("method", METHODS)
def test_threads_and_repetition_change_nothing(method):
    results = [group(correspondences(), method)]
    if "threads" in inspect.signature(METHODS[method]).parameters:
        results += [group(correspondences(), method, threads=threads) for threads in (1, 2, 3)]
    for other in results[1:]:
        np.testing.assert_array_equal(results[0].mask, other.mask)
        np.testing.assert_array_equal(results[0].scores, other.scores)


def outcome(result: cgroup.Grouping) -> tuple:
    scores = None if result.scores is None else result.scores.tolist()
    return result.mask.tolist(), scores, result.threshold, result.diagnostics


@pytest.mark.parametrize(
    ("method", "options"), [("st", {}), ("gtm", {}), ("gc", {"variant": "clique", "tolerance": 3.0})]
)
def test_memory_bound_changes_nothing(method, options):
    plain, tight = (group(correspondences(), method, max_memory=bound, **options) for bound in (1 << 30, 0))
    assert outcome(plain) == outcome(tight)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("method", METHODS)
def test_presets_run(preset, method):
    needed = OPTIONS.get(method, {}) if preset == "pcl" else {}
    options = {**PRESETS[preset].get(method, {}), **needed}
    found = outcome(group(correspondences(), method, preset=preset, **needed))
    assert found == outcome(group(correspondences(), method, **options))
    assert (found != outcome(group(correspondences(), method))) == bool(options), "a preset changes something"


@pytest.mark.parametrize("method", METHODS)
def test_group_many_equals_group(method):
    problems = [correspondences(n) for n in (0, 5, 40, 120)]
    for one, many in zip(problems, group_many(problems, method), strict=True):
        np.testing.assert_array_equal(group(one, method).mask, many.mask)


def big_problem(n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return rng.normal(size=(n, 3)), rng.normal(size=(n, 3))


class Enough(Exception):  # noqa: N818 - it ends a run that has shown what it should
    pass


def test_a_search_ends_at_its_time():
    found = cgroup.mac(*big_problem(5000), tolerance=0.1, max_seconds=1e-9)
    assert not found.complete
    assert found.diagnostics["cliques"] == 0
    assert cgroup.mac(*big_problem(500), tolerance=0.1, max_seconds=1e300).complete


@pytest.mark.parametrize(
    ("method", "options"),
    [("gtm", {"iterations": 10**9}), ("ransac", {"tolerance": 0.1, "iterations": 10**9})],
)
def test_progress_is_reported(method, options):
    shares: list[float] = []

    def report(share: float) -> None:
        shares.append(share)
        if len(set(shares)) > 2:
            raise Enough

    with pytest.raises(Enough):
        METHODS[method](*big_problem(3000), threads=1, progress=report, **options)
    assert shares == sorted(shares)
    assert all(0.0 <= share <= 1.0 for share in shares)


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts threads through /proc")
def test_group_many_computes_side_by_side():
    script = textwrap.dedent("""
        import os, threading, time
        from pathlib import Path
        import numpy as np, cgroup
        points = np.random.default_rng(0).normal(size=(2000, 3))
        problems = [cgroup.Correspondences(points, points[::-1], resolution=0.1)] * 8
        options = {"threads": 4, "iterations": 10**9}
        run = lambda: cgroup.group_many(problems, "ransac", **options)
        threading.Thread(target=run, daemon=True).start()
        def computing():
            return [path.read_text().strip() for path in Path("/proc/self/task").glob("*/comm")].count("cgroup-0")
        while computing() < 2:  # none of them ends
            time.sleep(0.01)
        os._exit(0)
    """)
    assert subprocess.run([sys.executable, "-c", script], check=False, timeout=60).returncode == 0


@posix_only
@pytest.mark.parametrize(
    "call",
    [
        "cgroup.gtm(a, b, iterations=10**9, max_memory=0)",
        "cgroup.ransac(a, b, tolerance=0.1, iterations=10**9)",
        "cgroup.st(a, b, recompute=True, min_distance_ratio=0.01, max_memory=1 << 30)",
        "cgroup.st(a, b, eigensolver='dense', max_memory=1 << 33)",
        "cgroup.gc(a, b, tolerance=9.0, variant='clique', iterations=10**9)",
        "score_poses(surface, surface, poses)",
        "for _ in range(100): FineSurface(many, 0.01)",
    ],
)
def test_ctrl_c_is_heard(call):
    preparation = """
        import numpy as np, cgroup
        from cgroup.verification import FineSurface, Surface, score_poses
        rng = np.random.default_rng(0)
        (a, b), many = rng.normal(size=(2, 4000, 3)), rng.normal(size=(4_000_000, 3))
        surface, poses = Surface(20 * a, a, unit=1.0), np.tile(np.eye(4), (3_000_000, 1, 1))
    """
    assert_hears_interrupt(preparation, call)  # the work itself would take hours


@posix_only
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_forked_process_computes_too():
    expected = cgroup.gtm(PROBLEM.source, PROBLEM.target).mask
    assert_holds_in_a_fork(lambda: np.array_equal(cgroup.gtm(PROBLEM.source, PROBLEM.target).mask, expected))
