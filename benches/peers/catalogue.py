"""Who is compared: every peer, what it computes, and where running it makes sense."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Literal, TypeAlias

from cgroup.registry import METHOD_INFO

if TYPE_CHECKING:
    from collections.abc import Iterable

Program: TypeAlias = Literal["cgroup", "numpy", "library", "modern", "pcl"]

OURS = "cgroup_"
"""Names of our own peers start so; the method's name follows."""

COMMON_SHARE = 0.1
LARGEST_OF_PEERS = 20_000


@dataclass(frozen=True)
class Peer:
    """One implementation of a method.

    Attributes
    ----------
    name : str
        What the command line and the records call it.
    label : str
        What tables and figures call it.
    method : str
        Our method that does the same job.
    program : {"cgroup", "numpy", "library", "modern", "pcl"}
        Who runs it.
    module : str
        What it needs to import, for libraries.
    threaded : bool
        Whether it can use several threads. One that can't runs once, and its figures stand for every number
        of threads.
    bytes_per_pair : float
        Measured peak memory over n^2, of those that keep matrices; what would not fit is not started.
    largest : int
        Largest n that is worth starting.
    common_share_only : bool
        It takes long: run at the common share of inliers only.
    note : str
        Why its mask is not ours.
    """

    name: str
    label: str
    method: str
    program: Program
    module: str = ""
    threaded: bool = True
    bytes_per_pair: float = 0.0
    largest: int = LARGEST_OF_PEERS
    common_share_only: bool = False
    note: str = ""


CLIQUES = "greedy cliques, each filtered by RANSAC, instead of the largest star"
BINS = "metric bins with interpolation, filtered by RANSAC, instead of 15 bins per axis"
POSE = "it answers with a pose; what lies within 5 pr of it counts as its group"
SAMPLES = f"other random samples; {POSE}"

SINGLE = f"in single precision; {POSE}"
START = "it starts from other random numbers"
CAPPED = f"it ends after 200,000 cliques in no order of weight; {POSE}"

OURS_PEERS = tuple(
    Peer(f"{OURS}{name}", f"cgroup {info.label}", name, "cgroup", largest=1_000_000)
    for name, info in METHOD_INFO.items()
)
SLOW = {"largest": 5000, "common_share_only": True}
OPEN3D = ("ransac", "library", "open3d")
GC_RANSAC = ("ransac", "library", "pygcransac")
TEASER = ("teaser", "modern", "_teaserpp")
TORCH = ("modern", "torch")

OTHERS = (
    Peer("pcl_gc", "PCL GC, threshold 3", "gc", "pcl", threaded=False, note=CLIQUES),
    Peer("pcl_gc10", "PCL GC, threshold 10", "gc", "pcl", threaded=False, note=CLIQUES),
    Peer("np_gc", "NumPy GC, n x n", "gc", "numpy", threaded=False, bytes_per_pair=17),
    Peer("np_gc_rows", "NumPy GC, row by row", "gc", "numpy", threaded=False),
    Peer("pcl_ransac", "PCL RANSAC", "ransac", "pcl", threaded=False, note="other random samples"),
    Peer("np_ransac_10k", "NumPy RANSAC", "ransac", "numpy"),
    Peer("o3d_ransac_10k", "Open3D RANSAC", *OPEN3D, note=SAMPLES, **SLOW),
    Peer("o3d_ransac_10k_fixed", "Open3D RANSAC, confidence 1", *OPEN3D, note=SAMPLES, **SLOW),
    Peer("o3d_ransac_100k_chk", "Open3D RANSAC, checkers", *OPEN3D, note=SAMPLES),
    Peer("o3d_fgr", "Open3D FGR", *OPEN3D, note=POSE),
    Peer("gcransac_uniform", "GC-RANSAC, uniform", *GC_RANSAC, threaded=False, note=SAMPLES),
    Peer("gcransac_prosac", "GC-RANSAC, PROSAC", *GC_RANSAC, threaded=False, note=SAMPLES),
    Peer("np_st_ratio_power", "NumPy ST, power steps", "st", "numpy", bytes_per_pair=43),
    Peer("np_st_ratio_eigsh", "SciPy ST, ARPACK", "st", "numpy", bytes_per_pair=43),
    Peer("np_st_ratio_eigh", "NumPy ST, LAPACK", "st", "numpy", bytes_per_pair=44, **SLOW),
    Peer("np_gtm", "NumPy GTM", "gtm", "numpy", bytes_per_pair=41),
    Peer("np_si", "NumPy SI", "si", "numpy", threaded=False),
    Peer("np_cv", "NumPy CV", "cv", "numpy"),
    Peer("pcl_hough", "PCL Hough", "3dhv", "pcl", threaded=False, note=BINS),
    Peer("np_hough", "NumPy 3DHV", "3dhv", "numpy", threaded=False),
    Peer("teaserpp_clique", "TEASER++, clique", *TEASER, note=POSE),
    Peer("teaserpp_core", "TEASER++, core", *TEASER, note=POSE),
    Peer("kiss", "KISS-Matcher", "teaser", "library", "kiss_matcher", note=POSE),
    Peer("clipper", "CLIPPER", "clipper", "modern", "clipperpy", bytes_per_pair=40, note=START),
    Peer("torch_sc2pcr", "PyTorch SC2-PCR", "sc2pcr", *TORCH, bytes_per_pair=30, note=SINGLE),
    Peer("torch_turboreg", "PyTorch TurboReg", "turboreg", *TORCH, bytes_per_pair=40, note=SINGLE),
    Peer("networkx_mac", "networkx MAC", "mac", "modern", "networkx", bytes_per_pair=90, note=CAPPED, **SLOW),
)

PEERS = {
    peer.name: peer
    for ours in OURS_PEERS
    for peer in (ours, *(other for other in OTHERS if other.method == ours.method))
}
"""All peers, ours first within each method."""


def selected(patterns: Iterable[str]) -> list[Peer]:
    """Peers whose name matches any of the patterns; all without a pattern."""
    wanted = list(patterns)
    return [
        peer
        for peer in PEERS.values()
        if not wanted or any(fnmatchcase(peer.name, pattern) for pattern in wanted)
    ]
