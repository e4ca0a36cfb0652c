"""Verify poses: judge and refine poses from any source on the two surfaces.

=============  ==========================================================================================
`Surface`      points and normals made ready once, and kept for all poses and partners
`verify`       many poses in, the best few out: refined, scored, with what the surfaces say of the best
`score_poses`  scores of poses as they are
`places`       where each point of a surface lies under a pose
`FineSurface`  a cloud thinned out only a little
`align`        the last refinement of a pose, on the fine surfaces
=============  ==========================================================================================

Matches alone cannot tell a wrong pose that many of them happen to support from a right one with few. The
surfaces can: under a right pose they coincide where they overlap, and neither lies where the other's scanner
saw through. Lengths are in the unit of the points; `unit` scales every tolerance. Functions take ``threads``
(int or None, None for all cores); results do not depend on it. Input that can't be worked with raises
`InputError`, a `ValueError`.
"""

from __future__ import annotations

from cgroup.verification.alignment import Alignment, FineSurface, align
from cgroup.verification.places import Place, places
from cgroup.verification.schedule import Verification, score_poses, verify
from cgroup.verification.surface import Surface

__all__ = [
    "Alignment",
    "FineSurface",
    "Place",
    "Surface",
    "Verification",
    "align",
    "places",
    "score_poses",
    "verify",
]
