"""What goes into a grouping method, and what comes out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from cgroup import _core
from cgroup._arguments import as_number, as_reals, real_frames, real_points, real_vector
from cgroup._arrays import BoolArray, FloatArray, IndexArray, RealArray
from cgroup.errors import InputError
from cgroup.rigid import apply, check_rigid

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

__all__ = [
    "OPTIONAL_FIELDS",
    "BoolArray",
    "Correspondences",
    "DescribedCloud",
    "Fields",
    "FloatArray",
    "Grouping",
    "IndexArray",
    "PointCloud",
    "RawGrouping",
    "RealArray",
    "RunOptions",
    "checked_fields",
]

RawGrouping: TypeAlias = tuple[
    BoolArray, FloatArray | None, float | None, FloatArray | None, dict[str, float]
]
"""Mask, scores, threshold, model and diagnostics, as the compiled core returns them."""


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Putative matches between two shapes; row i of every field describes the same match.

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points in the data's unit; the transform sought maps `source` into `target`.
    similarity : (n,) array_like of float, optional
        Descriptor similarity ``1 - |f_norm - f'_norm|``, higher is better; -inf for no descriptor.
    ratio : (n,) array_like of float, optional
        Nearest / second-nearest descriptor distance, in [0,1], lower is better.
    source_lrf, target_lrf : (n,3,3) array_like of float, optional
        Local reference frames; rows are the x, y and z axes; a block with NaN means no frame.
    resolution : float, optional
        Mean nearest-neighbour distance of the clouds (the unit *pr*), in the data's unit.
    source_centroid : (3,) array_like of float, optional
        Centroid of the whole source cloud; `hough3d` uses the mean of `source` without it.

    Raises
    ------
    InputError
        For a wrong shape or type; the message names the field and what to do.
    """

    source: FloatArray
    target: FloatArray
    similarity: FloatArray | None = None
    ratio: FloatArray | None = None
    source_lrf: FloatArray | None = None
    target_lrf: FloatArray | None = None
    resolution: float | None = None
    source_centroid: FloatArray | None = None

    def __init__(
        self,
        source: ArrayLike,
        target: ArrayLike,
        *,
        similarity: ArrayLike | None = None,
        ratio: ArrayLike | None = None,
        source_lrf: ArrayLike | None = None,
        target_lrf: ArrayLike | None = None,
        resolution: float | None = None,
        source_centroid: ArrayLike | None = None,
    ) -> None:
        fields = checked_fields(
            source,
            target,
            similarity=similarity,
            ratio=ratio,
            source_lrf=source_lrf,
            target_lrf=target_lrf,
            resolution=resolution,
            source_centroid=source_centroid,
        )
        for name, value in fields._asdict().items():
            object.__setattr__(self, name, _own(value) if isinstance(value, np.ndarray) else value)

    def __len__(self) -> int:
        return len(self.source)

    def __repr__(self) -> str:
        given = [name for name in OPTIONAL_FIELDS if getattr(self, name) is not None]
        return f"Correspondences(n={len(self)}, fields={['source', 'target', *given]})"


def _own(array: RealArray) -> FloatArray:
    copy: FloatArray = array.astype(np.float64)
    copy.flags.writeable = False
    return copy


class Fields(NamedTuple):
    """What a method gets of `Correspondences`: of the right shapes, in the precision that the caller has."""

    source: RealArray
    target: RealArray
    similarity: RealArray | None
    ratio: RealArray | None
    source_lrf: RealArray | None
    target_lrf: RealArray | None
    resolution: float | None
    source_centroid: RealArray | None


def checked_fields(
    source: ArrayLike,
    target: ArrayLike,
    *,
    similarity: ArrayLike | None = None,
    ratio: ArrayLike | None = None,
    source_lrf: ArrayLike | None = None,
    target_lrf: ArrayLike | None = None,
    resolution: float | None = None,
    source_centroid: ArrayLike | None = None,
) -> Fields:
    """Check the fields of `Correspondences` for their shapes and types; nothing is copied without need."""
    points = real_points("source", source)
    n = len(points)
    if (source_lrf is None) != (target_lrf is None):
        missing = "source_lrf" if source_lrf is None else "target_lrf"
        message = f"{missing}: missing; frames are needed on both sides or on neither"
        raise InputError(message)
    partners = real_points("target", target)
    if len(partners) != n:
        message = (
            f"target: got {len(partners)} rows, but source has {n}; row i of one matches row i of the other"
        )
        raise InputError(message)
    return Fields(
        points,
        partners,
        None if similarity is None else real_vector("similarity", similarity, n),
        None if ratio is None else real_vector("ratio", ratio, n),
        None if source_lrf is None else real_frames("source_lrf", source_lrf, n),
        None if target_lrf is None else real_frames("target_lrf", target_lrf, n),
        None if resolution is None else as_number("resolution", resolution),
        None if source_centroid is None else _centroid(source_centroid),
    )


def _centroid(value: ArrayLike) -> RealArray:
    array = as_reals("source_centroid", value)
    if array.shape != (3,):
        message = f"source_centroid: got shape {array.shape}; give the three coordinates of one point"
        raise InputError(message)
    return array


OPTIONAL_FIELDS = ("similarity", "ratio", "source_lrf", "target_lrf", "resolution", "source_centroid")


@dataclass(frozen=True, eq=False)
class Grouping:
    """The correspondences that a method holds to be right.

    Attributes
    ----------
    mask : (n,) array of bool
        True where a correspondence is selected; aligned with the input.
    scores : (n,) array of float64 or None
        The method's score of each correspondence, higher is better.
    threshold : float or None
        The cut on the scores that was really used.
    model : (4,4) array of float64 or None
        The transform behind the selection, for methods that fit one (RANSAC); maps source into target.
    diagnostics : dict of str to float
        Facts about the run: iterations, seed of the cluster, eigenvalue, ...
    """

    mask: BoolArray
    scores: FloatArray | None
    threshold: float | None
    model: FloatArray | None
    diagnostics: dict[str, float]
    _positions: tuple[RealArray, RealArray] | None = field(default=None, repr=False)

    @property
    def indices(self) -> IndexArray:
        """Rows of the selected correspondences, ascending: (m,) array of int64."""
        return np.flatnonzero(self.mask).astype(np.int64, copy=False)

    @property
    def size(self) -> int:
        """Number of selected correspondences."""
        return int(np.count_nonzero(self.mask))

    def transform(self) -> FloatArray:
        """Least-squares rigid transform of the group.

        Returns
        -------
        (4,4) array of float64
            ``T_target_source``, column vectors: p' = R p + t (Kabsch).

        Raises
        ------
        NoConsensusError
            For fewer than three selected correspondences, or a group on one line.
        InputError
            Where the method was given no points (`ss`, `nnsr`): use `cgroup.group`.
        """
        if self._positions is None:
            message = (
                "transform: this group was made without points; "
                'group correspondences that have them: cgroup.group(correspondences, "ss")'
            )
            raise InputError(message)
        source, target = self._positions
        return _core.rigid_fit(source[self.mask], target[self.mask])

    def __repr__(self) -> str:
        return f"Grouping({self.size} of {len(self.mask)} selected)"


@dataclass(frozen=True, eq=False)
class PointCloud:
    """A scan or a model, as read from a file.

    Attributes
    ----------
    points : (N,3) array of float64
        Coordinates in the file's unit, all finite.
    normals : (N,3) array of float64, optional
        Normals as stored in the file.
    faces : (M,3) array of int, optional
        Triangles as rows of `points`.
    colors : (N,3) array of uint8, optional
        Red, green, blue.
    dropped : int
        Points of the file that were left out because a coordinate was NaN or infinite.
    """

    points: FloatArray
    normals: FloatArray | None = None
    faces: IndexArray | None = None
    colors: NDArray[np.uint8] | None = None
    dropped: int = 0

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.points)

    def transformed(self, transform: ArrayLike) -> PointCloud:
        """Move the cloud by a rigid transform.

        Parameters
        ----------
        transform : (4,4) array_like of float
            Applied to column vectors: p' = R p + t.

        Returns
        -------
        PointCloud
            Moved points and turned normals; faces and colours as they were.
        """
        matrix = check_rigid(transform)
        normals = None if self.normals is None else self.normals @ matrix[:3, :3].T
        return PointCloud(apply(matrix, self.points), normals, self.faces, self.colors, self.dropped)


@dataclass(frozen=True, eq=False)
class DescribedCloud:
    """Keypoints of a cloud, ready to be matched with those of another; row i of each array is one keypoint.

    Attributes
    ----------
    indices : (m,) array of int64
        Rows of the cloud, ascending.
    points : (m,3) array of float64
        Positions.
    lrf : (m,3,3) array of float64
        SHOT's local reference frames, rows are the axes; NaN where there is none.
    descriptors : (m,d) array of float32
        All finite, none zero.
    resolution : float
        The unit pr that the radii were multiples of.
    centroid : (3,) array of float64
        Of the whole cloud.
    """

    indices: IndexArray
    points: FloatArray
    lrf: FloatArray
    descriptors: NDArray[np.float32]
    resolution: float
    centroid: FloatArray

    def __len__(self) -> int:
        return len(self.indices)

    def __repr__(self) -> str:
        return f"DescribedCloud(m={len(self)}, dimensions={self.descriptors.shape[1]})"


@dataclass(frozen=True)
class RunOptions:
    """How a computation runs: threads, memory for pairwise matrices in bytes, progress callback."""

    threads: int | None
    max_memory: int
    progress: Callable[[float], Any] | None
