"""Register clouds: estimate the pose between two clouds, and how reliable it is.

`register` downsamples both clouds to voxels, matches them, proposes poses by a grouping method, verifies
these on the surfaces, and refines and judges the best. `correspond` is the front end of the paper's
evaluation: normals, keypoints, local reference frames, descriptors, matches.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from cgroup.features import ORIGIN, DescribedCloud, Viewpoint
from cgroup.fronts.matching import match_described
from cgroup.fronts.paper_front import (
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
from cgroup.fronts.scan import NORMALS, Normals
from cgroup.registration.decoys import FalseAccepts, false_accepts
from cgroup.registration.prepare import DenseFront, PreparedScan, prepare
from cgroup.registration.register import assess, refine, register, register_many
from cgroup.registration.result import Registration
from cgroup.registration.search import EFFORTS, Effort

if TYPE_CHECKING:
    from cgroup.recognition.recognize import Recognized as Recognized
    from cgroup.recognition.recognize import find_instances as find_instances
    from cgroup.recognition.recognize import recognize as recognize

__all__ = [
    "DESCRIPTORS", "DETECTORS", "EFFORTS", "NORMALS", "ORIGIN", "DenseFront", "DescribedCloud", "Descriptor",
    "Detector", "Effort", "FalseAccepts", "Normals", "PaperFront", "PreparedScan", "Recognized",
    "Registration", "Viewpoint", "assess", "correspond", "describe", "detect", "false_accepts",
    "find_instances", "match_described", "prepare", "recognize", "refine", "register", "register_many",
    "surface_normals",
]  # fmt: skip

_OF_RECOGNITION = ("Recognized", "find_instances", "recognize")


def __getattr__(name: str) -> Any:  # noqa: ANN401 - a class or a function
    """Load names of `cgroup.recognition`, which imports this module, on first use."""
    if name in _OF_RECOGNITION:
        return getattr(import_module("cgroup.recognition"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name)
