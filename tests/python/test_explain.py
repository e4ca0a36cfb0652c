"""What `Grouping.explain` says is true: its numbers are those of the reference, its cuts separate."""

import pickle
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from method_cases import CASES, Options, Pr, call_cgroup, name_of

import cgroup
from cgroup import Correspondences, Explanation, Grouping, InputError, group
from cgroup._explain import explain_matches
from reference.hough_voting import hough3d
from reference.pairwise import distance_difference, distance_ratio, edge_lengths, shares_an_endpoint
from strategies import hard_problem

PROBLEM = hard_problem(90)
PR = PROBLEM.resolution
MATCHES = PROBLEM.correspondences()


def explained(method: str, options: Options) -> tuple[Grouping, list[Explanation]]:
    found = call_cgroup(method, PROBLEM, options)
    return found, explain_matches(found, range(len(found.mask)))


def length(options: Options, name: str, multiple: float) -> float:
    given = options.get(name)
    resolution = options.get("resolution", Pr(1.0))
    if given is None:
        return multiple * resolution.of(PROBLEM)
    return given.of(PROBLEM) if isinstance(given, Pr) else given


def each_set_of(kind: str) -> pytest.MarkDecorator:
    """Run a test on the option sets of all methods with that kind of rule."""
    cases = [(method, case) for method, case in CASES.items() if case.rule[0] == kind]
    sets = [(method, options) for method, case in cases for options in case.option_sets()]
    return pytest.mark.parametrize(("method", "options"), sets, ids=name_of)


@each_set_of("score")
def test_the_cut_on_scores_separates(method: str, options: Options) -> None:
    found, said = explained(method, options)
    assert found.scores is not None
    for each in said:
        assert each.score == found.scores[each.index]
        assert each.rank == 1 + np.count_nonzero(found.scores > each.score)
        assert each.threshold == found.threshold
        if each.threshold is not None and np.isfinite(each.score):
            accepts_equality = method == "ss" and options.get("threshold", "otsu") != "otsu"
            above = each.score >= each.threshold if accepts_equality else each.score > each.threshold
            assert each.kept == above, str(each)
            where = "above|reaches" if each.kept else "below|equals"
            assert re.search(rf"{where}.* the cut", each.reason)


@each_set_of("ratio")
def test_the_cut_on_ratios_separates(method: str, options: Options) -> None:
    found, said = explained(method, options)
    for each in said:
        assert each.kept == (PROBLEM.ratio[each.index] <= options.get("max_ratio", 0.8))
        assert each.threshold == found.threshold
        assert f"{PROBLEM.ratio[each.index]:.3g}"[:4] in each.reason


@each_set_of("residual")
def test_the_bound_on_residuals_separates(method: str, options: Options) -> None:
    found, said = explained(method, options)
    if found.model is None:
        assert not found.mask.any()
        assert "found no pose" in said[0].reason
        return
    moved = PROBLEM.source @ found.model[:3, :3].T + found.model[:3, 3]
    residuals = np.linalg.norm(moved - PROBLEM.target, axis=1)
    own = method == "lc"  # which may have taken another tolerance
    bound = 5.0 * found.diagnostics["resolution"] if own else length(options, "tolerance", 5.0)
    for each in said:
        assert each.tolerance == pytest.approx(bound)
        assert each.residual == pytest.approx(residuals[each.index], abs=1e-9)
        assert each.kept == (each.residual <= each.tolerance), str(each)
        assert bool(each.remedy) != each.kept


@each_set_of("axes in clique")
def test_teaser_keeps_what_is_near_along_each_axis_and_left_by_the_pruning(
    method: str, options: Options
) -> None:
    found, said = explained(method, options)
    if found.model is None:
        return
    off = np.abs(PROBLEM.source @ found.model[:3, :3].T + found.model[:3, 3] - PROBLEM.target).max(axis=1)
    for each in said:
        assert each.tolerance == pytest.approx(length(options, "tolerance", 2.5))
        is_near = off[each.index] <= each.tolerance + 1e-9
        assert is_near or not each.kept
        assert ("which the pruning left" in each.reason) == (is_near and not each.kept)


@each_set_of("greatest")
def test_clipper_keeps_the_greatest_scores(method: str, options: Options) -> None:
    found, said = explained(method, options)
    for each in said:
        if found.size == 0:
            assert each.threshold is None
        elif each.score != each.threshold:
            assert each.kept == (each.score > each.threshold)


@each_set_of("conflict")
def test_a_match_that_st_drops_conflicts_with_the_one_that_is_named(method: str, options: Options) -> None:
    found, said = explained(method, options)
    least = options.get("min_distance_ratio", 0.6)
    not_rigid = distance_ratio(PROBLEM.source, PROBLEM.target) < least
    shared = shares_an_endpoint(PROBLEM.source, PROBLEM.target)
    rule = options.get("conflict", "rigidity")
    conflicts = {"rigidity": not_rigid, "one_to_one": shared, "both": not_rigid | shared}[rule]
    assert [each.kept for each in said] == found.mask.tolist()
    for each in said:
        if each.kept:
            continue
        named = re.search(r"match (\d+)", each.reason)
        assert named is not None, each.reason
        rival = int(named[1])
        assert found.mask[rival]
        assert conflicts[each.index, rival]
        if not options.get("recompute"):
            assert found.scores[rival] >= found.scores[each.index] * (1.0 - 1e-9)
        shares = "they share a point" in each.reason
        assert shares == shared[each.index, rival]


@each_set_of("star")
def test_gc_names_the_seed_or_what_breaks_the_set(method: str, options: Options) -> None:
    found, said = explained(method, options)
    delta = distance_difference(PROBLEM.source, PROBLEM.target)
    bound = length(options, "tolerance", 3.0)
    for each in said:
        if options.get("variant") == "clique":
            broken = np.count_nonzero(found.mask & (delta[each.index] > bound))
            text = f"doesn't keep its distance to {broken} of the group"
            assert (text in each.reason) == (broken > 0 and not each.kept)
        elif seed := re.search(r"match (\d+), the seed of the largest star \((\d+) ", each.reason):
            assert int(seed[2]) == found.scores.max() == found.scores[int(seed[1])]
            assert each.kept == (delta[each.index, int(seed[1])] < bound)
        else:
            assert "it is the seed" in each.reason
            assert found.scores[each.index] == found.scores.max()


def test_hough_voting_counts_as_the_reference_does() -> None:
    found, said = explained("hough3d", {})
    details = hough3d(
        PROBLEM.source, PROBLEM.target, source_lrf=PROBLEM.source_lrf, target_lrf=PROBLEM.target_lrf,
        source_centroid=PROBLEM.source_centroid,
    ).details  # fmt: skip
    rows = np.flatnonzero(details["framed"])
    for row, cell in zip(rows, details["cells"], strict=True):
        own = np.count_nonzero((details["cells"] == cell).all(axis=1))
        most = np.count_nonzero((details["cells"] == details["peak"]).all(axis=1))
        assert f"its bin has {own} of the votes, the fullest {most}" in said[row].reason
        steps = [int(step) for step in re.findall(r"(\d+) along [xyz]", said[row].reason)]
        assert steps == [step for step in np.abs(cell - details["peak"]).tolist() if step]
    assert found.size


@pytest.mark.parametrize("method", cgroup.METHODS)
@pytest.mark.parametrize("rows", [0, 1, 2, len(MATCHES)])
def test_every_group_tells_its_rule(method: str, rows: int) -> None:
    fields = {name: getattr(MATCHES, name) for name in cgroup.types.OPTIONAL_FIELDS}
    taken = {name: value[:rows] for name, value in fields.items() if isinstance(value, np.ndarray)}
    taken["source_centroid"] = MATCHES.source_centroid
    matches = Correspondences(MATCHES.source[:rows], MATCHES.target[:rows], resolution=PR, **taken)
    found = group(matches, method)
    assert all(str(found.explain(i)).endswith(".") for i in range(min(rows, 2)))
    rule = found.rule
    kind, bound = CASES[cgroup.METHODS[method].__name__].rule
    bound = bound.of(PROBLEM) if isinstance(bound, Pr) else bound
    assert (rule.method, rule.kind, rule.resolution) == (method, kind, PR)
    assert rule.bound == (None if bound is None else pytest.approx(bound))
    assert all(len(of) == rows for of in (rule.decided_by, rule.conflicts, rule.votes) if of is not None)


RATIO = distance_ratio(PROBLEM.source, PROBLEM.target)
DIFFERENCE = distance_difference(PROBLEM.source, PROBLEM.target) / PR
APART = np.minimum(edge_lengths(PROBLEM.source), edge_lengths(PROBLEM.target)) > 0.0
AGREES = {
    "si": (RATIO > 0.9, None),
    "st": (RATIO >= 0.6, None),
    "gc": (DIFFERENCE < 3.0, "within 3 pr"),
    "lc": (DIFFERENCE < 3.0, "within 3 pr"),
    "mac": (DIFFERENCE < 1.0, "within 1 pr"),
    "sc2pcr": (DIFFERENCE < 5.0, "within 5 pr"),
    "clipper": ((DIFFERENCE < 5.0) & APART, "within 5 pr"),
}


@pytest.mark.parametrize("method", AGREES)
def test_agreement_is_counted_by_the_rule_of_the_method(method: str) -> None:
    found, said = explained(method, {})
    agrees, words = AGREES[method]
    agrees = agrees & ~np.eye(len(agrees), dtype=bool)
    for each in said:
        assert each.agreeing == np.count_nonzero(agrees[each.index])
        assert each.agreeing_in_group == np.count_nonzero(agrees[each.index] & found.mask)
        assert words is None or each.agreement == words


@pytest.mark.parametrize("method", cgroup.METHODS)
def test_every_method_explains_every_match_in_sentences(method: str) -> None:
    found = pickle.loads(pickle.dumps(group(MATCHES, method)))
    for i in range(len(MATCHES)):
        each = found.explain(i)
        text = str(each)
        assert text.startswith(f"Match {i} was {'kept' if found.mask[i] else 'dropped'}: ")
        assert "nan" not in text
        assert each.method == method
        assert each.agreeing is not None
        assert each.resolution == PR
        residual = each.residual_in_resolutions
        assert residual is None or each.residual == pytest.approx(residual * PR)


def test_a_method_without_points_speaks_of_scores_alone() -> None:
    said = cgroup.ss([0.2, 0.8, 0.9, -np.inf]).explain(3)
    assert said.agreeing is said.residual is None
    assert str(said) == "Match 3 was dropped: it has no descriptor, so that its similarity is -inf."


@pytest.mark.parametrize(
    ("scores", "threshold", "words"),
    [
        (None, None, r"^Match 1 was dropped: the method left it out, without a reason\.$"),
        ([0.7, 0.2], None, "rank 2 of 2"),
        ([0.50001, 0.49999], 0.5, r"score of 0\.49999 \(rank 2 of 2\) is below the cut at 0\.5"),
    ],
)
def test_own_methods_say_what_there_is_to_say(scores: Any, threshold: float | None, words: str) -> None:
    given = None if scores is None else np.array(scores)
    found = cgroup.Grouping(np.array([True, False]), given, threshold, None, {})
    assert re.search(words, str(found.explain(1)))


@pytest.mark.parametrize("row", [-1, 90, 1.5, "a", None, True])
def test_rows_that_are_none_are_refused(row: Any) -> None:
    with pytest.raises(InputError, match="index: got"):
        group(MATCHES, "gtm").explain(row)


def test_instances_are_named_and_buffers_are_copied() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [9, 9, 9]])
    target = points + np.array([[0], [0], [0], [50.0]])
    found = cgroup.gc(points, target, tolerance=0.1)
    before = [str(found.explain(i)) for i in range(4)]
    points[:] = target[:] = 0.0
    assert [str(found.explain(i)) for i in range(4)] == before
    by_residual = replace(
        cgroup.sc2pcr(MATCHES.source, MATCHES.target, resolution=PR), mask=MATCHES.source[:, 0] > 1e9
    )
    instances = np.ones((2, len(MATCHES)), bool)
    assert (
        "it belongs to row 0 of the instances" in replace(by_residual, instances=instances).explain(3).reason
    )
