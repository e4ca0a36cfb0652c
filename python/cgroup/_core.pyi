from collections.abc import Sequence
from typing import Literal, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from cgroup.types import Fields, FloatArray, IndexArray, RawGrouping, RealArray, RunOptions

_DescriptorArray: TypeAlias = NDArray[np.float32]
_Threshold: TypeAlias = float | Literal["otsu"]

__all__ = [
    "DEBUG_BUILD",
    "Cloud",
    "__version__",
    "cv",
    "drop_isolated",
    "gc",
    "gtm",
    "harris3d",
    "hough3d",
    "iss",
    "lfsh",
    "match_descriptors",
    "mesh_normals",
    "nnsr",
    "normals",
    "ransac",
    "rcs",
    "resolution",
    "rigid_fit",
    "shot",
    "shot_lrf",
    "si",
    "ss",
    "st",
    "toldi_lrf",
]

__version__: str
DEBUG_BUILD: bool

def ss(similarity: RealArray, threshold: _Threshold, otsu: str, bins: int) -> RawGrouping: ...
def nnsr(ratio: RealArray, max_ratio: float) -> RawGrouping: ...
def si(
    fields: Fields,
    run_options: RunOptions,
    *,
    tolerance: float | None,
    neighbors: int,
    min_distance_ratio: float,
    lowe_ratio: float,
    global_rank: str,
    threshold: _Threshold,
    otsu: str,
) -> RawGrouping: ...
def cv(
    fields: Fields,
    run_options: RunOptions,
    *,
    distance_scale: float | None,
    angle_scale: float,
    voters: int,
    exclude_self: bool,
    threshold: _Threshold,
    otsu: str,
) -> RawGrouping: ...
def ransac(
    fields: Fields,
    run_options: RunOptions,
    *,
    tolerance: float | None,
    iterations: int,
    seed: int,
    refine: bool,
    edge_ratio: float | None,
    confidence: float | None,
) -> RawGrouping: ...
def st(
    fields: Fields,
    run_options: RunOptions,
    *,
    min_distance_ratio: float,
    affinity: str,
    diagonal: str,
    conflict: str,
    eigensolver: str,
    recompute: bool,
) -> RawGrouping: ...
def gc(
    fields: Fields,
    run_options: RunOptions,
    *,
    tolerance: float | None,
    variant: str,
    ties: str,
    min_cluster_size: int,
    iterations: int,
    seed: int,
) -> RawGrouping: ...
def hough3d(
    fields: Fields,
    run_options: RunOptions,
    *,
    variant: str,
    bins: int,
    bin_size: float | None,
    neighbors: int,
    interpolation: bool,
    distance_weight: bool,
    vote_threshold: float,
    iterations: int,
    seed: int,
) -> RawGrouping: ...
def gtm(
    fields: Fields,
    run_options: RunOptions,
    *,
    iterations: int,
    threshold: _Threshold,
    otsu: str,
    payoff: str,
    tolerance: float | None,
    one_to_one: bool,
    convergence_tolerance: float | None,
    dynamics: str,
) -> RawGrouping: ...
def rigid_fit(source: RealArray, target: RealArray) -> FloatArray: ...

@final
class Cloud:
    def __new__(cls, points: RealArray, name: str) -> Cloud: ...
    def __len__(self) -> int: ...
    @property
    def diagonal(self) -> float: ...

def resolution(cloud: Cloud, run_options: RunOptions, ignore_zero: bool) -> float: ...
def normals(
    cloud: Cloud,
    run_options: RunOptions,
    neighbors: int,
    radius: float | None,
    viewpoint: Sequence[float],
) -> FloatArray: ...
def mesh_normals(cloud: Cloud, faces: IndexArray) -> FloatArray: ...
def harris3d(
    cloud: Cloud,
    normals: RealArray | None,
    run_options: RunOptions,
    *,
    radius: float,
    response: str,
    threshold: float,
    nms_radius: float,
    break_ties: bool,
    count: int | None,
) -> IndexArray: ...
def iss(
    cloud: Cloud,
    run_options: RunOptions,
    *,
    salient_radius: float,
    nms_radius: float,
    gamma_21: float,
    gamma_32: float,
    min_neighbors: int,
    density_weight: bool,
    covariance: str,
    count: int | None,
) -> IndexArray: ...
def drop_isolated(
    cloud: Cloud, keypoints: IndexArray, run_options: RunOptions, radius: float, min_points: int
) -> IndexArray: ...
def shot_lrf(cloud: Cloud, keypoints: IndexArray, run_options: RunOptions, radius: float) -> FloatArray: ...
def toldi_lrf(cloud: Cloud, keypoints: IndexArray, run_options: RunOptions, radius: float) -> FloatArray: ...
def shot(
    cloud: Cloud,
    normals: RealArray,
    keypoints: IndexArray,
    run_options: RunOptions,
    *,
    radius: float,
    lrf: RealArray | None,
    pcl_compat: bool,
) -> _DescriptorArray: ...
def lfsh(
    cloud: Cloud, normals: RealArray, keypoints: IndexArray, run_options: RunOptions, radius: float
) -> _DescriptorArray: ...
def rcs(cloud: Cloud, keypoints: IndexArray, run_options: RunOptions, radius: float) -> _DescriptorArray: ...
def match_descriptors(
    source: RealArray, target: RealArray, run_options: RunOptions, mutual: bool, max_distance: float | None
) -> tuple[IndexArray, IndexArray, FloatArray, FloatArray, FloatArray, FloatArray]: ...
