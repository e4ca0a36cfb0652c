from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cgroup._arrays import BoolArray, FloatArray, IndexArray, RealArray
from cgroup._fields import Fields
from cgroup._options import RunOptions

_DescriptorArray: TypeAlias = NDArray[np.float32]
_Grouping: TypeAlias = tuple[
    BoolArray, FloatArray | None, float | None, FloatArray | None, dict[str, float]
]  # mask, scores, threshold, model, diagnostics

__all__ = [
    "DEBUG_BUILD",
    "__version__",
    "drop_isolated",
    "group",
    "harris3d",
    "iss",
    "lfsh",
    "match_descriptors",
    "mesh_normals",
    "normals",
    "rcs",
    "resolution",
    "rigid_fit",
    "shot",
    "shot_lrf",
    "toldi_lrf",
]

__version__: str
DEBUG_BUILD: bool

def group(method: str, fields: Fields, run_options: RunOptions, options: dict[str, object]) -> _Grouping: ...
def rigid_fit(source: RealArray, target: RealArray) -> FloatArray: ...
def resolution(points: FloatArray, run_options: RunOptions, ignore_zero: bool) -> float: ...
def normals(
    points: FloatArray,
    run_options: RunOptions,
    neighbors: int,
    radius: float | None,
    viewpoint: Sequence[float],
) -> FloatArray: ...
def mesh_normals(points: FloatArray, faces: IndexArray) -> FloatArray: ...
def harris3d(
    points: FloatArray,
    normals: FloatArray | None,
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
    points: FloatArray,
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
    points: FloatArray, keypoints: IndexArray, run_options: RunOptions, radius: float, min_points: int
) -> IndexArray: ...
def shot_lrf(
    points: FloatArray, keypoints: IndexArray, run_options: RunOptions, radius: float
) -> FloatArray: ...
def toldi_lrf(
    points: FloatArray, keypoints: IndexArray, run_options: RunOptions, radius: float
) -> FloatArray: ...
def shot(
    points: FloatArray,
    normals: FloatArray,
    keypoints: IndexArray,
    run_options: RunOptions,
    *,
    radius: float,
    lrf: FloatArray | None,
    pcl_compat: bool,
) -> _DescriptorArray: ...
def lfsh(
    points: FloatArray, normals: FloatArray, keypoints: IndexArray, run_options: RunOptions, radius: float
) -> _DescriptorArray: ...
def rcs(
    points: FloatArray, keypoints: IndexArray, run_options: RunOptions, radius: float
) -> _DescriptorArray: ...
def match_descriptors(
    source: FloatArray, target: FloatArray, run_options: RunOptions, mutual: bool, max_distance: float | None
) -> tuple[IndexArray, IndexArray, FloatArray, FloatArray, FloatArray, FloatArray]: ...
