"""Pose graphs: minima, covariances, wrong edges, files."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shared_data import shared_file

from cgroup.errors import InputError
from cgroup.scenes import PoseGraph
from reference import pose_graph as reference

COSTS = {"smallGrid3D": 517.93, "parking-garage": 0.63419, "sphere2500": 675.70, "torus3D": 12117.6}
"""Of GTSAM 4.3, Levenberg-Marquardt from its chordal start."""


def random_graph(seed, nodes=6, noise=0.05, angle=3.0):
    """Return a connected graph with loops, the truth and noisy measurements of different information."""
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(nodes, 3))
    turns *= angle * rng.random((nodes, 1)) / np.linalg.norm(turns, axis=1, keepdims=True)
    truth = np.array([reference.exponential(np.r_[turn, 3 * rng.normal(size=3)]) for turn in turns])
    edges = [(i, i + 1) for i in range(nodes - 1)] + [(nodes - 1, 0), (2, 0), (1, nodes - 2)]
    measurements, information = [], []
    for i, j in edges:
        root = rng.normal(size=(6, 6)) + 4 * np.eye(6)
        information.append(root @ root.T)
        moved = np.linalg.inv(truth[i]) @ truth[j] @ reference.exponential(noise * rng.normal(size=6))
        measurements.append(moved)
    return truth, PoseGraph(truth, edges, measurements, information)


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([1e-9, 1e-3, 0.05]), st.sampled_from([1e-8, 1.0, 3.1]))
def test_minima_are_those_of_the_equations(seed, noise, angle):
    truth, graph = random_graph(seed, 5, noise, angle)
    found = graph.optimize()
    parts = (graph.edges, graph.measurements, graph.information)
    expected = reference.optimize(truth, *parts, held={0})
    assert found.cost == pytest.approx(reference.cost(found.poses, *parts), rel=1e-4, abs=1e-12)
    assert found.cost <= reference.cost(expected, *parts) * (1 + 1e-4) + 1e-12
    np.testing.assert_allclose(found.poses[0], truth[0])


def test_covariances_are_inverses_of_the_normal_matrix():
    _, graph = random_graph(3)
    best = graph.optimize()
    _, matrix, _ = reference.normal_matrix(
        best.poses, best.edges, best.measurements, best.information, held={0}
    )
    inverse = np.linalg.inv(matrix)
    for node in range(1, 6):
        block = inverse[6 * node - 6 : 6 * node, 6 * node - 6 : 6 * node]
        np.testing.assert_allclose(best.covariance(node), block, rtol=1e-4, atol=1e-8)
    assert not best.covariance(0).any()
    with pytest.raises(InputError, match="below 6"):
        best.covariance(6)


def test_the_bits_are_the_same_on_any_number_of_threads():
    _, graph = random_graph(8, 40)
    one, two = graph.optimize(threads=1, robust=True), graph.optimize(threads=2, robust=True)
    np.testing.assert_array_equal(one.poses, two.poses)


def test_parts_are_placed_each_by_itself():
    truth, graph = random_graph(5)
    twice = PoseGraph(
        np.concatenate([truth, truth, truth[:1]]),
        np.concatenate([graph.edges, graph.edges + 6]),
        np.tile(graph.measurements, (2, 1, 1)),
        np.tile(graph.information, (2, 1, 1)),
    )
    both, alone = twice.optimize(), graph.optimize()
    np.testing.assert_array_equal(both.poses[:6], alone.poses)
    np.testing.assert_array_equal(both.poses[6:12], alone.poses)
    np.testing.assert_array_equal(both.poses[12], truth[0])
    assert [len(part) for part in both.components()] == [6, 6, 1]


def test_no_edges_edges_to_oneself_and_edges_given_twice():
    assert PoseGraph([], [], [], []).optimize().components() == []
    lonely = PoseGraph([np.eye(4)] * 2, [], [], []).optimize(robust=True)
    assert (lonely.cost, len(lonely.components())) == (0, 2)
    shift = np.eye(4)
    shift[0, 3] = 2
    graph = PoseGraph([np.eye(4)] * 2, [(0, 0), (0, 1), (0, 1)], [shift, shift, np.eye(4)], [np.eye(6)] * 3)
    best = graph.optimize()
    assert best.poses[1, 0, 3] == pytest.approx(1)
    assert best.cost == pytest.approx(3)


@pytest.mark.parametrize("seed", range(2))
def test_wrong_loops_are_dropped(seed):
    rng = np.random.default_rng(seed)
    truth, graph = random_graph(seed, 30, 0.02, 1.0)
    # Loops enough, so that wrong ones contradict them.
    pairs = [(i, j) for i, j in rng.integers(0, 30, (60, 2)).tolist() if j != i + 1 and i != j]
    right = [np.linalg.inv(truth[i]) @ truth[j] for i, j in pairs]
    wrong = [reference.exponential(np.r_[rng.normal(size=3), 5 * rng.normal(size=3)]) for _ in range(15)]
    edges = np.concatenate([graph.edges, pairs, pairs[:15]])
    measured = np.concatenate([graph.measurements, right, wrong])
    full = PoseGraph(truth, edges, measured, np.tile(25 * np.eye(6), (len(edges), 1, 1)))
    found = full.optimize(robust=True)
    np.testing.assert_array_equal(found.kept, np.arange(len(edges)) < len(edges) - 15)
    clean = PoseGraph(truth, edges[:-15], measured[:-15], full.information[:-15]).optimize()
    np.testing.assert_allclose(found.poses, clean.poses, atol=1e-3)


@pytest.mark.parametrize("name", COSTS)
def test_minima_of_public_graphs(name):
    graph = PoseGraph.read(shared_file(f"data/scenes/pose_graphs/{name}.g2o"))
    assert graph.optimize().cost == pytest.approx(COSTS[name], rel=1e-4)


@pytest.mark.parametrize("suffix", ["g2o", "json"])
def test_graphs_are_read_as_they_were_written(tmp_path, suffix):
    _, graph = random_graph(11)
    graph.optimize().write(tmp_path / f"a.{suffix}")
    first = PoseGraph.read(tmp_path / f"a.{suffix}")
    for name in ("poses", "measurements", "information"):
        np.testing.assert_allclose(
            getattr(first, name), getattr(graph if name != "poses" else graph.optimize(), name), atol=1e-14
        )
    np.testing.assert_array_equal(first.edges, graph.edges)
    np.testing.assert_array_equal(first.information, graph.information)
    np.testing.assert_array_equal(first.probability, graph.probability)
    if suffix == "json":
        np.testing.assert_array_equal(first.measurements, graph.measurements)
        edge = json.loads((tmp_path / "a.json").read_bytes())["edges"][0]
        ends = edge["source_node_id"], edge["target_node_id"]
        assert ends == (1, 0)  # maps points of the source into the target


def test_information_of_json_is_that_of_open3d(tmp_path):
    """Rotation first, as its `get_information_matrix_from_point_clouds`; both solve a chain alike."""
    registration = pytest.importorskip("open3d").pipelines.registration
    step, far = np.eye(4), np.eye(4)
    step[0, 3], far[0, 3] = 1.0, 1.2
    weights = np.array([np.eye(6), np.diag([100.0] * 3 + [1e4] * 3)])
    graph = PoseGraph([np.eye(4), step], [(0, 1)] * 2, [step, far], weights, [1.0, 1.0])
    graph.write(tmp_path / "a.json")
    import open3d  # noqa: PLC0415 - optional

    theirs = open3d.io.read_pose_graph(str(tmp_path / "a.json"))
    np.testing.assert_array_equal(theirs.edges[1].information, weights[1])
    registration.global_optimization(
        theirs,
        registration.GlobalOptimizationLevenbergMarquardt(),
        registration.GlobalOptimizationConvergenceCriteria(),
        registration.GlobalOptimizationOption(reference_node=0),
    )
    assert graph.optimize().poses[1, 0, 3] == pytest.approx(theirs.nodes[1].pose[0, 3], abs=1e-4)


@pytest.mark.parametrize("ids", [[0, 0], [0, 2**53]])
def test_ids_that_files_cannot_hold_are_refused(ids):
    with pytest.raises(InputError, match=r"ids: got .*; give different numbers below 2\^53"):
        PoseGraph([np.eye(4)] * 2, [(0, 1)], [np.eye(4)], [np.eye(6)], ids=ids)


@pytest.mark.parametrize(("weight", "way"), [(1e-100, 1.0), (1.0, 1e200)])
def test_extreme_numbers_end(weight, way):
    steps = np.tile(np.eye(4), (6, 1, 1))
    steps[:, 0, 3] = way
    edges = [(i, i + 1) for i in range(5)] + [(0, 5)]
    graph = PoseGraph([np.eye(4)] * 6, edges, steps, [weight * np.eye(6)] * 6)
    assert len(graph.optimize(robust=True).poses) == 6


UNIT = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1"
VERTEX = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (VERTEX + "VERTEX_SE3:QUAT 1 0 0 nan 0 0 0 1", "line 2: VERTEX_SE3:QUAT needs 8 finite numbers"),
        (VERTEX + "VERTEX_SE3:QUAT 1 0 0 0 0 0 0 0", "line 2: the quaternion is zero"),
        (VERTEX + VERTEX, "line 2: its node is there twice"),
        (VERTEX + f"EDGE_SE3:QUAT 0 5 0 0 0 0 0 0 1 {UNIT}", "line 2: there is no node 5"),
        (VERTEX + f"EDGE_SE3:QUAT 0 0 0 0 0 0 0 0 1 {UNIT[:-1]}-1", "line 2: the information is not"),
        (VERTEX + "EDGE_SE2 0 1 0 0 0 1 0 0 1 0 1", "line 2: EDGE_SE2 is not read; give poses in space"),
        ("VERTEX_SE3:QUAT .5 0 0 0 0 0 0 1", "line 1: the number of a node is no whole number"),
    ],
)
def test_bad_lines_are_named(tmp_path, text, message):
    (tmp_path / "bad.g2o").write_text(text)
    with pytest.raises(InputError, match=message):
        PoseGraph.read(tmp_path / "bad.g2o")


@pytest.mark.parametrize("suffix", ["g2o", "json"])
@pytest.mark.parametrize("kind", ["rounded", "singular", "open"])
def test_semidefinite_edges_are_read_and_named(tmp_path, suffix, kind):
    rng = np.random.default_rng(5)
    truth, graph = random_graph(5, 8)
    graph.write(tmp_path / f"a.{suffix}")
    root = rng.normal(size=(6, 5)) * [1, 3, 10, 0.3, 1]
    matrix = root @ root.T
    if kind == "rounded":  # to six digits, as files have them: one eigenvalue becomes negative
        matrix += np.diag(-1e-6 * matrix.diagonal())
    if kind == "open":
        matrix = np.diag([4.0, 4, 4, 0, 0, 0])
    text = (tmp_path / f"a.{suffix}").read_text()
    swapped = matrix[np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2])]
    if suffix == "json":
        document = json.loads(text)
        document["edges"][2]["information"] = matrix.ravel().tolist()
        text = json.dumps(document)
    else:
        lines = text.splitlines()
        row = len(truth) + 2
        words = lines[row].split()[:10]
        lines[row] = " ".join([*words, *map(str, swapped[np.triu_indices(6)])])
        text = "\n".join(lines)
    (tmp_path / f"a.{suffix}").write_text(text)
    found = PoseGraph.read(tmp_path / f"a.{suffix}")
    assert len(found.notes) == 1
    assert ("edge 2" if suffix == "json" else "line 11") in found.notes[0]
    np.testing.assert_allclose(found.information[2], matrix, atol=1e-5 * matrix.diagonal().max())
    for robust in (False, True):
        best = found.optimize(robust=robust)
        assert np.isfinite(best.cost)
        assert best.cost <= found.cost
        assert best.notes == found.notes
    best.write(tmp_path / f"b.{suffix}")
    assert PoseGraph.read(tmp_path / f"b.{suffix}").notes == ()


def test_graphs_of_random_pairs_are_optimized():
    """Their factor is nearly full."""
    rng = np.random.default_rng(0)
    motions = np.c_[rng.normal(size=(400, 3)), 9 * rng.normal(size=(400, 3))]
    truth = np.array([reference.exponential(motion) for motion in motions])
    pairs = rng.integers(0, 400, (2800, 2))
    pairs = np.concatenate([np.c_[np.arange(399), np.arange(1, 400)], pairs[pairs[:, 0] != pairs[:, 1]]])
    noise = np.array([reference.exponential(0.02 * rng.normal(size=6)) for _ in pairs])
    measured = np.linalg.inv(truth[pairs[:, 0]]) @ truth[pairs[:, 1]] @ noise
    graph = PoseGraph(truth, pairs, measured, np.tile(2500 * np.eye(6), (len(pairs), 1, 1)))
    best = graph.optimize(threads=1)
    given = graph.optimize(start="given", threads=2)
    assert best.cost == pytest.approx(given.cost, rel=1e-6)
    assert best.cost == pytest.approx(3 * (len(graph.edges) - len(truth) + 1), rel=0.1)  # chi-squared
    np.testing.assert_array_equal(best.poses, graph.optimize(threads=2).poses)
    matrix = best.covariance(7)
    assert (np.linalg.eigvalsh(matrix) > 0).all()


def test_bad_json_is_refused(tmp_path):
    deep, large = "[" * 100_000, '{"nodes": [{"pose": [' + "1" + "0" * 400 + ']}], "edges": []}'
    for text in ("[]", "{", '{"nodes": [{"pose": [1]}], "edges": []}', deep, large):
        (tmp_path / "bad.json").write_text(text)
        with pytest.raises(InputError, match=r"no PoseGraph of Open3D"):
            PoseGraph.read(tmp_path / "bad.json")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"poses": np.full((2, 4, 4), np.nan)}, r"poses\[0\]"),
        ({"edges": [(0, 2)]}, "node 2 in row 0"),
        ({"measurements": np.ones((1, 4, 4))}, r"measurements\[0\]"),
        ({"information": np.triu(np.ones((1, 6, 6)))}, "symmetric positive definite matrix in row 0"),
        ({"probability": [2.0]}, "between 0 and 1"),
        ({"kept": [1]}, "truth values"),
    ],
)
def test_bad_arrays_are_named(change, message):
    poses, edge = (
        [np.eye(4)] * 2,
        {"edges": [(0, 1)], "measurements": [np.eye(4)], "information": [np.eye(6)]},
    )
    with pytest.raises(InputError, match=message):
        PoseGraph(**({"poses": poses} | edge | change))
