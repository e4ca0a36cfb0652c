"""Data sets: small folders in their owners' layouts, and the real ones where they are."""

import io
import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cloud_files import write_pcd
from pair_measures import load, matching, residual, share_right
from scipy.spatial.transform import Rotation
from shared_data import data_folder
from test_io_mutations import mutate

from cgroup import features
from cgroup.datasets import (
    DATASETS,
    CorrespondencePair,
    MatchingPair,
    data_root,
    mirror,
    mix,
    mixed_names,
    open_dataset,
    standin_pair,
)
from cgroup.datasets.base import mean_resolution
from cgroup.datasets.cache import cache_folder, cached
from cgroup.datasets.generated import stones
from cgroup.datasets.generated.stones import stone
from cgroup.datasets.u3or import U3OR
from cgroup.errors import InputError
from cgroup.evaluation import PROTOCOLS, overlap
from cgroup.io import write_cloud
from cgroup.rigid import apply, invert
from cgroup.types import PointCloud

STANDINS = ["standin-full", "standin-clutter", "standin-views", "worlds", "worlds-repeating"]
REAL = [name for name in DATASETS if name not in [*STANDINS, "generated-matches"]]

POSE = np.array([[0.0, -1, 0, 30], [1, 0, 0, -20], [0, 0, 1, 200], [0, 0, 0, 1]])


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def _own_surroundings(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CGROUP_CACHE", str(cache))
    monkeypatch.delenv("CGROUP_DATA", raising=False)


@pytest.fixture(scope="module")
def model() -> PointCloud:
    mesh = stone(np.random.default_rng(4), 16)
    return PointCloud(mesh.vertices, faces=mesh.faces)


@pytest.fixture(scope="module")
def views() -> MatchingPair:
    return standin_pair(seed=2, turn=20, noise=0, pixels=50)


def text_of(pose: np.ndarray) -> str:
    return "\n".join(" ".join(repr(float(number)) for number in row) for row in pose) + "\n"


def write(path: Path, content: PointCloud | str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(content, str):
        path.write_text(content)
    else:
        write_cloud(path, content)


# --- opening ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "folder"), [*((name, DATASETS[name].folder) for name in REAL), ("lidar", "corr")]
)
def test_missing_data_says_where_to_get_it(name: str, folder: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no such folder.*get it from .*http") as caught:
        open_dataset(name, tmp_path)
    assert str(tmp_path) in str(caught.value)
    (tmp_path / folder).mkdir()
    with pytest.raises(InputError, match=r"isn't there.*http"):
        open_dataset(name, tmp_path)


def test_data_root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="CGROUP_DATA"):
        data_root()
    monkeypatch.setenv("CGROUP_DATA", str(tmp_path))
    assert data_root() == tmp_path
    assert data_root(tmp_path.parent) == tmp_path.parent
    monkeypatch.setenv("CGROUP_DATA", str(tmp_path / "nowhere"))
    with pytest.raises(InputError, match=r"nowhere.*from CGROUP_DATA"):
        data_root()


def test_dataset_from_outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = "from cgroup.datasets.generated.stones import StandinFull\nclass Mine(StandinFull):\n    name = 'mine'\n"
    (tmp_path / "outside_dataset.py").write_text(f"{code}def wrong(root): return 3\n")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    assert open_dataset("outside_dataset:Mine").name == "mine"
    for name, says in (
        ("b4r", r"choose one of b3r.*module:attribute"),
        ("outside_dataset:wrong", "made a int"),
        ("outside_dataset:Yours", "has no 'Yours'"),
    ):
        with pytest.raises(InputError, match=says):
            open_dataset(name)


@pytest.mark.parametrize("name", DATASETS)
def test_protocols_exist(name: str) -> None:
    factory = DATASETS[name]
    assert isinstance(factory, type)
    assert set(factory.protocols) <= set(PROTOCOLS)
    assert factory.name == name
    assert factory.citation
    assert factory.title


@pytest.mark.parametrize("named", [None, "", "relative", "absolute"])
def test_cache_folder_is_where_caches_are(
    named: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    platformdirs = pytest.importorskip("platformdirs")
    monkeypatch.delenv("CGROUP_CACHE", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    if named is not None:
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path) if named == "absolute" else named)
    assert str(cache_folder()) == platformdirs.user_cache_dir("cgroup", appauthor=False, opinion=False)


class Cached:
    """Arrays in a cache of its own, and how often they were made."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("CGROUP_CACHE", str(folder))
        self.folder, self.made = folder / "kind", 0
        self._arrays = {
            "a": np.arange(300.0).reshape(-1, 3),
            "empty": np.empty(0, int),
            "long name": np.eye(3) > 0,
        }

    def get(self, key: str = "key") -> None:
        found = cached("kind", [key, b"1"], self._make)
        assert list(found) == list(self._arrays)
        for name, array in self._arrays.items():
            assert found[name].dtype == array.dtype
            np.testing.assert_array_equal(found[name], array)

    def _make(self) -> dict[str, np.ndarray]:
        self.made += 1
        return self._arrays


def test_cache_makes_once_and_outlives_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = Cached(tmp_path / "here", monkeypatch)
    kept.get("other")
    [other] = kept.folder.iterdir()
    for _ in range(2):
        kept.get()
    assert kept.made == 2
    [file] = set(kept.folder.iterdir()) - {other}
    whole = file.read_bytes()
    unlike, plain = io.BytesIO(), io.BytesIO()
    np.savez_compressed(unlike, a=np.zeros(3))
    np.savez_compressed(plain, **np.load(file))
    rng = np.random.default_rng(0)
    damaged = {
        *(content for content in (mutate(rng, whole) for _ in range(200)) if content != whole),
        *(b"", b"PK", b"garbage", other.read_bytes(), unlike.getvalue(), plain.getvalue(), whole[:-16]),
    }
    for content in damaged:
        file.write_bytes(content)
        made = kept.made
        kept.get()
        assert kept.made == made + 1
        assert file.read_bytes() == whole


# --- owners' layouts -------------------------------------------------------------------------


CONFIG = """[MODELS]

NUMBER = 1

MODEL_0 = "/3D models/Stanford/stone/stone_res.ply"
MODEL_0_GROUNDTRUTH = "/3D models/Stanford/Retrieval/Scene0-rs0.xf"
MODEL_0_CATEGORY = 0

[SCENE]

MIAN_SCENE = 1
PATH = "/3D models/Stanford/Retrieval/Scene0.ply"
"""


@pytest.fixture(scope="module")
def noisy(model: PointCloud) -> dict[float, PointCloud]:
    vectors = np.random.default_rng(0).normal(size=model.points.shape)
    return {level: PointCloud(apply(POSE, model.points) + level * vectors) for level in (0.1, 0.3, 0.5)}


@pytest.fixture
def b3r(tmp_path: Path, model: PointCloud, noisy: dict[float, PointCloud]) -> Path:
    stanford = tmp_path / "b3r" / "3D models" / "Stanford"
    write(stanford / "stone" / "stone_res.ply", model)
    write(stanford / "Retrieval" / "ConfigScene0.ini", CONFIG)
    write(stanford / "Retrieval" / "Scene0-rs0.xf", text_of(POSE))
    for level, scene in noisy.items():
        write(stanford / "Retrieval" / f"Scene0_{level}.ply", scene)
    return tmp_path


def test_b3r_as_published(b3r: Path, model: PointCloud, noisy: dict[float, PointCloud]) -> None:
    dataset = open_dataset("b3r", b3r)
    assert dataset.pair_names() == ["scene0-noise0.1", "scene0-noise0.3", "scene0-noise0.5"]
    for level, scene in noisy.items():
        pair = matching(dataset, f"scene0-noise{level}")
        np.testing.assert_array_equal(pair.target.points, scene.points)
        np.testing.assert_array_equal(pair.source.points, model.points)
        np.testing.assert_array_equal(pair.T_target_source, POSE)
        np.testing.assert_allclose(pair.target_viewpoint, apply(POSE, np.zeros((1, 3)))[0])
        assert pair.facts == {"noise": level}
    for path in b3r.rglob("Scene0_0.[35].ply"):
        path.unlink()
    for level in (0.3, 0.5):  # built again
        rebuilt = load("b3r", b3r, f"scene0-noise{level}").target.points
        np.testing.assert_allclose(rebuilt, noisy[level].points, atol=1e-9)
    clean = load("b3r-clean", b3r, "scene0").target
    np.testing.assert_allclose(clean.points, apply(POSE, model.points))
    assert clean.faces is not None


def test_b3r_turns_an_inverse_pose_round(b3r: Path) -> None:
    pose_file = next(b3r.rglob("*.xf"))
    pose_file.write_text(text_of(np.linalg.inv(POSE)))
    pair = load("b3r", b3r, "scene0-noise0.1")
    np.testing.assert_allclose(pair.T_target_source, POSE, atol=1e-9)
    wrong = POSE.copy()
    wrong[0, 3] += 500
    pose_file.write_text(text_of(wrong))
    with pytest.raises(InputError, match="neither the pose nor its inverse"):
        load("b3r", b3r, "scene0-noise0.1")


def stand(number: int) -> np.ndarray:
    """Stones side by side before the scanner, turned so that each shows another side."""
    angle = 1.3 * number
    pose = np.eye(4)
    pose[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    pose[:3, 3] = (90.0 * number, 10, -600 - 30 * number)
    return pose


U3OR_MODELS = {"chef": "cheff.ply", "chicken": "chicken_high.ply", "T-rex": "T-rex_high.ply"}


@pytest.fixture
def u3or(tmp_path: Path) -> Path:
    home = tmp_path / "u3or"
    for number, (name, file) in enumerate(U3OR_MODELS.items()):
        mesh = stone(np.random.default_rng(number), 24)
        write(home / "models" / file, PointCloud(mesh.vertices, faces=mesh.faces))
        for scene in (1, 12):
            write(home / "GroundTruth_3Dscenes" / f"{name}-rs{scene}.xf", text_of(stand(number)))
    write(home / "GroundTruth_3Dscenes" / "rhino-rs1.xf", text_of(np.eye(4)))
    write(home / "GroundTruth_3Dscenes" / "chef-rs1-old.xf", text_of(np.eye(4)))
    write(home / "occlusion.txt", "scene\tobject\t% occlusion\n1\tchef\t77.2\n12\ttrex\t69.3\n")
    return tmp_path


def test_u3or_simulates_the_scenes_that_are_missing(u3or: Path) -> None:
    dataset = open_dataset("u3or", u3or)
    assert dataset.pair_names() == [
        f"rs{scene}-{name}" for scene in (1, 12) for name in ("T-rex", "chef", "chicken")
    ]
    pair = matching(dataset, "rs12-T-rex")
    assert dataset.origin_of("rs12-T-rex") == "semi-synthetic"
    np.testing.assert_allclose(pair.T_target_source, stand(2))
    assert pair.normals == "mesh"
    assert residual(pair) < 1
    assert pair.facts["occlusion"] == pytest.approx(0.693)
    assert 0.5 < pair.facts["clutter"] < 0.8
    computed = matching(dataset, "rs12-chef")  # nothing is published
    assert 0.5 < computed.facts["occlusion"] < 0.8
    again = matching(dataset, "rs12-T-rex")  # from the cache
    np.testing.assert_array_equal(again.target.points, pair.target.points)


def test_u3or_takes_the_scan_that_is_there(u3or: Path) -> None:
    made = open_dataset("u3or", u3or)
    assert isinstance(made, U3OR)
    scan = made.scene(12)
    write(u3or / "u3or" / "scenes" / "rs12.ply", scan)
    dataset = open_dataset("u3or", u3or)
    assert dataset.origin_of("rs12-chef") == "real"
    assert dataset.origin_of("rs1-chef") == "semi-synthetic"
    pair = matching(dataset, "rs12-chef")
    np.testing.assert_allclose(pair.target.points, scan.points)
    pose_file = u3or / "u3or" / "GroundTruth_3Dscenes" / "chef-rs12.xf"
    pose_file.write_text(text_of(np.linalg.inv(stand(0))))
    np.testing.assert_allclose(load("u3or", u3or, "rs12-chef").T_target_source, stand(0), atol=1e-9)


def test_u3or_pose_behind_the_scanner(u3or: Path) -> None:
    pose_file = u3or / "u3or" / "GroundTruth_3Dscenes" / "chef-rs12.xf"
    pose_file.write_text(text_of(np.linalg.inv(stand(1))))
    with pytest.raises(InputError, match=r"chef-rs12.xf: .*behind the scanner"):
        open_dataset("u3or", u3or).load("rs12-chef")


@pytest.fixture
def stanford(tmp_path: Path, views: MatchingPair) -> Path:
    """Two views, the second in the frame of a world that the first is turned into; and one far away."""
    home = tmp_path / "stanford_views" / "stone" / "data"
    apart = PointCloud(views.source.points + np.array([0, 0, 1000]))
    for name, cloud in (("a.ply", views.source), ("b.ply", views.target), ("c.ply", apart)):
        write(home / name, cloud)
    rotation, translation = views.T_target_source[:3, :3], views.T_target_source[:3, 3]
    # The format's quaternions turn the other way.
    world = [*translation, *Rotation.from_matrix(rotation.T).as_quat()]
    numbers = " ".join(repr(float(number)) for number in world)
    write(
        home / "stone.conf",
        f"camera 0 0 0 0 0 0 1\nmesh x 0 0 0 0 0 0 1\nbmesh a.ply {numbers}\nbmesh b.ply 0 0 0 0 0 0 1\n"
        f"bmesh c.ply {numbers}\nbmesh missing.ply 0 0 0 0 0 0 1\n",
    )
    return tmp_path


def test_stanford_reads_configurations_and_finds_pairs(stanford: Path, views: MatchingPair) -> None:
    dataset = open_dataset("stanford", stanford)
    assert dataset.pair_names() == ["stone/a-b"]
    pair = matching(dataset, "stone/a-b")
    np.testing.assert_allclose(pair.T_target_source, views.T_target_source, atol=1e-6)
    pr = mean_resolution(pair.source, pair.target)
    expected = overlap(pair.source.points, pair.target.points, views.T_target_source, tolerance=4 * pr)
    assert pair.facts["overlap"] == pytest.approx(expected, abs=1e-3)


def test_stanford_takes_the_manifests_list(stanford: Path) -> None:
    entry = {"pairs": [{"set": "stone", "src": "b.ply", "tgt": "a.ply"}]}
    write(stanford / "manifest.json", json.dumps({"stanford_views": entry}))
    dataset = open_dataset("stanford", stanford)
    assert dataset.pair_names() == ["stone/b-a"]
    assert matching(dataset, "stone/b-a").facts["overlap"] > 0.5


def log_of(pairs: dict[tuple[int, int], np.ndarray]) -> str:
    return "".join(f"{i}\t{j}\t9\n{text_of(pose)}" for (i, j), pose in pairs.items())


@pytest.fixture
def threedmatch(tmp_path: Path, views: MatchingPair) -> Path:
    home = tmp_path / "threedmatch"
    # In m, so that the grid of 2.5 cm leaves the shape: the stone is 10 m wide.
    for number, cloud in ((0, views.target), (2, views.source)):
        write(home / "kitchen" / f"cloud_bin_{number}.ply", PointCloud(cloud.points / 10))
    pose = views.T_target_source.copy()
    pose[:3, 3] /= 10
    write(home / "kitchen-evaluation" / "gt.log", log_of({(0, 2): pose}))
    write(home / "benchmarks" / "3DLoMatch" / "kitchen" / "gt.log", log_of({(2, 0): np.linalg.inv(pose)}))
    return tmp_path


def test_threedmatch_reads_logs_of_both_benchmarks(threedmatch: Path, views: MatchingPair) -> None:
    dataset = open_dataset("3dmatch", threedmatch)
    assert dataset.pair_names() == ["3DMatch/kitchen/0-2", "3DLoMatch/kitchen/2-0"]
    pair = matching(dataset, "3DMatch/kitchen/0-2")
    np.testing.assert_allclose(pair.T_target_source[:3, :3], views.T_target_source[:3, :3])
    assert len(pair.source) == len(views.source)
    assert pair.facts["overlap"] > 0.7
    assert "3dmatch" in dataset.protocols
    other = matching(dataset, "3DLoMatch/kitchen/2-0")
    np.testing.assert_allclose(other.T_target_source @ pair.T_target_source, np.eye(4), atol=1e-9)
    (threedmatch / "threedmatch" / "kitchen" / "cloud_bin_0.ply").unlink()
    with pytest.raises(InputError, match=r"cloud_bin_0.ply: no such file"):
        dataset.load("3DMatch/kitchen/0-2")


def test_threedmatch_test_sets_are_whole_fragments_of_one_benchmark(
    threedmatch: Path, views: MatchingPair
) -> None:
    whole, low = open_dataset("3dmatch-test", threedmatch), open_dataset("3dlomatch-test", threedmatch)
    assert whole.pair_names() == ["3DMatch/kitchen/0-2"]
    assert low.pair_names() == ["3DLoMatch/kitchen/2-0"]
    np.testing.assert_allclose(matching(whole, "3DMatch/kitchen/0-2").target.points, views.target.points / 10)
    # In the layout of PointDSC:
    for folder, scene in (("fragments", "kitchen"), ("gt_result", "kitchen-evaluation")):
        (threedmatch / folder).mkdir()
        (threedmatch / "threedmatch" / scene).rename(threedmatch / folder / scene)
    shutil.rmtree(threedmatch / "threedmatch")
    dataset = open_dataset("3dmatch-test", threedmatch)
    assert dataset.pair_names() == ["3DMatch/kitchen/0-2"]
    assert len(matching(dataset, "3DMatch/kitchen/0-2").source)


def _drive(home: Path, points: np.ndarray, step: float, scans: int) -> list[np.ndarray]:
    """Write a drive along the camera's z axis, in a world that is fixed in the first scanner's frame."""
    calibration = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, -0.3], [0, 0, 0, 1]])
    poses, places = [], []
    for number in range(scans):
        camera = np.eye(4)
        camera[2, 3] = step * number
        poses.append(camera[:3].reshape(-1))
        scanner = invert(calibration) @ camera @ calibration
        places.append(scanner)
        seen = apply(invert(scanner), points).astype("<f4")
        path = home / "sequences" / "08" / "velodyne" / f"{number:06d}.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.column_stack([seen, np.zeros(len(seen), dtype="<f4")]).tofile(path)
    numbers = " ".join(map(repr, calibration[:3].reshape(-1).tolist()))
    write(home / "sequences" / "08" / "calib.txt", f"P0: {numbers}\nTr: {numbers}\n")
    write(home / "poses" / "08.txt", text_of(np.array(poses)))
    return places


def test_kitti_pairs_scans_before_they_are_ten_metres_apart(tmp_path: Path, views: MatchingPair) -> None:
    home = tmp_path / "kitti"
    places = _drive(home, views.source.points / 5, 3.0, 9)
    dataset = open_dataset("kitti", tmp_path)
    # The fourth step passes 10 m, the next pair begins behind the third.
    assert dataset.pair_names() == ["08/0-3", "08/4-7"]
    pair = matching(dataset, "08/4-7")
    np.testing.assert_allclose(pair.T_target_source, invert(places[7]) @ places[4], atol=0.02)
    (home / "icp").mkdir()
    np.save(home / "icp" / "8_4_7.npy", np.eye(4))
    np.testing.assert_array_equal(matching(dataset, "08/4-7").T_target_source, np.eye(4))
    (home / "sequences" / "08" / "velodyne" / "000003.bin").unlink()
    assert open_dataset("kitti", tmp_path).pair_names() == ["08/4-7"]
    assert open_dataset("kitti", home).pair_names() == ["08/4-7"]


def test_threedmatch_thins_out(threedmatch: Path) -> None:
    dense = np.random.default_rng(0).uniform(size=(4000, 3)) * [1, 1, 0.001]
    for number in (0, 2):
        write(threedmatch / "threedmatch" / "kitchen" / f"cloud_bin_{number}.ply", PointCloud(dense))
    log = threedmatch / "threedmatch" / "kitchen-evaluation" / "gt.log"
    log.write_text(log_of({(0, 2): np.eye(4)}))
    pair = load("3dmatch", threedmatch, "3DMatch/kitchen/0-2")
    assert 1000 < len(pair.source) < 1601  # 40 x 40 cells


@pytest.fixture
def fgr(tmp_path: Path, views: MatchingPair) -> Path:
    home = tmp_path / "fgr" / "pair_01"
    write(home / "Depth_0000.ply", views.target)
    write(home / "Depth_0001.ply", views.source)
    write(home / "gt.log", log_of({(0, 1): views.T_target_source}))
    for number, cloud in ((0, views.target.points), (1, apply(views.T_target_source, views.source.points))):
        # Features that are the true places: nearest neighbours are correct matches.
        table = np.concatenate([cloud, cloud], axis=1).astype("<f4")
        head = np.array([len(cloud), 3], dtype="<i4")
        (home / f"features_000{number}.bin").write_bytes(head.tobytes() + table.tobytes())
    return tmp_path


def test_fgr_matches_features_both_ways(fgr: Path, views: MatchingPair) -> None:
    dataset = open_dataset("fgr", fgr)
    pair = dataset.load("pair_01")
    assert isinstance(pair, CorrespondencePair)
    found = pair.correspondences
    assert found.ratio is not None
    np.testing.assert_array_equal(pair.T_target_source, views.T_target_source)
    assert len(np.unique(found.target, axis=0)) == len(found) > 200
    assert share_right(found, pair.T_target_source, 4.0) > 0.8
    # The same, from neighbours that were computed before.
    posed = apply(views.T_target_source, views.source.points).astype(np.float32)
    there = views.target.points.astype(np.float32)
    matches, back = features.match(posed, there), features.match(there, posed)
    np.savez(
        fgr / "fgr" / "pair_01" / "fpfh_nn.npz",
        src1_to_0=matches.target_indices,
        src0_to_1=back.target_indices,
        ratio1=matches.ratio,
    )
    again = open_dataset("fgr", fgr).load("pair_01")
    np.testing.assert_array_equal(again.correspondences.source, found.source)
    np.testing.assert_array_equal(again.correspondences.target, found.target)


def test_fgr_clouds(fgr: Path, views: MatchingPair) -> None:
    pair = load("fgr-clouds", fgr, "pair_01")
    np.testing.assert_array_equal(pair.T_target_source, views.T_target_source)
    assert (len(pair.source), len(pair.target)) == (len(views.source), len(views.target))
    assert 0.3 < pair.facts["overlap"] <= 1


@pytest.mark.parametrize(
    ("source", "target", "pose", "name"),
    [
        ("lidar/a_source.ply", "lidar/a_target.ply", "lidar/a_T_target_source.txt", "lidar/a"),
        ("corr/k/07_pts_src.ply", "corr/k/07_pts_dst.ply", "corr/k/07_trans.txt", "corr/k/07"),
        ("corr/t/8_v0.3.pcd", "corr/t/2_v0.3.pcd", "corr/t/8-2.pose", "corr/t/8-2"),
    ],
)
def test_lidar_layouts(
    tmp_path: Path, views: MatchingPair, source: str, target: str, pose: str, name: str
) -> None:
    for name_of_cloud, cloud in ((source, views.source), (target, views.target)):
        path = tmp_path / name_of_cloud
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".pcd":
            write_pcd(path, cloud.points)
        else:
            write(path, cloud)
    np.savetxt(tmp_path / pose, np.linalg.inv(views.T_target_source))  # the direction that fits is taken
    alone = (tmp_path / pose).name.replace("8-2", "9-3").replace("07", "08").replace("a_T", "b_T")
    (tmp_path / pose).with_name(alone).write_text("no clouds beside it")
    dataset = open_dataset("lidar", tmp_path)
    assert dataset.pair_names() == [name]
    assert dataset.single_views
    assert dataset.subject_of(name) == name
    pair = matching(dataset, name)
    np.testing.assert_allclose(pair.T_target_source, views.T_target_source, atol=1e-9)
    assert 0.3 < pair.facts["overlap"] <= 1


def test_mirrored_and_mixed_pairs(views: MatchingPair) -> None:
    seen = replace(views, source_viewpoint=(1.0, 2.0, 3.0), target_viewpoint=(4.0, 5.0, 6.0))
    mirrored = mirror(seen)
    assert mirrored.source is views.source
    np.testing.assert_array_equal(mirrored.target.points, views.target.points * [-1, 1, 1])
    assert (mirrored.source_viewpoint, mirrored.target_viewpoint) == ((1, 2, 3), (-4, 5, 6))
    other = replace(seen, target=PointCloud(views.target.points + 1), target_viewpoint=(7.0, 8.0, 9.0))
    mixed = mix(seen, other)
    assert mixed.source is views.source
    assert mixed.target is other.target
    assert (mixed.source_viewpoint, mixed.target_viewpoint) == ((1, 2, 3), (7, 8, 9))


def test_pairs_are_mixed_across_subjects() -> None:
    class _Two(stones.StandinViews):
        def pair_names(self) -> list[str]:
            return ["a1", "a2", "b1"]

        def subject_of(self, name: str) -> str:
            return name[0]

    assert mixed_names(_Two()) == [("a1", "b1"), ("a2", "b1"), ("b1", "a1"), ("b1", "a2")]
    assert mixed_names(open_dataset("standin-full")) == []
    assert len(mixed_names(open_dataset("standin-views"))) == 12 * 11


def test_correspondence_files(tmp_path: Path) -> None:
    source = np.random.default_rng(0).normal(size=(20, 3))
    target = apply(POSE, source)
    home = tmp_path / "corr"
    write(home / "indoor" / "corr.txt", text_of(np.hstack([source, target])))
    write(home / "indoor" / "GTmat.txt", text_of(POSE))
    for name, points in (("src", source), ("dst", target)):
        write(home / "street" / f"007_fpfh_kpts_{name}.txt", text_of(points))
    write(home / "street" / "007_trans.txt", text_of(POSE))
    for folder in ("far_kitti", "facade"):
        thrice = np.repeat(np.hstack([source, target]), 3, axis=0)
        write(home / folder / "833_821_top3.match", text_of(thrice))
        write(home / folder / "833-821.pose", text_of(POSE))
    dataset, three = open_dataset("corr", tmp_path), open_dataset("corr-three", tmp_path)
    assert dataset.pair_names() == ["indoor", "street/007"]
    assert three.pair_names() == ["facade/833-821", "far_kitti/833-821"]
    for name, inlier_distance, protocols in (
        ("indoor", 0.1, ("precision>0.1", "3dmatch")),
        ("street/007", 0.6, ("precision>0.1", "kitti", "kitti-2m")),
    ):
        pair = dataset.load(name)
        np.testing.assert_array_equal(pair.correspondences.source, source)
        assert pair.correspondences.resolution == pytest.approx(inlier_distance / 5)
        assert share_right(pair.correspondences, pair.T_target_source, 1e-6) == 1
        assert dataset.protocols_of(name) == protocols
    for name, distance in zip(three.pair_names(), (0.3, 0.6), strict=True):
        pair = three.load(name)
        assert len(pair.correspondences) == 60
        assert pair.correspondences.resolution == pytest.approx(distance / 5)
        np.testing.assert_array_equal(pair.T_target_source, POSE)


def test_u3m_reads_the_list_beside_the_views(tmp_path: Path, views: MatchingPair) -> None:
    home = tmp_path / "u3m" / "Chef"
    write(home / "view1.ply", views.source)
    write(home / "view2.ply", views.target)
    numbers = " ".join(repr(float(number)) for number in views.T_target_source.reshape(-1))
    write(home / "pairs.txt", f"view1.ply view2.ply {numbers}\n\n")
    dataset = open_dataset("u3m", tmp_path)
    assert dataset.pair_names() == ["Chef/view1-view2"]
    pair = matching(dataset, "Chef/view1-view2")
    np.testing.assert_array_equal(pair.T_target_source, views.T_target_source)
    assert pair.facts["overlap"] > 0.7


# --- real data -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "folder", "pair_name", "limit"),
    [
        ("b3r", "b3r", "scene0-noise0.1", 0.7),
        ("b3r-clean", "b3r", "scene7", 1e-6),
        ("stanford", "stanford_views", "bunny/bun000-bun045", 1.0),
        ("3dmatch", "threedmatch", "3DMatch/7-scenes-redkitchen/6-7", 1.0),
        ("u3or", "u3or", "rs1-chef", 1.2),
        ("u3or", "u3or", "rs6-parasaurolophus", 1.2),
    ],
)
def test_real_poses_fit(name: str, folder: str, pair_name: str, limit: float) -> None:
    assert residual(load(name, data_folder(folder), pair_name)) < limit


@pytest.mark.parametrize(
    ("dataset", "name", "matches", "share", "doubt"),
    [
        ("fgr", "pairwise_noise_xyz_level_01_01_rot_05", None, 0.47, 0.03),
        ("corr", "mac_py_redkitchen_24_59", 5678, 0.037, 0.005),
        ("corr", "turboreg_kitti/000", 5344, 0.02, 0.005),
    ],
)
def test_matches_have_the_known_share_of_inliers(
    dataset: str, name: str, matches: int | None, share: float, doubt: float
) -> None:
    pair = open_dataset(dataset, data_folder(dataset)).load(name)
    assert isinstance(pair, CorrespondencePair)
    assert matches in {None, len(pair.correspondences)}
    assert share_right(pair.correspondences, pair.T_target_source) == pytest.approx(share, abs=doubt)
