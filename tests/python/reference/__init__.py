"""Slow, readable NumPy versions of all grouping methods: the oracle of the tests.

One file per method, written from the equations; those of the nine are of the paper (J. Yang, K. Xian, P. Wang,
Y. Zhang, "A Performance Evaluation of Correspondence Grouping Methods for 3D Rigid Data
Matching", TPAMI 2019). Nothing here uses the compiled package.
Equation numbers count the paper's displayed equations: (1) is SS, (21) is recall.
"""

from .clipper import clipper
from .consistency_voting import cv
from .game_theory import gtm
from .geometric_consistency import gc
from .hough_voting import hough3d
from .likelihood_consensus import lc
from .nearest_neighbor_ratio import nnsr
from .otsu import otsu_split
from .ransac import ransac
from .result import ReferenceGrouping
from .sc2pcr import sc2pcr
from .search_of_inliers import si
from .similarity_score import ss
from .spectral import st
from .teaser import teaser
from .turboreg import turboreg
