"""Unrelated pairs, made by mixing or mirroring related ones: no pose between them is right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cgroup.datasets.base import Dataset, MatchingPair
from cgroup.features import Viewpoint
from cgroup.types import PointCloud


@dataclass(frozen=True, eq=False)
class UnrelatedPair:
    """Two clouds that no rigid motion aligns.

    Attributes
    ----------
    source, target : PointCloud
        In the same unit, each in its own frame.
    source_viewpoint, target_viewpoint : (float, float, float)
        Where the scanners stood, in their clouds' frames.
    """

    source: PointCloud
    target: PointCloud
    source_viewpoint: Viewpoint
    target_viewpoint: Viewpoint


def mixed_names(dataset: Dataset) -> list[tuple[str, str]]:
    """List pairs of different subjects, whose source and target share nothing.

    Parameters
    ----------
    dataset : Dataset
        Its `subject_of` names the subject of each pair.

    Returns
    -------
    list of (str, str)
        Names of the pairs that give the source and the target, always in the same order.
    """
    subjects = {name: dataset.subject_of(name) for name in dataset.pair_names()}
    return [
        (first, second) for first in subjects for second in subjects if subjects[first] != subjects[second]
    ]


def mix(first: MatchingPair, second: MatchingPair) -> UnrelatedPair:
    """Put the source of one pair beside the target of another.

    Parameters
    ----------
    first, second : MatchingPair
        Pairs that show different things, such as `mixed_names` lists.

    Returns
    -------
    UnrelatedPair
        The first's source and the second's target, with their viewpoints.
    """
    return UnrelatedPair(first.source, second.target, first.source_viewpoint, second.target_viewpoint)


def mirror(pair: MatchingPair) -> UnrelatedPair:
    """Reflect the target at the plane x = 0, and its viewpoint with it.

    Unless the shape is mirror-symmetric, no pose fits then. Faces and normals are dropped.

    Parameters
    ----------
    pair : MatchingPair
        Of two clouds that overlap.

    Returns
    -------
    UnrelatedPair
        The source as it is, and the mirrored target.

    Examples
    --------
    >>> from cgroup.datasets import mirror, standin_pair
    >>> pair = standin_pair(pixels=60)
    >>> bool((mirror(pair).target.points[:, 0] == -pair.target.points[:, 0]).all())
    True
    """
    x, y, z = pair.target_viewpoint
    target = PointCloud(pair.target.points * np.array([-1.0, 1.0, 1.0]))
    return UnrelatedPair(pair.source, target, pair.source_viewpoint, (-x, y, z))
