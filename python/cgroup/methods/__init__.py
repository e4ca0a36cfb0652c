"""The grouping methods, one typed signature per file.

References are to J. Yang, K. Xian, P. Wang, Y. Zhang, *A Performance Evaluation of Correspondence
Grouping Methods for 3D Rigid Data Matching*, TPAMI 2019 ("the paper").

A length (``tolerance`` and the like) is in the data's unit; without one it is the paper's multiple of
``resolution``. Each function hands its arguments on by their names; the compiled core reads its options.
"""

from cgroup.methods.clipper import clipper
from cgroup.methods.consistency_voting import cv
from cgroup.methods.game_theory import gtm
from cgroup.methods.geometric_consistency import gc
from cgroup.methods.hough_voting import hough3d
from cgroup.methods.likelihood_consensus import lc
from cgroup.methods.mac import mac
from cgroup.methods.nearest_neighbor_ratio import nnsr
from cgroup.methods.ransac import ransac
from cgroup.methods.sc2pcr import sc2pcr
from cgroup.methods.search_of_inliers import si
from cgroup.methods.similarity_score import ss
from cgroup.methods.spectral import st
from cgroup.methods.teaser import teaser
from cgroup.methods.turboreg import turboreg

__all__ = [
    "clipper",
    "cv",
    "gc",
    "gtm",
    "hough3d",
    "lc",
    "mac",
    "nnsr",
    "ransac",
    "sc2pcr",
    "si",
    "ss",
    "st",
    "teaser",
    "turboreg",
]
