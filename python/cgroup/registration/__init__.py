"""The pipeline: two clouds in, grouped correspondences and a pose out.

Resolution, normals, keypoints, local reference frames, descriptors, matches, group, pose: each step is
one call, so that any of them can be replaced.
"""

from __future__ import annotations

from cgroup.features import ORIGIN, DescribedCloud, Viewpoint
from cgroup.registration.description import describe, detect, surface_normals
from cgroup.registration.front_end import DESCRIPTORS, DETECTORS, Descriptor, Detector
from cgroup.registration.matching import match_described
from cgroup.registration.pipeline import correspond, register
from cgroup.registration.result import Registration
from cgroup.registration.scan import NORMALS, Normals

__all__ = [
    "DESCRIPTORS",
    "DETECTORS",
    "NORMALS",
    "ORIGIN",
    "DescribedCloud",
    "Descriptor",
    "Detector",
    "Normals",
    "Registration",
    "Viewpoint",
    "correspond",
    "describe",
    "detect",
    "match_described",
    "register",
    "surface_normals",
]
