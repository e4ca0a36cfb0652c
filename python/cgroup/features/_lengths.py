"""Default radii in pr, and the resolution they refer to."""

from __future__ import annotations

from cgroup import _core
from cgroup._checks.run_options import run_options
from cgroup._checks.values import as_length
from cgroup.errors import InputError

HARRIS_RADIUS = 2.7
"""Default radius of Harris 3D in pr, as in the paper authors' pipeline."""

ISS_RADII = (2.7, 1.8)
"""Default salient and non-maximum radius of ISS in pr, as in the paper authors' pipeline."""

SUPPORT_RADIUS = 15.0
"""Radius of descriptors and frames in pr (paper, section 4.4)."""


def known_resolution(cloud: _core.Cloud, threads: int | None) -> float:
    """Return the resolution of the cloud, which keeps it."""
    return _core.resolution(cloud, run_options(threads), ignore_zero=False)


def length_or_multiple(
    name: str,
    given: float | None,
    factor: float,
    cloud: _core.Cloud,
    unit: float | None,
    threads: int | None,
) -> float:
    """Return the length `given`, or else `factor` times the resolution."""
    known = None if unit is None else as_length("resolution", unit)
    if given is not None:
        return as_length(name, given)
    if known is not None:
        return factor * known
    computed = known_resolution(cloud, threads)
    if computed == 0:
        raise InputError(
            name,
            remedy=f"the cloud's resolution is 0, as every point has a duplicate; give `{name}`",
        )
    return factor * computed
