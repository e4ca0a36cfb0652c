"""What goes into a grouping method, what comes out, and the clouds it is about."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from cgroup import _core
from cgroup._arguments import as_faces, as_points
from cgroup._arrays import BoolArray, FloatArray, IndexArray, RealArray
from cgroup._fields import OPTIONAL_FIELDS, check_fields
from cgroup._foreign import cloud_parts
from cgroup.errors import InputError
from cgroup.rigid import apply, check_rigid

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = [
    "OPTIONAL_FIELDS",
    "BoolArray",
    "Correspondences",
    "FloatArray",
    "Grouping",
    "IndexArray",
    "PointCloud",
    "RealArray",
]


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Putative matches between two shapes; row i of every field describes the same match.

    The arrays are read-only copies, which nothing changes later: float32 where they were given so, else
    float64.

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
    candidates : (n,k,3) array_like of float, optional
        Target points that each source point may match, the likeliest first, such as those of its k nearest
        descriptors.

    Raises
    ------
    InputError
        For a wrong shape or type; the message names the field and what to do.
    """

    source: RealArray
    target: RealArray
    similarity: RealArray | None = None
    ratio: RealArray | None = None
    source_lrf: RealArray | None = None
    target_lrf: RealArray | None = None
    resolution: float | None = None
    source_centroid: RealArray | None = None
    candidates: RealArray | None = None

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
        candidates: ArrayLike | None = None,
    ) -> None:
        fields = check_fields(
            source,
            target,
            similarity=similarity,
            ratio=ratio,
            source_lrf=source_lrf,
            target_lrf=target_lrf,
            resolution=resolution,
            source_centroid=source_centroid,
            candidates=candidates,
        )
        for name, value in fields._asdict().items():
            object.__setattr__(self, name, _own(value) if isinstance(value, np.ndarray) else value)

    def __len__(self) -> int:
        return len(self.source)

    def __repr__(self) -> str:
        given = [name for name in OPTIONAL_FIELDS if getattr(self, name) is not None]
        return f"Correspondences(n={len(self)}, fields={['source', 'target', *given]})"


def _own(array: RealArray) -> RealArray:
    copy = array.copy()
    copy.flags.writeable = False
    return copy


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
        The transform behind the selection, for methods that fit one (RANSAC, LC); maps source into target.
    diagnostics : dict of str to float
        Facts about the run: iterations, seed of the cluster, eigenvalue, ...
    alternatives : (k,4,4) array of float64 or None
        Transforms that the correspondences speak for, `model` first, for methods that find several (LC).
    alternative_scores : (k,) array of float64 or None
        The method's score of each, descending.
    ok : bool or None
        Whether the group can be trusted: `false_alarms` below 0.01, for methods that can tell (LC). False
        says that chance could have made such a group, not that the group is wrong.
    false_alarms : float or None
        How many groups as good as this one are to be expected where no correspondence is right; for methods
        that can tell (LC).
    instances : (m,n) array of bool or None
        Groups of different rigid motions, each of which is `ok`, the best first: row 0 is `mask`. None unless
        several were asked for; no row unless the group is `ok`.
    """

    mask: BoolArray
    scores: FloatArray | None
    threshold: float | None
    model: FloatArray | None
    diagnostics: dict[str, float]
    alternatives: FloatArray | None = None
    alternative_scores: FloatArray | None = None
    ok: bool | None = None
    false_alarms: float | None = None
    instances: BoolArray | None = None
    _positions: tuple[RealArray, RealArray] | None = field(default=None, repr=False)

    @property
    def indices(self) -> IndexArray:
        """Rows of the selected correspondences, ascending: (m,) array of int64."""
        return np.flatnonzero(self.mask).astype(np.int64, copy=False)

    @property
    def size(self) -> int:
        """Number of selected correspondences."""
        return int(np.count_nonzero(self.mask))

    @property
    def complete(self) -> bool:
        """Whether the method looked at all that its definition asks for.

        False where a bound on cliques, steps, time or memory cut the search short; the docstring of the
        method says which entry of `diagnostics` tells how far it came.
        """
        return not self.diagnostics.get("truncated", 0.0)

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
        cut = "" if self.complete else ", search cut short"
        return f"Grouping({self.size} of {len(self.mask)} selected{cut})"


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


def find_cloud(name: str, cloud: object) -> PointCloud | None:
    """Return a `PointCloud`, or one made of a cloud of another library; None for arrays.

    Raises
    ------
    InputError
        If its parts aren't points, normals and triangles.
    """
    if isinstance(cloud, PointCloud):
        return cloud
    parts = cloud_parts(name, cloud)
    if parts is None:
        return None
    normals = None if parts.normals is None else as_points(f"{name}.normals", parts.normals)
    faces = None if parts.faces is None else as_faces(f"{name}.faces", parts.faces)
    return PointCloud(as_points(name, parts.points), normals, faces)


def as_cloud(name: str, cloud: PointCloud | ArrayLike) -> PointCloud:
    """Return a `PointCloud` of points in any form.

    Raises
    ------
    InputError
        If they are no points.
    """
    if isinstance(cloud, PointCloud):
        return cloud
    return find_cloud(name, cloud) or PointCloud(as_points(name, cloud))
