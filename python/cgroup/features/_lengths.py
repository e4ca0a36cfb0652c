"""Default radii in pr, and the resolution they refer to."""

from __future__ import annotations

from cgroup._checks.values import as_length
from cgroup.features._places import Places
from cgroup.features.cloud import resolution_of

HARRIS_RADIUS = 2.7
"""Default radius of Harris 3D in pr, as in the paper authors' pipeline."""

ISS_RADII = (2.7, 1.8)
"""Default salient and non-maximum radius of ISS in pr, as in the paper authors' pipeline."""

SUPPORT_RADIUS = 15.0
"""Radius of descriptors and frames in pr (paper, section 4.4)."""


def length_or_multiple(
    name: str,
    given: float | None,
    factor: float,
    cloud: Places,
    unit: float | None,
    threads: int | None,
) -> float:
    """Return the length `given`, or else `factor` times the resolution."""
    known = None if unit is None else as_length("resolution", unit)
    if given is not None:
        return as_length(name, given)
    if known is not None:
        return factor * known
    return factor * resolution_of(cloud, threads)
