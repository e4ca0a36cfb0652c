"""The pipeline on pairs whose pose is known."""

from dataclasses import replace

import numpy as np
import pytest

import cgroup
from cgroup import features
from cgroup.datasets import MatchingPair, standin_pair
from cgroup.errors import InputError, NoConsensusError
from cgroup.evaluation import correct_matches
from cgroup.registration import correspond, describe, register, surface_normals


@pytest.fixture(scope="module")
def pair() -> MatchingPair:
    return standin_pair(pixels=100)


@pytest.fixture(scope="module")
def matches(pair: MatchingPair) -> cgroup.Correspondences:
    return correspond(pair.source, pair.target)


def test_correspondences_have_every_field(pair: MatchingPair, matches: cgroup.Correspondences) -> None:
    mean = (features.resolution(pair.source.points) + features.resolution(pair.target.points)) / 2
    assert matches.resolution == mean
    np.testing.assert_allclose(matches.source_centroid, pair.source.points.mean(axis=0))
    source = {tuple(point) for point in pair.source.points}
    assert all(tuple(point) in source for point in matches.source)
    assert len({tuple(point) for point in matches.source}) == len(matches)  # one match per keypoint
    assert matches.similarity is not None
    assert ((matches.ratio >= 0) & (matches.ratio <= 1)).all()
    for frames in (matches.source_lrf, matches.target_lrf):
        identity = frames @ frames.transpose(0, 2, 1)
        np.testing.assert_allclose(identity, np.tile(np.eye(3), (len(matches), 1, 1)), atol=1e-6)


def test_a_moved_copy_matches_itself(pair: MatchingPair) -> None:
    moved = pair.source.transformed(pair.T_target_source)
    scanner = pair.T_target_source[:3, 3]  # the scanner moves along, so normals point the same way
    matches = correspond(pair.source, moved, target_viewpoint=tuple(scanner))
    tolerance = 0.1 * matches.resolution
    correct = correct_matches(matches.source, matches.target, pair.T_target_source, tolerance=tolerance)
    assert correct.mean() > 0.95


@pytest.mark.parametrize("descriptor", ["shot", "lfsh", "rcs"])
@pytest.mark.parametrize("detector", ["h3d", "iss"])
def test_every_combination_finds_correct_matches(detector: str, descriptor: str, pair: MatchingPair) -> None:
    matches = correspond(pair.source, pair.target, detector=detector, descriptor=descriptor)
    tolerance = 5 * matches.resolution
    correct = correct_matches(matches.source, matches.target, pair.T_target_source, tolerance=tolerance)
    chance = (10 * matches.resolution / np.ptp(pair.target.points, axis=0).max()) ** 2
    assert correct.mean() > 2 * chance


def test_no_consensus_is_no_pose(pair: MatchingPair) -> None:
    with pytest.raises(NoConsensusError, match="no reliable pose") as caught:
        register(pair.source, pair.target, front="paper", method="ransac", tolerance=1e-12)
    assert caught.value.registration is None


def test_given_normals_are_used(pair: MatchingPair, matches: cgroup.Correspondences) -> None:
    clouds = [replace(cloud, normals=surface_normals(cloud)) for cloud in (pair.source, pair.target)]
    same = correspond(*clouds, normals="given")
    assert np.array_equal(same.source, matches.source)
    assert np.array_equal(same.target, matches.target)
    turned = [replace(cloud, normals=-cloud.normals) for cloud in clouds]
    assert not np.array_equal(correspond(turned[0], clouds[1], normals="given").target, matches.target)
    for normals, missing in (("given", "normals"), ("mesh", "faces")):
        with pytest.raises(InputError, match=f"the cloud has no {missing}"):
            describe(pair.source.points, normals=normals)
