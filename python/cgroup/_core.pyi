from collections.abc import Sequence
from typing import Any, TypeAlias, TypedDict, final

import numpy as np
from numpy.typing import NDArray

from cgroup._checks.arrays import BoolArray, FloatArray, IndexArray, RealArray
from cgroup._checks.values import RunOptions
from cgroup.types.fields import Fields
from cgroup.types.grouping import Grouping

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
    FloatArray,
    FloatArray | None,
    IndexArray | None,
    NDArray[np.uint8] | None,
    FloatArray | None,
    NDArray[np.float32] | None,
]  # points, normals, faces, colors, viewpoint, intensities

_E57Field: TypeAlias = tuple[
    str, int, int, int, float, float, tuple[float, float] | None
]  # name, bytes of a float or 0, least, most, scale, offset, limits of a color

_Resistance: TypeAlias = tuple[FloatArray, FloatArray | None]  # information, open_motion
_Overlap: TypeAlias = tuple[float, float, _Resistance]  # fitness, inlier_rmse
_Verified: TypeAlias = tuple[
    FloatArray, FloatArray, IndexArray, float, _Overlap
]  # poses, scores, evidence, margin, overlap of the best

_Alignment: TypeAlias = tuple[
    FloatArray, FloatArray, FloatArray, int, _Resistance
]  # pose, residuals, deviations, number of samples

_Refusal: TypeAlias = tuple[str, int, int]  # kind, and two numbers of voxels
_Case: TypeAlias = tuple[
    float, int, float, float, int, float, float
]  # score, support, misfit, cells, planes, crossed, chance

_TargetFit: TypeAlias = tuple[
    FloatArray, FloatArray, FloatArray, FloatArray, BoolArray, BoolArray, float, int
]  # the first fields of cgroup.targets.TargetFit

_Graph: TypeAlias = tuple[
    RealArray, IndexArray, RealArray, RealArray, RealArray
]  # poses, edges, measurements, information, probability

__all__ = [
    "DEBUG_BUILD",
    "DIFFERENT_POSES",
    "MOST_LOST",
    "Cloud",
    "ColmapFile",
    "E57Writer",
    "FineSurface",
    "Level",
    "Prepared",
    "Registered",
    "Scaled",
    "Scan",
    "Surface",
    "TextRows",
    "__version__",
    "align",
    "best_placements",
    "bound_rivals",
    "choose_apart",
    "choose_voxel",
    "columns_of",
    "covariance",
    "decompress_lzf",
    "describe_methods",
    "distinct_points",
    "drop_isolated",
    "encode_cloud",
    "fill_between_rings",
    "find_outliers",
    "find_scale",
    "fit_targets",
    "fpfh",
    "gltf_files",
    "group",
    "group_motions",
    "harris3d",
    "iss",
    "lfsh",
    "match_descriptors",
    "match_probabilities",
    "mesh_normals",
    "nearest",
    "nearest_rows",
    "normals",
    "optimize_poses",
    "parse_cloud",
    "parse_gltf",
    "parse_table",
    "places",
    "plane_distances",
    "pose_covariances",
    "rcs",
    "register",
    "resolution",
    "rigid_fit",
    "score_poses",
    "seal_pages",
    "share_probability",
    "shot",
    "shot_lrf",
    "shows_layers",
    "squared_errors",
    "suit_voxel",
    "toldi_lrf",
    "unpack_e57",
    "verify",
    "voxel_downsample",
    "weigh",
    "within",
    "wrong_page",
]

__version__: str
DEBUG_BUILD: bool
DIFFERENT_POSES: tuple[float, float]
MOST_LOST: float

def group(
    method: str, fields: Fields, run_options: RunOptions, options: dict[str, object]
) -> tuple[_Grouping, _Rule, _Agreement | None]: ...
def describe_methods() -> list[tuple[str, _Description]]: ...
def rigid_fit(source: RealArray, target: RealArray) -> FloatArray: ...
def match_probabilities(fields: Fields, grouping: Grouping, run_options: RunOptions) -> FloatArray: ...
def group_motions(
    fields: Fields, tolerance: float | None, most: int, run_options: RunOptions
) -> list[tuple[_Grouping, _Rule, _Agreement | None]]: ...
def bound_rivals(
    fields: Fields, model: FloatArray, tolerance: float, run_options: RunOptions
) -> tuple[int, int]: ...

@final
class Scan:
    def __new__(cls, cloud: Cloud, normals: RealArray | None) -> Scan: ...
    def __len__(self) -> int: ...

@final
class Prepared:
    def __new__(
        cls,
        scan: Scan,
        voxel: float,
        radii: tuple[float, float, float],
        viewpoint: Sequence[float] | None,
        by_frames: bool,
        most: int,
    ) -> Prepared: ...
    @staticmethod
    def of_parts(
        scan: Scan,
        voxel: float,
        voxels: tuple[FloatArray, FloatArray],
        described: tuple[Sequence[int], FloatArray, _DescriptorArray],
        run_options: RunOptions,
    ) -> Prepared: ...
    def level(self, row: int, run_options: RunOptions) -> tuple[Level | None, _Refusal | None]: ...
    def begin(self, run_options: RunOptions) -> _Refusal | None: ...

@final
class Level:
    def __len__(self) -> int: ...
    @property
    def voxel(self) -> float: ...
    @property
    def points(self) -> FloatArray: ...
    @property
    def normals(self) -> FloatArray: ...
    @property
    def surface(self) -> Surface: ...
    def described(self, run_options: RunOptions) -> tuple[IndexArray, FloatArray, _DescriptorArray]: ...
    def fit_similarity(
        self, target: Level, pose: FloatArray, run_options: RunOptions
    ) -> tuple[float, FloatArray, float, float] | None: ...
    def overlap(
        self, target: Level, poses: FloatArray, run_options: RunOptions
    ) -> list[tuple[float, float, float]]: ...
    def confirm(self, target: Level, pose: FloatArray, run_options: RunOptions) -> Registered | None: ...

@final
class Registered:
    pose: FloatArray
    probability: float
    fitness: tuple[float, float]
    rmse: float
    open_motion: FloatArray | None
    motions: int
    better_scale: float
    scale_factor: float
    decoy: float | None
    cases: list[_Case]
    shares: FloatArray
    places: FloatArray
    alternatives: FloatArray
    levels: tuple[Level, Level]
    seconds: list[tuple[str, float]]
    matches: tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]

def register(
    source: Prepared, target: Prepared, options: tuple[object, ...], run_options: RunOptions
) -> tuple[Registered | None, tuple[int, _Refusal] | None]: ...

@final
class Scaled:
    scale: float
    deviation: float
    is_open: bool
    scans: tuple[Prepared, Prepared, float]
    pose: FloatArray | None
    def weigh(self, cases: Sequence[_Case], motions: int) -> tuple[float, list[tuple[float, FloatArray]]]: ...

def find_scale(
    source: Prepared,
    target: Prepared,
    bounds: tuple[float, float],
    voxel: float | None,
    axis: Sequence[float] | None,
    run_options: RunOptions,
) -> tuple[Scaled | None, tuple[int, float, _Refusal] | None, tuple[float, float] | None]: ...
def covariance(found: Registered, run_options: RunOptions) -> FloatArray: ...
def weigh(evidence: _Case) -> float: ...
def share_probability(cases: Sequence[_Case], scales: int) -> tuple[float, list[float]]: ...
def choose_apart(poses: FloatArray, center: Sequence[float], voxel: float) -> list[int]: ...

@final
class Cloud:
    def __new__(cls, points: RealArray, name: str) -> Cloud: ...
    def __len__(self) -> int: ...
    def own_axes(self) -> FloatArray: ...
    def own_diagonal(self) -> float: ...
    def center(self) -> FloatArray: ...
    @property
    def diagonal(self) -> float: ...

def parse_cloud(content: bytes, suffix: str, run_options: RunOptions) -> _CloudContent: ...
def gltf_files(content: bytes, run_options: RunOptions) -> list[str]: ...

@final
class TextRows:
    def __new__(
        cls, text: bytes, layouts: Sequence[tuple[str, Sequence[int]]], separator: str
    ) -> TextRows: ...
    def numbers(self) -> list[FloatArray]: ...
    def replaced(self, numbers: Sequence[FloatArray]) -> bytes: ...

@final
class ColmapFile:
    def __new__(cls, name: str, content: bytes) -> ColmapFile: ...
    def __getnewargs__(self) -> tuple[str, bytes]: ...
    def content(self) -> bytes: ...
    def numbers(self) -> FloatArray: ...
    def image_names(self) -> list[str]: ...
    def replaced(self, numbers: FloatArray) -> ColmapFile: ...

def columns_of(line: bytes) -> tuple[str, list[str], bool]: ...

@final
class E57Writer:
    def __new__(cls) -> E57Writer: ...
    def begin(self, name: str, pose: tuple[list[float], list[float]], count: int) -> None: ...
    def add(
        self,
        points: FloatArray,
        normals: FloatArray | None,
        colors: NDArray[np.uint8] | None,
        intensities: NDArray[np.float32] | None,
    ) -> bytes: ...
    def finish(self) -> tuple[bytes, bytes]: ...

def encode_cloud(
    suffix: str,
    points: FloatArray,
    normals: FloatArray | None,
    faces: NDArray[np.int64] | None,
    colors: NDArray[np.uint8] | None,
    intensities: NDArray[np.float32] | None,
    viewpoint: list[float] | None,
    is_single: bool,
    run_options: RunOptions,
) -> bytes: ...
def parse_gltf(content: bytes, files: dict[str, bytes], run_options: RunOptions) -> _CloudContent: ...
def decompress_lzf(content: bytes, size: int, run_options: RunOptions) -> bytes: ...
def wrong_page(pages: NDArray[np.uint8]) -> int | None: ...
def seal_pages(content: bytes) -> bytes: ...
def unpack_e57(
    content: bytes,
    section: tuple[int, int],
    fields: Sequence[_E57Field | None],
    count: int,
    run_options: RunOptions,
) -> list[NDArray[Any]]: ...
def parse_table(content: bytes, run_options: RunOptions) -> FloatArray: ...
def resolution(cloud: Cloud, run_options: RunOptions, ignore_zero: bool) -> float: ...
def voxel_downsample(
    cloud: Cloud, normals: RealArray | None, run_options: RunOptions, voxel: float, own_axes: bool
) -> tuple[FloatArray, FloatArray | None, IndexArray]: ...
def choose_voxel(clouds: Sequence[Cloud], run_options: RunOptions, most: int, own_axes: bool) -> float: ...
def distinct_points(points: RealArray) -> tuple[IndexArray, IndexArray] | None: ...
def find_outliers(cloud: Cloud, run_options: RunOptions) -> IndexArray: ...
def fill_between_rings(
    cloud: Cloud, points: RealArray, run_options: RunOptions
) -> tuple[FloatArray, list[float]] | None: ...
def shows_layers(
    cloud: Cloud, run_options: RunOptions, viewpoint: tuple[float, float, float], voxel: float
) -> bool: ...
def fit_targets(
    source: RealArray, target: RealArray, sigma: float | None, run_options: RunOptions
) -> tuple[_TargetFit, BoolArray, float, list[str]]: ...  # suspects, ratio of units, doubts
def suit_voxel(
    clouds: Sequence[Cloud], run_options: RunOptions
) -> tuple[float | None, tuple[int, int] | None]: ...
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
