"""Matches, descriptors and poses of the user's own: verified, refined and judged as those of `register`."""

import pickle
from typing import Any

import numpy as np
import pytest
from test_register import EYE, SOURCE, TARGET, TRUTH, is_right, same_bits

from cgroup import Correspondences, features
from cgroup.errors import InputError, NoConsensusError
from cgroup.registration import Registration, prepare, refine, register
from cgroup.rigid import apply
from cgroup.rigid.se3 import motion
from strategies import FloatArray

PR = features.resolution(SOURCE)
STRAY = np.array([[1e12, 0.0, 0.0]])


def describe(points: FloatArray) -> FloatArray:
    """FPFH of every point, as Open3D's users have it."""
    return features.fpfh(points, features.normals(points, viewpoint=EYE), radius=8 * PR)


OURS, THEIRS = describe(SOURCE), describe(TARGET)
FOUND = features.match(OURS, THEIRS, mutual=True)
ROWS = FOUND.source_indices, FOUND.target_indices
PLACES = Correspondences(SOURCE[ROWS[0]], TARGET[ROWS[1]])


def near_truth(degrees: float, share: float, seed: int = 0) -> FloatArray:
    """The true pose, turned about the middle of the source, and moved by a share of its diagonal."""
    rng = np.random.default_rng(seed)
    turn, shift = (axis / np.linalg.norm(axis) for axis in rng.normal(size=(2, 3)))
    length = share * float(np.linalg.norm(np.ptp(SOURCE, axis=0)))
    middle = apply(TRUTH, SOURCE.mean(axis=0)[None])[0]
    return motion(np.concatenate([np.radians(degrees) * turn, length * shift]), middle) @ TRUTH


@pytest.fixture(scope="module")
def by_rows() -> Registration:
    return register(SOURCE, TARGET, matches=ROWS)


def test_matches_of_one_s_own_propose_the_pose(by_rows: Registration) -> None:
    assert by_rows.ok
    assert is_right(by_rows)
    assert len(by_rows.correspondences) == len(by_rows.grouping.mask) == len(ROWS[0])
    assert by_rows.resolution == pytest.approx(0.4 * by_rows.voxel)
    np.testing.assert_array_equal(by_rows.correspondences.source, SOURCE[ROWS[0]])
    off = apply(TRUTH, SOURCE[ROWS[0]]) - TARGET[ROWS[1]]
    assert by_rows.grouping.mask[np.linalg.norm(off, axis=1) < by_rows.voxel].all()


def test_matches_are_rows_or_positions(by_rows: Registration) -> None:
    assert same_bits(by_rows, register(SOURCE, TARGET, matches=PLACES))
    kept = Correspondences(PLACES.source, PLACES.target, resolution=PR)
    assert register(SOURCE, TARGET, matches=kept).resolution == PR


def test_frames_of_few_matches_propose_poses() -> None:
    true = np.flatnonzero(np.linalg.norm(apply(TRUTH, PLACES.source) - PLACES.target, axis=1) < PR)[:2]
    frames = np.tile(np.eye(3), (2, 1, 1))
    both = {"source_lrf": frames, "target_lrf": frames @ TRUTH[:3, :3].T}
    two = PLACES.source[true], PLACES.target[true]
    assert is_right(register(SOURCE, TARGET, matches=Correspondences(*two, **both)))
    with pytest.raises(NoConsensusError, match="no pose could be proposed"):
        register(SOURCE, TARGET, matches=Correspondences(*two))


@pytest.mark.parametrize("bits", [np.float16, np.float64])
def test_descriptors_of_one_s_own_are_matched(bits: Any) -> None:
    found = register(SOURCE, TARGET, descriptors=(OURS.astype(bits), THEIRS.astype(bits)))
    assert found.ok
    assert is_right(found)
    used = found.correspondences.source
    assert len(used) < len(SOURCE)
    assert all((place == SOURCE).all(axis=1).any() for place in used[::100])


def test_points_without_a_descriptor_are_left_out() -> None:
    half = np.where(np.arange(len(TARGET))[:, None] % 2 == 0, THEIRS, np.nan)
    found = register(SOURCE, TARGET, descriptors=(OURS, half))
    assert is_right(found)
    assert all((TARGET[::2] == place).all(axis=1).any() for place in found.correspondences.target[::100])


@pytest.mark.parametrize("is_prepared", [False, True])
def test_rows_are_those_of_the_cloud_as_given(by_rows: Registration, *, is_prepared: bool) -> None:
    cloud: Any = np.concatenate([STRAY, SOURCE])
    if is_prepared:
        cloud = pickle.loads(pickle.dumps(prepare(cloud, voxel=by_rows.voxel)))
    found = register(cloud, TARGET, matches=(ROWS[0] + 1, ROWS[1]))
    assert is_right(found)
    np.testing.assert_array_equal(found.correspondences.source, SOURCE[ROWS[0]])
    described = np.concatenate([OURS[:1], OURS])
    found = register(cloud, TARGET, descriptors=(described, THEIRS), effort="high")
    assert is_right(found)
    assert found.correspondences.source.max() < STRAY.max()


@pytest.mark.parametrize("seed", range(2))
def test_a_rough_pose_leads_to_the_right_one(seed: int) -> None:
    found = register(SOURCE, TARGET, initial=near_truth(10, 0.2, seed))
    assert found.ok
    assert is_right(found)
    assert len(found.correspondences) == len(found.grouping.mask) == 0
    assert not {"matching", "grouping", "source descriptors"} & set(found.seconds)


@pytest.mark.parametrize("seed", range(2))
def test_a_rough_pose_that_is_wrong_is_refused(seed: int) -> None:
    with pytest.raises(NoConsensusError):
        register(SOURCE, TARGET, initial=near_truth(90, 0.1, seed))


def test_poses_beyond_the_radius_are_not_found() -> None:
    with pytest.raises(NoConsensusError):
        register(SOURCE, TARGET, initial=near_truth(0, 0.1), radius=2 * PR, angle=5)


@pytest.mark.parametrize("voxels", [0, 3])
def test_a_pose_is_refined(by_rows: Registration, voxels: int) -> None:
    rough = near_truth(voxels, 0.0)
    rough[:3, 3] += voxels * by_rows.voxel / 3**0.5
    found = refine(SOURCE, TARGET, rough)
    assert found.ok
    assert is_right(found)
    assert np.isfinite(found.covariance).all()
    assert found.fitness == pytest.approx(by_rows.fitness, abs=0.06)
    assert "source descriptors" not in found.seconds
    assert same_bits(found, refine(prepare(SOURCE, voxel=found.voxel), TARGET, rough, threads=1))


def test_a_wrong_pose_is_refused_with_the_reason() -> None:
    told = refine(SOURCE, TARGET, near_truth(120, 0.0))
    assert not told.ok
    assert told.notes[0].startswith("the best pose is right with a probability of")
    assert "matches" not in told.notes[0]
    with pytest.raises(NoConsensusError, match="do not overlap"):
        refine(SOURCE, TARGET, near_truth(0, 20.0))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"matches": 3}, r"matches: got 3; give Correspondences, or \(i, j\)"),
        ({"matches": (ROWS[0], ROWS[1][1:])}, "rows of the source and .* of the target; row k"),
        ({"matches": (ROWS[0] + len(SOURCE), ROWS[1])}, r"matches\[0\]: got row .* of .* points"),
        ({"matches": (ROWS[0], ROWS[1] - len(TARGET))}, r"matches\[1\]: got index -"),
        ({"matches": (ROWS[0] / 2, ROWS[1])}, r"matches\[0\]: got shape .* whole numbers"),
        ({"matches": Correspondences(np.nan * PLACES.source, PLACES.target)}, "matches.source: got .*nan"),
        ({"descriptors": OURS}, "descriptors: got .* give two arrays"),
        ({"descriptors": (OURS[1:], THEIRS)}, r"descriptors\[0\]: got .* rows for .* points"),
        ({"descriptors": (OURS, THEIRS[:, 1:])}, "descriptors: got 33 and 32 columns"),
        ({"descriptors": (OURS, np.nan * THEIRS)}, r"descriptors\[1\]: got no finite row"),
        ({"initial": 2 * np.eye(4)}, "initial: last row is"),
        ({"initial": TRUTH, "angle": 90}, "angle: got 90; give 60 degrees at most"),
        ({"radius": 1.0}, "radius: got 1, but no `initial`"),
        ({"initial": TRUTH, "method": "gtm"}, "method: nothing is grouped where `initial` is given"),
        ({"initial": TRUTH, "matches": ROWS}, "matches, initial: give one of them"),
        ({"descriptors": (OURS, THEIRS), "front": "paper"}, "descriptors, front: give one of them"),
    ],
)
def test_what_can_t_be_worked_with_is_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        register(SOURCE, TARGET, **options)
