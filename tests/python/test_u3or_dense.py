"""U3OR sampled densely: two stones in its layout, and the real models and scan where they are."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from cloud_files import write_pcd
from pair_measures import matching, share_of_agreeing_normals
from scipy.spatial import cKDTree
from shared_data import data_folder

from cgroup import features
from cgroup.benchmark import matching as benchmark_matching
from cgroup.benchmark import paper
from cgroup.benchmark.problem import Problem, load_pair
from cgroup.datasets import MatchingPair, mirror, open_dataset, u3or_dense
from cgroup.datasets.generated.shapes import stone
from cgroup.datasets.u3or_dense import NOISE, SCANNER_SPACING, SPACING, U3ORDense
from cgroup.evaluation import within
from cgroup.io import read_cloud, write_cloud
from cgroup.registration.scan import usable_normals
from cgroup.rigid import apply
from cgroup.types import PointCloud

PLACES = {"chef": ("cheff.ply", -40.0), "T-rex": ("T-rex_high.ply", 60.0)}


@pytest.fixture(scope="module", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CGROUP_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield
    benchmark_matching.forget_pairs()


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two stones some 100 mm in size, beside each other in scene 12."""
    root = tmp_path_factory.mktemp("data")
    home = root / "u3or"
    for folder in ("models", "gt"):
        (home / folder).mkdir(parents=True)
    for number, (name, (file, x)) in enumerate(PLACES.items()):
        mesh = stone(np.random.default_rng(number), 24)
        write_cloud(home / "models" / file, PointCloud(mesh.vertices, faces=mesh.faces))
        (home / "gt" / f"{name}-rs12.xf").write_text(f"1 0 0 {x}\n0 1 0 0\n0 0 1 -650\n0 0 0 1\n")
    return root


@pytest.fixture(scope="module")
def dense(root: Path) -> U3ORDense:
    dataset = open_dataset("u3or-dense", root)
    assert isinstance(dataset, U3ORDense)
    return dataset


def distances(pair: MatchingPair) -> np.ndarray:
    """How far points of the scene lie from the posed model, of those that are near it."""
    model = apply(pair.T_target_source, pair.source.points)
    found, _ = cKDTree(model).query(pair.target.points)
    return found[found < 2]


def test_pairs_are_those_of_u3or_with_more_points(root: Path, dense: U3ORDense) -> None:
    coarse = open_dataset("u3or", root)
    assert dense.pair_names() == coarse.pair_names() == ["rs12-T-rex", "rs12-chef"]
    for name in dense.pair_names():
        pair, plain = matching(dense, name), coarse.load(name)
        assert len(pair.source) > 8 * len(plain.source)
        assert len(pair.target) > 4 * len(plain.target)
        np.testing.assert_array_equal(pair.T_target_source, plain.T_target_source)
        assert pair.facts == plain.facts
        assert dense.origin_of(name) == "semi-synthetic"


def test_points_are_as_far_apart_as_promised(dense: U3ORDense) -> None:
    pair = matching(dense, "rs12-chef")
    for cloud in (pair.source, pair.target):
        assert features.resolution(cloud.points) == pytest.approx(SPACING, rel=0.06)
    assert np.median(distances(pair)) < 0.7 * SPACING


def test_models_lie_on_the_smooth_surface_and_know_their_outside(dense: U3ORDense) -> None:
    coarse, fine = dense.model("chef"), dense.dense_model("chef")
    np.testing.assert_allclose(np.linalg.norm(fine.normals, axis=1), 1)
    outside = features.mesh_normals(coarse.points, coarse.faces)
    gaps, nearest = cKDTree(fine.points).query(coarse.points)
    assert gaps.max() < 1.5 * SPACING
    agreement = np.sum(fine.normals[nearest] * outside, axis=1)
    assert agreement.min() > 0
    assert np.quantile(agreement, 0.05) > 0.95


def test_noise_is_along_normals_and_lines_of_sight(dense: U3ORDense, monkeypatch: pytest.MonkeyPatch) -> None:
    def make() -> tuple[dict[str, np.ndarray], np.ndarray]:
        return dense._sample("T-rex"), dense._look_closely(12)["points"]

    model, scene = make()
    monkeypatch.setattr(u3or_dense, "NOISE", 0.0)
    smooth_model, smooth_scene = make()
    moved = model["points"] - smooth_model["points"]
    along = np.sum(moved * model["normals"], axis=1)
    assert along.std() == pytest.approx(NOISE, rel=0.05)
    np.testing.assert_allclose(moved, along[:, None] * model["normals"], atol=1e-9)
    assert (scene - smooth_scene)[:, 2].std() == pytest.approx(NOISE, rel=0.05)
    np.testing.assert_allclose(
        scene / scene[:, 2:], smooth_scene / smooth_scene[:, 2:], rtol=1e-9, atol=1e-12
    )


def test_clouds_come_from_the_cache(root: Path, dense: U3ORDense, monkeypatch: pytest.MonkeyPatch) -> None:
    before = matching(dense, "rs12-chef")
    for name in ("_sample", "_look_closely"):
        monkeypatch.setattr(U3ORDense, name, None)
    again = matching(U3ORDense(root), "rs12-chef")
    np.testing.assert_array_equal(again.source.points, before.source.points)
    np.testing.assert_array_equal(again.target.points, before.target.points)


def test_scan_in_full_resolution_is_moved_and_thinned(root: Path, dense: U3ORDense) -> None:
    there = dense.dense_scene(12).points
    scan = there[:, [1, 0, 2]] / [-1000, -1000, -1000]  # as PCL's: metres, axes exchanged
    path = root / "u3or" / "rs12.pcd"
    write_pcd(path, np.repeat(scan, 2, axis=0))
    try:
        thinned = U3ORDense(root).dense_scene(12).points
    finally:
        path.unlink()
    assert 0.2 * len(there) < len(thinned) <= len(there)
    assert within(thinned, there, SPACING).all()
    assert features.resolution(thinned) > 0.9 * SPACING


def test_benchmark_takes_the_given_normals(root: Path, dense: U3ORDense) -> None:
    case = Problem("experiment", "u3or-dense", "rs12-chef", matches="C1")
    (record,) = benchmark_matching.match_problems([case], str(root))
    assert record.error == ""
    pair = load_pair("u3or-dense", "rs12-chef", str(root))
    assert isinstance(pair, MatchingPair)
    model, scene = benchmark_matching.add_normals(pair, pair.normals)
    np.testing.assert_array_equal(model.normals, dense.dense_model("chef").normals)
    towards = -np.sum(scene.normals * scene.points, axis=1)
    assert (towards[np.isfinite(towards)] >= 0).all()


def test_normals_that_a_pair_has_lost_are_fitted(dense: U3ORDense) -> None:
    pair = matching(dense, "rs12-chef")
    assert usable_normals("given", pair.source, mirror(pair).target) == "given"
    assert usable_normals("given", mirror(pair).target) == "pca"
    assert usable_normals("mesh", pair.source, pair.target) == "pca"
    assert usable_normals("pca", pair.source) == "pca"


# --- real data -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def real() -> MatchingPair:
    return matching(U3ORDense(data_folder("u3or")), "rs1-chicken")


def test_real_scan_lies_on_the_dense_model(real: MatchingPair) -> None:
    assert len(real.source) > 60_000
    assert len(real.target) > 90_000
    assert np.median(distances(real)) < 0.7 * SPACING
    for cloud in (real.source, real.target):
        assert features.resolution(cloud.points) == pytest.approx(SPACING, rel=0.03)


def test_real_normals_agree_with_the_scan(real: MatchingPair) -> None:
    assert share_of_agreeing_normals(real, real.source.normals, 1) > 0.97


def test_scanner_spacing_is_that_of_the_real_scan() -> None:
    scan = read_cloud(data_folder("u3or") / "u3or" / "pcl" / "rs1.pcd")
    assert 1000 * features.resolution(scan.points) == pytest.approx(SCANNER_SPACING, abs=0.005)


def test_dense_pairs_speak_where_u3or_is_silent() -> None:
    places = paper.PLACES["U3OR"]
    assert places.index("u3or") < places.index("u3or-dense") < places.index("standin-clutter")
    assert "u3or-dense" not in paper.OF_THE_PAPER
