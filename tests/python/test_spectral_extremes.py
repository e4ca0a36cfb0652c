"""ST where the matrix is extreme: its scale, its eigenvalues' distance, its size."""

import numpy as np
import pytest

import cgroup

SOLVERS = ("power", "dense")


def scattered(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Draw correspondences of which a third is moved rigidly."""
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(n, 3))
    target = np.where(np.arange(n)[:, None] % 3 == 0, source + 5.0, 10.0 * rng.normal(size=(n, 3)))
    return source, target


@pytest.mark.parametrize("eigensolver", SOLVERS)
@pytest.mark.parametrize("scale", [1e-320, 1e-160, 1e3, 1e165, 1e300])
@pytest.mark.parametrize("n", [1, 40, 1100])
def test_similarities_of_any_scale_give_finite_scores(n, scale, eigensolver):
    similarity = scale * np.random.default_rng(n).uniform(0.1, 1.0, n)
    for affinity in ("raw", "threshold"):
        group = cgroup.st(
            *scattered(n), similarity=similarity, diagonal="score", affinity=affinity,
            min_distance_ratio=0.999, eigensolver=eigensolver, max_memory=1 << 30,
        )  # fmt: skip
        assert np.isfinite(group.scores).all()
        assert np.linalg.norm(group.scores) == pytest.approx(1.0)


def test_similarities_that_can_t_be_summed_are_refused():
    with pytest.raises(cgroup.InputError, match=r"similarity.*row 3.*scale"):
        cgroup.st(*scattered(9), similarity=[1.0] * 3 + [1e301] + [1.0] * 5, diagonal="score")


@pytest.mark.parametrize("eigensolver", SOLVERS)
def test_a_dominant_diagonal_takes_the_vector_to_itself(eigensolver):
    similarity = np.ones(30)
    similarity[7] = 1e200
    group = cgroup.st(*scattered(30), similarity=similarity, diagonal="score", eigensolver=eigensolver)
    assert group.scores.argmax() == 7
    assert group.scores[7] == pytest.approx(1.0)
    assert group.diagnostics["eigenvalue"] == pytest.approx(1e200)


@pytest.mark.parametrize("eigensolver", SOLVERS)
def test_of_two_equal_clusters_both_are_in_the_vector(eigensolver):
    cluster = np.random.default_rng(1).normal(size=(20, 3))
    source = np.concatenate([cluster, cluster + 100.0])
    target = np.concatenate([cluster, cluster - 900.0])
    group = cgroup.st(source, target, affinity="binary", min_distance_ratio=0.9, eigensolver=eigensolver)
    assert group.scores == pytest.approx(np.full(40, 40**-0.5), abs=1e-12)


def test_the_dense_solver_s_vector_is_numpy_s():
    source, target = scattered(700)
    group = cgroup.st(source, target, eigensolver="dense", max_memory=1 << 30)
    lengths = [np.linalg.norm(points[:, None] - points, axis=2) for points in (source, target)]
    with np.errstate(invalid="ignore"):
        matrix = np.nan_to_num(np.minimum(*lengths) / np.maximum(*lengths))
    values, vectors = np.linalg.eigh(matrix)
    assert group.diagnostics["eigenvalue"] == pytest.approx(values[-1], rel=1e-13)
    assert group.scores == pytest.approx(np.abs(vectors[:, -1]), abs=1e-13)
