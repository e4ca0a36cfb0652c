"""Verify poses from any source on the two surfaces, and refine them.

Under a correct pose the surfaces coincide where they overlap, and neither is in the free space of the other's
scanner; a wrong pose that many matches support violates this. Lengths are in the unit of the points; `unit`
scales every tolerance.
"""

from cgroup.verification.alignment import Alignment, FineSurface, align
from cgroup.verification.schedule import Verification, score_poses, verify
from cgroup.verification.surface import Place, Surface, places

__all__ = [
    "Alignment", "FineSurface", "Place", "Surface", "Verification", "align", "places", "score_poses",
    "verify",
]  # fmt: skip
