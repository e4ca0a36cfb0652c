from collections.abc import Sequence
from typing import TypeAlias, TypedDict, final

import numpy as np
from numpy.typing import NDArray

from cgroup._checks.arrays import BoolArray, FloatArray, IndexArray, RealArray
from cgroup._checks.values import RunOptions
from cgroup.types.fields import Fields

_DescriptorArray: TypeAlias = NDArray[np.float32]

class _Grouping(TypedDict):  # fields of cgroup.types.Grouping
    mask: BoolArray
    scores: FloatArray | None
    threshold: float | None
    model: FloatArray | None
    diagnostics: dict[str, float]
    alternatives: FloatArray | None
    alternative_scores: FloatArray | None
    ok: bool | None
    false_alarms: float | None
    noise: float | None
    instances: BoolArray | None

class _Rule(TypedDict):  # of cgroup.types.Rule
    kind: str
    bound: float | None
    accepts_equality: bool
    decided_by: IndexArray | None
    conflicts: IndexArray | None
    votes: FloatArray | None

class _Agreement(TypedDict):  # of cgroup.types.Agreement
    bound: float
    is_ratio: bool
    accepts_equality: bool
    least_sum: float | None
    least_each: float | None
    scale: float

_Option: TypeAlias = tuple[str, bool, bool | float | str | None, tuple[bool | float | str, ...], str]
_Description: TypeAlias = tuple[list[str], list[str], dict[str, _Option]]  # fields, optional fields, options

_CloudContent: TypeAlias = tuple[
    FloatArray, FloatArray | None, IndexArray | None, NDArray[np.uint8] | None, FloatArray | None
]  # points, normals, faces, colors, viewpoint

_Resistance: TypeAlias = tuple[FloatArray, FloatArray | None]  # information, open_motion
_Overlap: TypeAlias = tuple[float, float, _Resistance]  # fitness, inlier_rmse
_Verified: TypeAlias = tuple[
    FloatArray, FloatArray, IndexArray, float, _Overlap
]  # poses, scores, evidence, margin, overlap of the best

_Alignment: TypeAlias = tuple[
    FloatArray, FloatArray, FloatArray, int, _Resistance
]  # pose, residuals, deviations, number of samples

_Graph: TypeAlias = tuple[
    RealArray, IndexArray, RealArray, RealArray, RealArray
]  # poses, edges, measurements, information, probability

__all__ = [
    "DEBUG_BUILD",
    "DIFFERENT_POSES",
    "Cloud",
    "FineSurface",
    "Surface",
    "__version__",
    "align",
    "best_placements",
    "choose_voxel",
    "describe_methods",
    "drop_isolated",
    "fpfh",
    "group",
    "harris3d",
    "iss",
    "lfsh",
    "match_descriptors",
    "mesh_normals",
    "nearest",
    "nearest_rows",
    "normals",
    "optimize_poses",
    "parse_cloud",
    "parse_table",
    "places",
    "plane_distances",
    "pose_covariances",
    "rcs",
    "resolution",
    "rigid_fit",
    "score_poses",
    "shot",
    "shot_lrf",
    "squared_errors",
    "toldi_lrf",
    "verify",
    "voxel_downsample",
    "within",
]

__version__: str
DEBUG_BUILD: bool
DIFFERENT_POSES: tuple[float, float]

def group(
    method: str, fields: Fields, run_options: RunOptions, options: dict[str, object]
) -> tuple[_Grouping, _Rule, _Agreement | None]: ...
def describe_methods() -> list[tuple[str, _Description]]: ...
def rigid_fit(source: RealArray, target: RealArray) -> FloatArray: ...

@final
class Cloud:
    def __new__(cls, points: RealArray, name: str) -> Cloud: ...
    def __len__(self) -> int: ...
    def own_axes(self) -> FloatArray: ...
    @property
    def diagonal(self) -> float: ...

def parse_cloud(content: bytes, suffix: str, run_options: RunOptions) -> _CloudContent: ...
def parse_table(content: bytes, run_options: RunOptions) -> FloatArray: ...
def resolution(cloud: Cloud, run_options: RunOptions, ignore_zero: bool) -> float: ...
def voxel_downsample(
    cloud: Cloud, normals: RealArray | None, run_options: RunOptions, voxel: float, own_axes: bool
) -> tuple[FloatArray, FloatArray | None, IndexArray]: ...
def choose_voxel(clouds: Sequence[Cloud], run_options: RunOptions, most: int, own_axes: bool) -> float: ...
def normals(
    cloud: Cloud,
    run_options: RunOptions,
    neighbors: int | None,
    radius: float | None,
    viewpoint: Sequence[float],
) -> FloatArray: ...
def mesh_normals(cloud: Cloud, faces: IndexArray, run_options: RunOptions) -> FloatArray: ...
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
def fpfh(
    cloud: Cloud,
    normals: RealArray,
    keypoints: IndexArray | None,
    run_options: RunOptions,
    *,
    radius: float,
    max_neighbors: int | None,
    convention: str,
) -> _DescriptorArray: ...
def match_descriptors(
    source: RealArray,
    target: RealArray,
    run_options: RunOptions,
    k: int,
    mutual: bool,
    max_distance: float | None,
) -> tuple[IndexArray, IndexArray, IndexArray, FloatArray, FloatArray, FloatArray, FloatArray, BoolArray]: ...

@final
class Surface:
    def __new__(
        cls,
        points: RealArray,
        normals: RealArray,
        run_options: RunOptions,
        unit: float,
        viewpoint: Sequence[float] | None,
        oriented: bool,
    ) -> Surface: ...
    def __len__(self) -> int: ...

def score_poses(
    source: Surface, target: Surface, poses: FloatArray, run_options: RunOptions
) -> FloatArray: ...
def places(
    source: Surface, target: Surface, pose: FloatArray, run_options: RunOptions
) -> NDArray[np.uint8]: ...
def verify(
    source: Surface,
    target: Surface,
    poses: FloatArray,
    matches: tuple[RealArray, RealArray, float] | None,
    run_options: RunOptions,
) -> _Verified: ...

@final
class FineSurface:
    def __new__(cls, cloud: Cloud, run_options: RunOptions, spacing: float) -> FineSurface: ...
    def __len__(self) -> int: ...
    def sample_points(self) -> FloatArray: ...

def align(
    source: FineSurface, target: FineSurface, poses: FloatArray, run_options: RunOptions, samples: int
) -> list[_Alignment]: ...
def plane_distances(
    source: FineSurface, target: FineSurface, pose: FloatArray, run_options: RunOptions
) -> FloatArray: ...
def best_placements(
    grid: NDArray[np.uint8],
    walls: FloatArray,
    floor: FloatArray,
    turns: FloatArray,
    windows: IndexArray,
    run_options: RunOptions,
    floor_weight: float,
    most: int,
) -> IndexArray: ...
def nearest(points: RealArray, others: RealArray, run_options: RunOptions, radius: float) -> FloatArray: ...
def nearest_rows(points: RealArray, rows: IndexArray, run_options: RunOptions, count: int) -> IndexArray: ...
def within(points: RealArray, others: RealArray, run_options: RunOptions, radius: float) -> BoolArray: ...
def optimize_poses(
    graph: _Graph, run_options: RunOptions, chordal: bool, robust: bool
) -> tuple[FloatArray, BoolArray]: ...
def squared_errors(graph: _Graph, run_options: RunOptions) -> FloatArray: ...
def pose_covariances(graph: _Graph, nodes: IndexArray, run_options: RunOptions) -> FloatArray: ...
