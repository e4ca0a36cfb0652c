"""Who is compared: every peer, what it computes, and where running it makes sense."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterable

Program: TypeAlias = Literal["cgroup", "numpy", "library", "pcl"]

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
    program : {"cgroup", "numpy", "library", "pcl"}
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


def _ours(method: str, label: str) -> Peer:
    return Peer(f"{OURS}{method}", f"cgroup {label}", method, "cgroup", largest=1_000_000)


PEERS = {
    peer.name: peer
    for peer in (
        _ours("gc", "GC"),
        Peer("pcl_gc", "PCL GC, threshold 3", "gc", "pcl", threaded=False),
        Peer("pcl_gc10", "PCL GC, threshold 10", "gc", "pcl", threaded=False),
        Peer("np_gc", "NumPy GC, n x n", "gc", "numpy", threaded=False, bytes_per_pair=17),
        Peer("np_gc_rows", "NumPy GC, row by row", "gc", "numpy", threaded=False),
        Peer("kiss", "KISS-Matcher", "gc", "library", "kiss_matcher"),
        _ours("ransac", "RANSAC"),
        Peer("pcl_ransac", "PCL RANSAC", "ransac", "pcl", threaded=False),
        Peer("np_ransac_10k", "NumPy RANSAC", "ransac", "numpy"),
        Peer(
            "o3d_ransac_10k",
            "Open3D RANSAC",
            "ransac",
            "library",
            "open3d",
            largest=5000,
            common_share_only=True,
        ),
        Peer(
            "o3d_ransac_10k_fixed",
            "Open3D RANSAC, confidence 1",
            "ransac",
            "library",
            "open3d",
            largest=5000,
            common_share_only=True,
        ),
        Peer("o3d_ransac_100k_chk", "Open3D RANSAC, checkers", "ransac", "library", "open3d"),
        Peer("o3d_fgr", "Open3D FGR", "ransac", "library", "open3d"),
        Peer("gcransac_uniform", "GC-RANSAC, uniform", "ransac", "library", "pygcransac", threaded=False),
        Peer("gcransac_prosac", "GC-RANSAC, PROSAC", "ransac", "library", "pygcransac", threaded=False),
        _ours("st", "ST"),
        Peer("np_st_ratio_power", "NumPy ST, power steps", "st", "numpy", bytes_per_pair=43),
        Peer("np_st_ratio_eigsh", "SciPy ST, ARPACK", "st", "numpy", bytes_per_pair=43),
        Peer(
            "np_st_ratio_eigh",
            "NumPy ST, LAPACK",
            "st",
            "numpy",
            bytes_per_pair=44,
            largest=5000,
            common_share_only=True,
        ),
        _ours("gtm", "GTM"),
        Peer("np_gtm", "NumPy GTM", "gtm", "numpy", bytes_per_pair=41),
        _ours("si", "SI"),
        Peer("np_si", "NumPy SI", "si", "numpy", threaded=False),
        _ours("cv", "CV"),
        Peer("np_cv", "NumPy CV", "cv", "numpy"),
        _ours("hough3d", "3DHV"),
        Peer("pcl_hough", "PCL Hough", "hough3d", "pcl", threaded=False),
        Peer("np_hough", "NumPy 3DHV", "hough3d", "numpy", threaded=False),
        _ours("nnsr", "NNSR"),
        _ours("ss", "SS"),
    )
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
