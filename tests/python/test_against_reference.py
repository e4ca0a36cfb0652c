"""Every method and option of cgroup against the NumPy reference, on random problems.

Scores must agree to the accuracy in method_cases.py, masks must be equal. The only
rows left out are the ambiguous ones, where the exact answer hangs on rounding:

* the reference itself decides otherwise when the points are deformed by 1e-12 of their
  extent (this finds every distance that lies on a bound, every vote on the border of a
  bin, every tie that is none), or
* the score lies within 1e-7 (relative) of the threshold.

Where a method cuts its scores, the cut is also repeated on the scores that cgroup
returned; nothing is ambiguous then and the masks must be equal without exception.
"""

from dataclasses import replace
from typing import Any

import method_cases
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as hst
from method_cases import CASES, OPTION_SETS, Field, Options, Pr, call_cgroup, call_reference, name_of

from reference.otsu import select_above
from reference.result import ReferenceGrouping
from reference.spectral import greedy
from strategies import BoolArray, FloatArray, Problem, make_problem, problems

NUDGE = 1e-12
NEAR_THRESHOLD = 1e-7
NEAR_TIE = 1e-9
COSINE_ERROR = 4e-15
PER_OPTION = settings(max_examples=max(10, settings().max_examples // 3))


def compare(method: str, problem: Problem, options: Options) -> None:
    for value in vars(problem).values():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
    expected, nudged, margin, shaky, ambiguous = expect(method, problem, options)
    got = call_cgroup(method, problem, options)
    assert_same_scores(got, expected, shaky, margin)
    assert_same_group(got, expected, ambiguous)
    assert_same_threshold(got, expected, ambiguous)
    assert_same_alternatives(got, expected, nudged, problem)
    assert_same_confidence(got, expected, nudged, problem)
    assert_mask_follows_scores(method, got, expected, nudged, options)
    if not ambiguous.any():
        assert got.complete == expected.details.get("complete", got.complete)
        assert got.diagnostics.get("certified") == expected.details.get("certified")


def expect(method: str, problem: Problem, options: Options) -> tuple[Any, ...]:
    """Return the reference's answers to the problem and to deformed ones, the margin of scores, and the rows in doubt."""
    expected = call_reference(method, problem, options)
    nudged = [call_reference(method, nudge(problem, size), options) for size in (NUDGE, -NUDGE)]
    margin = score_margin(method, expected, options)
    shaky = ambiguous_scores(expected, nudged, margin)
    return expected, nudged, margin, shaky, ambiguous_rows(method, expected, nudged, shaky)


# --- What is ambiguous --------------------------------------------------------------


def nudge(problem: Problem, size: float) -> Problem:
    """Deform both clouds by `size` of their extent; equal points stay equal."""
    rng = np.random.default_rng(0)

    def deformed(points: FloatArray) -> FloatArray:
        centre = points.mean(axis=0) if len(points) else np.zeros(3)
        strain = size * rng.normal(size=(3, 3))
        local = points - centre
        return points + sum(local[:, [k]] * strain[k] for k in range(3))

    return replace(problem, source=deformed(problem.source), target=deformed(problem.target))


def score_margin(method: str, expected: ReferenceGrouping, options: Options) -> FloatArray:
    """(n,) difference that is allowed between the scores.

    CV: 1e-9 of each score plus what the arc cosine of Eq. 9 makes of a rounding error
    in its argument; it is infinitely sensitive at 0 and 180 degrees.
    """
    if expected.scores is None:
        return np.zeros(len(expected.mask))
    finite = np.abs(expected.scores[np.isfinite(expected.scores)])
    margin = np.full(len(expected.scores), CASES[method].score_tolerance * finite.max(initial=0.0))
    if method == "cv":
        d = expected.details
        with np.errstate(divide="ignore"):
            angle_error = np.degrees(
                sum(
                    np.minimum(COSINE_ERROR / np.abs(np.sin(np.radians(angle))), np.sqrt(2.0 * COSINE_ERROR))
                    for angle in (d["angle_source"], d["angle_target"])
                )
            )
        affinity = np.abs(d["angle_source"] - d["angle_target"])
        scale = options.get("angle_scale", 10.0)
        sensitivity = d["compatibility"] * (2.0 * affinity + angle_error) / scale**2
        wobble = np.where(d["compatibility"] > 0.0, sensitivity * angle_error, 0.0)
        relative = CASES[method].score_tolerance * expected.scores
        margin = relative + wobble[:, d["voters"]].sum(axis=1)
    return margin


def ambiguous_scores(
    expected: ReferenceGrouping, nudged: list[ReferenceGrouping], margin: FloatArray
) -> BoolArray:
    """(n,) True where the deformation moves the score itself by more than rounding."""
    shaky = np.full(len(expected.mask), bool(expected.details.get("unsettled", False)))
    if expected.scores is None:
        return shaky
    finite = np.isfinite(expected.scores)
    for other in nudged:
        change = np.abs(other.scores[finite] - expected.scores[finite])
        shaky[finite] |= change > margin[finite]
    return shaky


def ambiguous_rows(
    method: str, expected: ReferenceGrouping, nudged: list[ReferenceGrouping], shaky: BoolArray
) -> BoolArray:
    """(n,) True where rounding may decide whether the row is selected."""
    ambiguous = np.full(len(expected.mask), bool(expected.details.get("unsettled", False)))
    for other in nudged:
        ambiguous |= other.mask != expected.mask
    if method in {"si", "cv", "gtm"}:
        ambiguous |= shaky
    if method in {"cv", "gtm"} and expected.threshold is not None:
        distance = np.abs(expected.scores - expected.threshold)
        ambiguous |= distance < NEAR_THRESHOLD * abs(expected.threshold)
    if method == "st":
        ambiguous |= shaky.any() | near_ties(expected)
    return ambiguous


def near_ties(expected: ReferenceGrouping) -> BoolArray:
    """(n,) True for rows that depend on which of two equally strong rows ST takes first.

    Between conflicting rows of almost equal strength rounding decides, and everything
    after depends on it. Not so with twins, rows with the same affinities to all others:
    they tie, and the lowest index has to win.
    """
    v, matrix = expected.scores, expected.details["matrix"]
    ambiguous = np.zeros(len(v), dtype=bool)
    if len(v) == 0:
        return ambiguous
    near = np.abs(v[:, None] - v[None, :]) <= NEAR_TIE * v.max()
    for i, j in np.argwhere(np.triu(near & expected.details["conflicts"], 1)):
        others = np.delete(np.arange(len(v)), [i, j])
        if (matrix[i, others] != matrix[j, others]).any() or matrix[i, i] != matrix[j, j]:
            ambiguous[:] = True
    return ambiguous


# --- What must be equal -------------------------------------------------------------


def assert_same_scores(rust: Any, reference: ReferenceGrouping, shaky: BoolArray, margin: FloatArray) -> None:
    if reference.scores is None:
        assert rust.scores is None
        return
    assert rust.scores.dtype == np.float64
    assert rust.scores.shape == reference.scores.shape
    assert not np.isnan(reference.scores).any()
    finite = np.isfinite(reference.scores)
    np.testing.assert_array_equal(rust.scores[~finite], reference.scores[~finite])
    with np.errstate(invalid="ignore"):
        close = np.abs(rust.scores - reference.scores) <= margin
    rows = np.flatnonzero(finite & ~shaky & ~close)
    assert not len(rows), f"rows {rows}: cgroup {rust.scores[rows]}, reference {reference.scores[rows]}"


def assert_same_group(rust: Any, reference: ReferenceGrouping, ambiguous_rows: BoolArray) -> None:
    assert rust.mask.dtype == np.bool_
    np.testing.assert_array_equal(rust.mask[~ambiguous_rows], reference.mask[~ambiguous_rows])


def assert_same_threshold(rust: Any, reference: ReferenceGrouping, ambiguous_rows: BoolArray) -> None:
    """Compare the thresholds, unless ambiguous rows may have moved them."""
    if ambiguous_rows.any():
        return
    assert_same_cut(rust.threshold, reference.threshold, rel=1e-6, abs=1e-12)


def assert_same_cut(cut: float | None, expected: float | None, **close: float) -> None:
    assert (cut is None) == (expected is None)
    assert expected is None or cut == pytest.approx(expected, **close)


def assert_same_alternatives(
    rust: Any, reference: ReferenceGrouping, nudged: list[ReferenceGrouping], problem: Problem
) -> None:
    """Compare the motions by where they lay the points, unless rounding may have changed their number or order."""
    if reference.alternatives is None:
        assert rust.alternatives is None
        assert rust.alternative_scores is None
        return
    if any(not same_motions(other, reference, problem) for other in nudged):
        return
    assert same_motions(rust, reference, problem)


def assert_same_confidence(
    rust: Any, reference: ReferenceGrouping, nudged: list[ReferenceGrouping], problem: Problem
) -> None:
    """Compare the number of false alarms and the instances, unless rounding may have changed what they count."""
    if reference.false_alarms is None:
        assert (rust.ok, rust.false_alarms, rust.instances) == (None, None, None)
        return
    sides = [other for other in nudged if not same_confidence(other, reference)]
    if not sides and all(same_motions(other, reference, problem) for other in nudged):
        assert same_confidence(rust, reference)


def same_confidence(found: Any, reference: ReferenceGrouping) -> bool:
    """Return True for the same number of false alarms, up to rounding, and the same instances."""
    if (found.instances is None) != (reference.instances is None):
        return False
    same_rows = reference.instances is None or np.array_equal(found.instances, reference.instances)
    same_number = np.isclose(found.false_alarms, reference.false_alarms, rtol=1e-6, atol=0.0)
    same_noise = found.noise == reference.noise or np.isclose(found.noise or 0.0, reference.noise or 0.0)
    return bool(found.ok == reference.ok and same_number and same_rows and same_noise)


def same_motions(found: Any, reference: ReferenceGrouping, problem: Problem) -> bool:
    """Return True for as many motions, which lay the points in the same places, with the same scores."""
    if found.alternatives.shape != reference.alternatives.shape:
        return False
    if len(reference.alternatives) == 0:
        return True
    points = np.column_stack([problem.source, np.ones(len(problem.source))])
    extent = max(np.ptp(side, axis=0).max(initial=0.0) for side in (problem.source, problem.target))
    magnitude = max(np.abs(side).max(initial=0.0) for side in (problem.source, problem.target))
    places = [points @ np.swapaxes(side.alternatives, 1, 2) for side in (found, reference)]
    return np.allclose(*places, rtol=0.0, atol=1e-5 * extent + 1e-9 * magnitude) and np.allclose(
        found.alternative_scores, reference.alternative_scores, rtol=1e-6
    )


def assert_mask_follows_scores(
    method: str, rust: Any, reference: ReferenceGrouping, nudged: list[ReferenceGrouping], options: Options
) -> None:
    """Repeat the last step of the method on the scores that cgroup returned."""
    if method == "gtm" and not (reference.details["payoff"] > 0.0).any():
        assert not rust.mask.any()  # nobody agrees with anybody
        return
    cuts = {"si", "cv", "gtm"}
    if method in cuts and options.get("dynamics") != "infection_immunisation":
        mask, threshold = select_above(
            rust.scores, options.get("threshold", "otsu"), options.get("otsu", "minmax")
        )
        np.testing.assert_array_equal(rust.mask, mask)
        assert_same_cut(rust.threshold, threshold, rel=1e-12)
    if method == "gtm" and options.get("dynamics") == "infection_immunisation":
        cut = options.get("threshold", 1e-9)
        np.testing.assert_array_equal(rust.mask, rust.scores > cut)
        assert rust.threshold == cut
    if method == "st" and not options.get("recompute"):
        conflicts = reference.details["conflicts"]
        settled = all((g.details["conflicts"] == conflicts).all() for g in nudged)
        supported = (reference.details["matrix"] > 0.0).any() and len(rust.scores) > 1
        if settled and supported:
            np.testing.assert_array_equal(rust.mask, greedy(rust.scores, conflicts))


# --- The tests ----------------------------------------------------------------------


@pytest.mark.parametrize(("method", "options"), OPTION_SETS, ids=name_of)
@given(data=hst.data())
@PER_OPTION
def test_random_problems(method: str, options: Options, data: hst.DataObject) -> None:
    problem = data.draw(problems(max_size=largest(method, options)), label="problem")
    compare(method, problem, options)


def largest(method: str, options: Options) -> int:
    """Return the size up to which the reference is quick enough."""
    slow = options.get("recompute") or options.get("scale")
    if slow or (method == "ransac" and "iterations" not in options):
        return 50
    return {"mac": 60, "lc": 80}.get(method, 150)


@pytest.mark.parametrize(("method", "options"), OPTION_SETS, ids=name_of)
def test_tiny_problems(method: str, options: Options) -> None:
    for n in range(5):
        for seed in range(3):
            rng = np.random.default_rng(seed)
            compare(method, make_problem(rng, n, inlier_ratio=0.8), options)


@pytest.mark.parametrize("method", [method for method, case in CASES.items() if "source" in case.inputs])
@pytest.mark.parametrize("shape", ["spread", "repeated"])
def test_problems_beyond_every_block(method: str, shape: str) -> None:
    """So large that pair matrices are rounded and cut into many bands and tiles."""
    repeated = 0.3 if shape == "repeated" else 0.0
    rng = np.random.default_rng(5)
    n = 700 if method == "mac" else 1357
    drawn = {"inlier_ratio": 0.2, "repeated_targets": repeated, "duplicated_sources": repeated}
    problem = make_problem(rng, n, **drawn)
    options: Options = {"iterations": 300} if method == "ransac" else {}
    expected = call_reference(method, problem, options)
    for memory in [{"max_memory": 0}, {}] if method in {"gtm", "st"} else [{}]:
        got = call_cgroup(method, problem, options | memory)
        np.testing.assert_array_equal(got.mask, expected.mask)
        if expected.scores is not None:
            allowed = CASES[method].large_score_tolerance * expected.scores.max()
            np.testing.assert_allclose(got.scores, expected.scores, rtol=0, atol=allowed)


@pytest.mark.parametrize("method", ["ransac", "sc2pcr", "turboreg", "teaser", "clipper"])
def test_models_lay_the_points_in_the_same_places(method: str) -> None:
    for seed in range(5):
        problem = make_problem(np.random.default_rng(seed), 200, inlier_ratio=0.3)
        expected = call_reference(method, problem, {}).details["transform"]
        np.testing.assert_allclose(call_cgroup(method, problem, {}).model, expected, atol=1e-6)


def test_lc_joins_those_that_agree_with_the_most_others() -> None:
    problem = make_problem(np.random.default_rng(6), 2_700, inlier_ratio=0.02)
    expected, got = (call("lc", problem, {}) for call in (call_reference, call_cgroup))
    assert got.diagnostics["vertices"] == 2_500
    assert got.diagnostics["hypotheses"] == expected.details["hypotheses"]
    np.testing.assert_array_equal(got.mask, expected.mask)
    np.testing.assert_allclose(got.scores, expected.scores, rtol=0, atol=1e-6)
    np.testing.assert_allclose(got.alternative_scores, expected.alternative_scores, rtol=1e-6)


@pytest.mark.parametrize(
    ("duplicated", "missing", "options"),
    [
        (0.12, 0.0, {"resolution": Pr(0.2), "ratio": Field("ratio")}),
        (0.14, 0.1, method_cases.FEW | method_cases.FRAMED),
    ],
)
def test_lc_fits_no_reflection_to_a_pose_without_a_group(
    duplicated: float, missing: float, options: Options
) -> None:
    # A mode's supporters have residuals below 6 u, the group at most 5 u: of some modes none is in the group.
    drawn = {"inlier_ratio": 0.2, "noise": 1.5, "frame_error": 0.0, "repeated_targets": 0.27}
    drawn |= {"duplicated_sources": duplicated, "missing_frames": missing}
    compare("lc", make_problem(np.random.default_rng(5483), 150, **drawn), options)


STEPS = np.arange(12.0)[:, None]
SHAPES = {
    "point": np.ones((12, 3)),
    "line, every third one twice": np.repeat(STEPS, 1 + (STEPS[:, 0] % 3 == 1), axis=0)[:12]
    * [1.0, 2.0, 4.0],
    "plane": np.hstack([STEPS, STEPS**2, 0.0 * STEPS]),
}


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
@pytest.mark.parametrize(("method", "options"), OPTION_SETS, ids=name_of)
def test_degenerate_shapes(method: str, options: Options, shape: FloatArray) -> None:
    problem = make_problem(np.random.default_rng(0), 12, missing_frames=0.2)
    for changed in ({"source": shape}, {"target": shape}, {"source": shape, "target": shape}):
        compare(method, replace(problem, **changed), options)


@pytest.mark.parametrize(("method", "options"), OPTION_SETS, ids=name_of)
def test_few_rows_are_ambiguous(method: str, options: Options) -> None:
    rows = ambiguous = 0
    for seed in range(3):
        problem = make_problem(np.random.default_rng(seed), 60, missing_frames=0.1)
        rows += len(problem)
        ambiguous += expect(method, problem, options)[-1].sum()
    assert ambiguous <= 0.02 * rows


@pytest.mark.parametrize("first", [0, 4])
def test_equal_neighbouring_maxima_of_hough_voting(first: int) -> None:
    # Two motions, four votes each in adjacent bins: both are maxima, the lower bin wins.
    plain = make_problem(np.random.default_rng(0), 8)
    source, same = np.round(plain.source), np.tile(np.eye(3), (8, 1, 1))
    target = source.copy()
    target[first : first + 4] += np.array([-10.0, 0.0, 0.0])
    problem = replace(plain, source=source, target=target, source_lrf=same, target_lrf=same)
    options = {"variant": "pcl", "bin_size": 6.0, "interpolation": False, "iterations": 100}
    compare("hough3d", problem, options)
    group = call_cgroup("hough3d", problem, options)
    assert np.flatnonzero(group.mask).tolist() == list(range(first, first + 4))


@pytest.mark.parametrize("recompute", [False, True])
@pytest.mark.parametrize("eigensolver", ["power", "dense"])
def test_st_takes_the_lowest_index_without_affinities(eigensolver: str, recompute: bool) -> None:
    # Row 0 is the strongest; what is left then is a zero matrix of two rivals.
    plain = make_problem(np.random.default_rng(0), 3)
    source = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    target = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.01, 0.0, 0.0]])
    options = {"eigensolver": eigensolver, "recompute": recompute}
    compare("st", replace(plain, source=source, target=target), options)


def test_lc_takes_equal_noises_alike() -> None:
    """Two radii have 12 and 12 of 14 supporters: the numbers of false alarms are equal but for rounding."""
    rng = np.random.default_rng(19066610)
    problem = make_problem(
        rng, 15, inlier_ratio=0.9, noise=3.0, repeated_targets=0.0, random_frames=0.0, frame_error=20.0
    )
    compare("lc", problem, {"source_lrf": Field("source_lrf", None), "target_lrf": Field("target_lrf", None)})
