"""All claims of the paper."""

from __future__ import annotations

from cgroup.benchmark.claims import (
    clutter_occlusion,
    combinations,
    density,
    efficiency,
    epsilon,
    inputs,
    matches,
    noise,
    overlap,
    registration,
    registration_inputs,
    summary,
)
from cgroup.benchmark.claims.claim import collect_claims

CLAIMS = collect_claims(
    inputs,
    noise,
    density,
    clutter_occlusion,
    overlap,
    epsilon,
    matches,
    combinations,
    registration,
    registration_inputs,
    efficiency,
    summary,
)
"""In the paper's order."""
