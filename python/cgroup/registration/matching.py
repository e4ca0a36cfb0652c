"""Matches of described clouds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup import features
from cgroup._checks.values import as_instance
from cgroup.features import DescribedCloud
from cgroup.types import Correspondences

if TYPE_CHECKING:
    from cgroup.features.matching import Matches
    from cgroup.types import BoolArray, RealArray


def match_described(
    source: DescribedCloud, target: DescribedCloud, *, threads: int | None = None
) -> Correspondences:
    """Match every source keypoint with the target keypoint of nearest descriptor.

    Parameters
    ----------
    source, target : DescribedCloud
        Described alike; the resolution of the matches is the mean of theirs.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    Correspondences
        With every field that a method may need.

    Raises
    ------
    InputError
        If the descriptors are not of the same kind, or what is given is no `DescribedCloud`.
    OutOfMemoryError
        Where the system gives no memory for the computation.

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
    return match_both_ways(source, target, 1, threads)[0]


def match_both_ways(
    source: DescribedCloud, target: DescribedCloud, k: int, threads: int | None
) -> tuple[Correspondences, BoolArray]:
    """Match every source keypoint with its k nearest, and say which matches are each other's nearest."""
    matches = features.match(source.descriptors, target.descriptors, k=k, threads=threads)
    return as_correspondences(source, target, matches), matches.is_mutual & (matches.rank == 1)


def as_correspondences(source: DescribedCloud, target: DescribedCloud, matches: Matches) -> Correspondences:
    """Return matches of the descriptors of two clouds with all that methods may need."""
    rows, partners = matches.source_indices, matches.target_indices
    return Correspondences(
        source.points[rows],
        target.points[partners],
        similarity=matches.similarity,
        ratio=matches.ratio,
        source_lrf=source.lrf[rows],
        target_lrf=target.lrf[partners],
        resolution=(source.resolution + target.resolution) / 2,
        source_centroid=source.centroid,
    )


def without_frames(matches: Correspondences) -> Correspondences:
    """Return the matches by position: for a method that would use frames, where they are not to be used."""
    return Correspondences(matches.source, matches.target, ratio=matches.ratio, resolution=matches.resolution)


def take_matches(matches: Correspondences, chosen: BoolArray) -> Correspondences:
    """Return some of the matches."""

    def rows(values: RealArray | None) -> RealArray | None:
        return None if values is None else values[chosen]

    return Correspondences(
        matches.source[chosen],
        matches.target[chosen],
        similarity=rows(matches.similarity),
        ratio=rows(matches.ratio),
        source_lrf=rows(matches.source_lrf),
        target_lrf=rows(matches.target_lrf),
        resolution=matches.resolution,
        source_centroid=matches.source_centroid,
        candidates=rows(matches.candidates),
    )
