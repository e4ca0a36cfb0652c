"""Input that raised errors of other libraries, or gave wrong results without a message."""

import warnings

import numpy as np
import pytest

import cgroup
from cgroup import Correspondences, comparison
from cgroup.datasets import standin_pair
from cgroup.errors import InputError, NoConsensusError
from cgroup.evaluation import clutter_and_occlusion, registration_recall, score_group, score_scene
from cgroup.features import sample_mesh, shot, voxel_downsample, within
from cgroup.pages import registration_page
from cgroup.plots import keypoints_figure
from cgroup.registration import assess, prepare, register
from cgroup.scenes import assess_in_map, locate, prepare_map, register_all
from cgroup.types import Grouping, PointCloud

RNG = np.random.default_rng(0)
POINTS = RNG.uniform(0, 10, (50, 3))
PAIR = standin_pair(pixels=60)
IDENTITY = np.eye(4)


@pytest.fixture(autouse=True)
def without_warnings() -> None:
    warnings.simplefilter("error")


def test_prepared_scans_are_located() -> None:
    place = prepare_map(PAIR.target)
    [found] = locate(prepare(PAIR.source), place)
    assert found.ok
    assert assess_in_map(prepare(PAIR.source), place, found.T_target_source).ok
    with pytest.raises(InputError, match="decoy: got 'no'"):
        locate(PAIR.source, place, decoy="no")  # type: ignore[arg-type]


def test_a_registration_is_no_map() -> None:
    with pytest.raises(InputError, match="cloud"):
        prepare_map(register(PAIR.source, PAIR.target))  # type: ignore[arg-type]


def test_one_cloud_is_no_list_of_scans() -> None:
    with pytest.raises(InputError, match="give two or more") as caught:
        register_all(PAIR.source.points)
    assert len(str(caught.value)) < 1000


def test_points_that_are_not_finite_are_named_so() -> None:
    with pytest.raises(InputError, match="finite|NaN"):
        locate(np.full((100, 3), np.nan), prepare_map(PAIR.target))


@pytest.mark.parametrize("far", [1e100, 1e149])
def test_a_pose_beyond_all_clouds_is_wrong(far: float) -> None:
    pose = np.eye(4)
    pose[:3, 3] = far
    assert assess(PAIR.source, PAIR.target, pose).probability == 0.0
    pose[:3, 3] = 1e151
    with pytest.raises(InputError, match="beyond 1e"):
        assess(PAIR.source, PAIR.target, pose)


def test_the_overlap_of_a_wrong_pose_is_its_own() -> None:
    pose = PAIR.T_target_source.copy()
    pose[:3, 3] += 1000
    wrong, right = (
        assess(PAIR.source, PAIR.target, pose),
        assess(PAIR.source, PAIR.target, PAIR.T_target_source),
    )
    assert (wrong.fitness, wrong.target_fitness, wrong.grouping.size) == (0, 0, 0)
    assert np.isnan(wrong.covariance).all()
    assert min(right.fitness, right.target_fitness) > 0.8
    assert np.isfinite(right.covariance).all()


def test_clouds_of_another_scale_are_placed_and_drawn() -> None:
    done = register(2 * PAIR.source.points, PAIR.target, scale=True)
    placed = done.place(PointCloud((2 * PAIR.source.points).tolist(), viewpoint=(0, 0, 0)))  # type: ignore[arg-type]
    assert len(placed) == len(PAIR.source)
    page = registration_page(2 * PAIR.source.points, PAIR.target, done, truth=PAIR.T_target_source)
    assert "error of the pose" in page


def test_drawings_refuse_what_cannot_be_drawn() -> None:
    broken = POINTS.copy()
    broken[3, 1] = np.nan
    with pytest.raises(InputError, match="finite|NaN"):
        keypoints_figure(broken, {"a": [1]}, title="x")
    with pytest.raises(InputError, match="give a cloud with points"):
        keypoints_figure([], {"a": []}, title="x")
    one = np.ones((40, 3))
    assert Correspondences(one, one).plot() is not None


def test_comparisons_check_their_arguments() -> None:
    matches = Correspondences(POINTS, POINTS + 1, resolution=1)
    pose = np.eye(4)
    pose[:3, 3] = 1
    for wrong in ({"max_rotation": "x"}, {"max_displacement": "x"}, {"progress": 1}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            list(comparison.compare(matches, pose, methods=["gtm"], **wrong))
    with pytest.raises(InputError, match="correspondences"):
        list(comparison.compare(5, pose))  # type: ignore[arg-type]


@pytest.mark.parametrize("pose", [0 * IDENTITY, np.diag([3, 3, 3, 1.0]), np.diag([1, 1, -1, 1.0])])
def test_scores_of_scenes_need_rigid_poses(pose: np.ndarray) -> None:
    for poses, truth in (([IDENTITY, pose], [IDENTITY] * 2), ([IDENTITY] * 2, [IDENTITY, pose])):
        with pytest.raises(InputError, match="poses|truth"):
            score_scene(poses, [[0, 1]], truth, ["a", "a"])
    unused = np.full((4, 4), np.nan)
    assert (
        score_scene([IDENTITY, IDENTITY, unused], [[0, 1]], [IDENTITY] * 3, ["a", "a", "b"]).rotation[0] == 0
    )


def test_empty_lists_are_masks() -> None:
    assert np.isnan(registration_recall([]))
    assert score_group([], []).selected == 0
    assert len(PointCloud(np.empty((0, 3))).select([])) == 0
    assert len(PointCloud([]).crop([0, 0, 0], [1, 1, 1])) == 0  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "wrong",
    [
        {"faces": np.array([[0, 1, 99]])},
        {"faces": np.array([[0, 1, -1]])},
        {"normals": POINTS[:3]},
        {"intensities": np.zeros(3, np.float32)},
    ],
)
def test_attributes_have_to_fit_the_points(wrong: dict[str, np.ndarray]) -> None:
    with pytest.raises(InputError, match="cloud|faces"):
        PointCloud(POINTS, **wrong).select(np.ones(50, bool))
    assert PointCloud(POINTS, faces=[]).select(np.ones(50, bool)).faces.shape == (0, 3)  # type: ignore[arg-type]


def test_voxels_and_radii_below_all_numbers() -> None:
    with pytest.raises(InputError, match="voxel"):
        voxel_downsample(POINTS * [1, 1, 0], 1e-310)
    empty = PointCloud(np.empty((0, 3)), colors=np.empty((0, 3), np.uint8))
    assert voxel_downsample(empty, 1.0).colors.shape == (0, 3)
    for place, radius in ((1e12, 1e-9), (1e15, 1e-3)):
        assert not within(POINTS + place, POINTS[::-1] + place + 1, radius).any()
        assert within(POINTS + place, POINTS + place, radius).all()


def test_areas_beyond_all_numbers_are_refused() -> None:
    faces = np.arange(30).reshape(-1, 3)
    far = POINTS[:30] * 1e148
    with pytest.raises(InputError, match="area"):
        sample_mesh(PointCloud(far, faces=faces))
    with pytest.raises(InputError, match="area"):
        clutter_and_occlusion(far, faces, far, faces, IDENTITY, tolerance=1e99)


def test_frames_have_to_be_rotations() -> None:
    normals = POINTS / np.linalg.norm(POINTS, axis=1)[:, None]
    with pytest.raises(InputError, match="lrf: got a frame that is no rotation in row 0"):
        shot(POINTS, normals, [0], radius=5, lrf=3 * np.ones((1, 3, 3)))


def test_teaser_on_a_vertical_line_and_with_a_huge_tolerance() -> None:
    line = np.column_stack([np.zeros((40, 2)), np.linspace(0, 50, 40)])
    found = cgroup.teaser(line, line + 1, resolution=1, dof=4)
    assert found.model is None
    with pytest.raises(NoConsensusError):
        found.transform()
    assert np.isfinite(cgroup.teaser(POINTS, POINTS + 1, tolerance=1e155).model).all()


def test_targets_have_texts_as_names() -> None:
    with pytest.raises(InputError, match="the key 0, which is no text"):
        cgroup.fit_targets(dict(enumerate(POINTS[:4])), dict(enumerate(POINTS[:4])))  # type: ignore[arg-type]


@pytest.mark.parametrize("width", [1.0, 0.1, 1e-2, 1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("seed", range(5))
def test_poses_of_almost_collinear_groups_are_exact(width: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(40, 3)) * [1.0, width, 0.3 * width]
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, rng.normal(size=3)
    mask = np.ones(40, dtype=bool)
    matches = Correspondences(points, points @ turn.T + pose[:3, 3], resolution=0.01)
    found = Grouping(mask, None, None, None, {}, _positions=(matches.source, matches.target)).transform()
    np.testing.assert_allclose(found, pose, rtol=0, atol=1e-13 + 1e-14 / width**2)
