"""Match described clouds, and propose poses from their matches."""

from typing import Any

import numpy as np

from cgroup import features
from cgroup._checks.arrays import in_double
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_instance
from cgroup.errors import NoConsensusError
from cgroup.features import DescribedCloud
from cgroup.features.matching import Matches
from cgroup.group import group
from cgroup.types import BoolArray, Correspondences, FloatArray, Grouping
from cgroup.types.fields import FIELDS, Fields, own_correspondences

_OF_THE_CLOUDS = ("resolution", "source_centroid")  # all other fields have a row per match
_RESOLUTIONS = 3.0  # in LC's tolerance


@explain_wrong_calls
def match_described(
    source: DescribedCloud, target: DescribedCloud, *, threads: int | None = None
) -> Correspondences:
    """Match every source keypoint with the target keypoint of nearest descriptor.

    `threads` is as for `register`.

    Parameters
    ----------
    source, target : DescribedCloud
        With the same descriptor; the resolution of the matches is the mean of theirs.

    Returns
    -------
    Correspondences
        With every field that a method may need.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.registration import describe
    >>> described = describe(standin_pair(pixels=60).source)
    >>> matches = match_described(described, described)
    >>> len(matches) == len(described), float(matches.similarity.min())
    (True, 1.0)
    """
    as_instance("source", source, DescribedCloud)
    as_instance("target", target, DescribedCloud)
    matches = features.match(source.descriptors, target.descriptors, threads=threads)
    fields = _fields_of(source, target, matches)
    return Correspondences(**fields._asdict())  # users may describe by themselves


def match_both_ways(
    source: DescribedCloud, target: DescribedCloud, k: int, threads: int | None
) -> tuple[Correspondences, BoolArray]:
    """Match every source keypoint with its k nearest; return the mask of mutual matches, too."""
    matches = features.match(source.descriptors, target.descriptors, k=k, threads=threads)
    return as_correspondences(source, target, matches), matches.is_mutual & (matches.rank == 1)


def as_correspondences(source: DescribedCloud, target: DescribedCloud, matches: Matches) -> Correspondences:
    """Return matches of the descriptors of two clouds, with every field that a method may need."""
    return own_correspondences(_fields_of(source, target, matches))


def _fields_of(source: DescribedCloud, target: DescribedCloud, matches: Matches) -> Fields:
    """Return copies of the fields, independent of the clouds."""
    rows, partners = matches.source_indices, matches.target_indices
    return Fields(
        source.points[rows],
        target.points[partners],
        similarity=matches.similarity,
        ratio=matches.ratio,
        source_lrf=source.lrf[rows],
        target_lrf=target.lrf[partners],
        resolution=(source.resolution + target.resolution) / 2,
        source_centroid=np.array(source.centroid),
    )


def take_matches(matches: Correspondences, chosen: BoolArray) -> Correspondences:
    """Return some of the matches."""
    given = {name: value for name in FIELDS if (value := getattr(matches, name)) is not None}
    rows = {name: value if name in _OF_THE_CLOUDS else value[chosen] for name, value in given.items()}
    return own_correspondences(Fields(**rows))


def scale_matches(matches: Correspondences, scale: float) -> Correspondences:
    """Return the matches of a source in another unit."""
    centroid = None if matches.source_centroid is None else scale * matches.source_centroid
    given = Fields(*(getattr(matches, name) for name in Fields._fields))
    source = scale * in_double(matches.source)
    return own_correspondences(given._replace(source=source, source_centroid=centroid))


def propose_poses(
    matches: Correspondences,
    method: str,
    threads: int | None,
    **options: Any,  # noqa: ANN401 - those of the method
) -> FloatArray:
    """Group matches, and return the poses of the group; LC groups them by position alone.

    A known resolution is that of voxels, so LC need not estimate another.
    """
    if method == "lc":
        if matches.resolution is not None:
            options = {"tolerance": _RESOLUTIONS * matches.resolution, **options}
        by_position = {name: getattr(matches, name) for name in ("source", "target", "ratio", "resolution")}
        matches = own_correspondences(Fields(**by_position))
    return group_poses(group(matches, method, threads=threads, **options))


def group_poses(grouping: Grouping) -> FloatArray:
    """Return the poses of a group: its model and alternatives, or else its least-squares fit."""
    if grouping.alternatives is not None:
        return grouping.alternatives
    if grouping.model is not None:
        return grouping.model[None]
    try:
        return grouping.transform()[None]
    except NoConsensusError:
        return np.empty((0, 4, 4))


def frame_poses(matches: Correspondences) -> FloatArray:
    """Return the pose of every match that has frames: ``R_i = L'_i^T L_i``, ``t_i = q_i - R_i p_i``."""
    if matches.source_lrf is None or matches.target_lrf is None:
        return np.empty((0, 4, 4))
    frames = in_double(matches.target_lrf), in_double(matches.source_lrf)
    rotations = np.einsum("nji,njk->nik", *frames, optimize=True)
    framed = np.isfinite(rotations).all(axis=(1, 2))
    rotations = rotations[framed]
    poses = np.tile(np.eye(4), (len(rotations), 1, 1))
    poses[:, :3, :3] = rotations
    poses[:, :3, 3] = matches.target[framed] - np.einsum("nij,nj->ni", rotations, matches.source[framed])
    return poses
