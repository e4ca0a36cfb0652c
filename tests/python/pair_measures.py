"""What the tests of data sets measure of a pair: how well its clouds, normals and matches agree."""

from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from cgroup.datasets import Dataset, MatchingPair, open_dataset
from cgroup.datasets.base import mean_resolution
from cgroup.evaluation import correct_matches
from cgroup.rigid import apply, check_rigid
from cgroup.types import Correspondences


def matching(dataset: Dataset, name: str) -> MatchingPair:
    pair = dataset.load(name)
    assert isinstance(pair, MatchingPair)
    assert pair.name == name
    check_rigid(pair.T_target_source)
    return pair


def load(name: str, root: Path, pair_name: str) -> MatchingPair:
    return matching(open_dataset(name, root), pair_name)


def residual(pair: MatchingPair) -> float:
    """Median distance in pr from source points to the target, of those that come within 4 pr of it."""
    pr = mean_resolution(pair.source, pair.target)
    posed = apply(pair.T_target_source, pair.source.points)
    distances, _ = cKDTree(pair.target.points).query(posed[::5])
    return float(np.median(distances[distances < 4 * pr])) / pr


def share_right(found: Correspondences, pose: np.ndarray, bound: float = 5.0) -> float:
    """Share of matches that are correct, with a bound in pr."""
    tolerance = bound * found.resolution
    return float(correct_matches(found.source, found.target, pose, tolerance=tolerance).mean())
