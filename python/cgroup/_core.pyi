"""Types of the compiled core."""

from collections.abc import Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cgroup.types import BoolArray, Correspondences, FloatArray, IndexArray, RunOptions

DescriptorArray: TypeAlias = NDArray[np.float32]
RawGrouping: TypeAlias = tuple[BoolArray, FloatArray | None, float | None, FloatArray | None, dict[str, float]]

__version__: str
DEBUG_BUILD: bool

def ss(
    similarity: FloatArray, threshold: float | Literal["otsu"], otsu: str, bins: int
) -> RawGrouping: ...
def nnsr(ratio: FloatArray, max_ratio: float) -> RawGrouping: ...
def si(fields: Correspondences, run_options: RunOptions, **options: Any) -> RawGrouping: ...
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
    points: FloatArray, normals: FloatArray | None, run_options: RunOptions, **options: Any
) -> IndexArray: ...
def iss(points: FloatArray, run_options: RunOptions, **options: Any) -> IndexArray: ...
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
    points: FloatArray, normals: FloatArray, keypoints: IndexArray, run_options: RunOptions, **options: Any
) -> DescriptorArray: ...
def lfsh(
    points: FloatArray, normals: FloatArray, keypoints: IndexArray, run_options: RunOptions, radius: float
) -> DescriptorArray: ...
def rcs(
    points: FloatArray, keypoints: IndexArray, run_options: RunOptions, radius: float
) -> DescriptorArray: ...
def match_descriptors(
    source: FloatArray, target: FloatArray, run_options: RunOptions, mutual: bool, max_distance: float | None
) -> tuple[IndexArray, IndexArray, FloatArray, FloatArray, FloatArray, FloatArray]: ...
