"""Register clouds: estimate the pose between two clouds, and how reliable it is.

`register` downsamples both clouds to voxels, matches them, proposes poses by a grouping method, verifies
these on the surfaces, and refines and judges the best. `correspond` is the front end of the paper's
evaluation: normals, keypoints, local reference frames, descriptors, matches.
"""

from __future__ import annotations

from cgroup.features import ORIGIN, DescribedCloud, Viewpoint
from cgroup.registration.matching import match_described
from cgroup.registration.paper_front import (
    DESCRIPTORS,
    DETECTORS,
    Descriptor,
    Detector,
    PaperFront,
    correspond,
    describe,
    detect,
    surface_normals,
)
from cgroup.registration.prepare import DenseFront, PreparedScan, prepare
from cgroup.registration.recognition.recognize import Recognized, find_instances, recognize
from cgroup.registration.register import assess, refine, register, register_many
from cgroup.registration.result import Registration
from cgroup.registration.scan import NORMALS, Normals
from cgroup.registration.search import EFFORTS, Effort

__all__ = [
    "DESCRIPTORS",
    "DETECTORS",
    "EFFORTS",
    "NORMALS",
    "ORIGIN",
    "DenseFront",
    "DescribedCloud",
    "Descriptor",
    "Detector",
    "Effort",
    "Normals",
    "PaperFront",
    "PreparedScan",
    "Recognized",
    "Registration",
    "Viewpoint",
    "assess",
    "correspond",
    "describe",
    "detect",
    "find_instances",
    "match_described",
    "prepare",
    "recognize",
    "refine",
    "register",
    "register_many",
    "surface_normals",
]
