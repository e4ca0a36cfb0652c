"""Results of registering many scans: a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cgroup.types import AnyCloud, FloatArray


@dataclass(frozen=True, eq=False)
class Edge:
    """A pose between two scans of a scene.

    Attributes
    ----------
    source, target : int
        Rows of the scans.
    T_target_source : (4,4) array of float64
        Maps source points into the target's frame.
    probability : float
        That it is right, as the two scans alone tell.
    covariance : (6,6) array of float64
        Of (rotation vector, translation) in the target's frame, as for `Registration.covariance`.
    fitness, target_fitness : float
        Shares of either surface that lies on the other.
    kept : bool
        Whether the scene holds it to be right.
    residual : float
        How far it is from the poses of the scene, in standard deviations: the square root of ``e^T C^-1 e``;
        NaN between two components.
    reason : str
        Why it was dropped; "" where it is kept.
    """

    source: int
    target: int
    T_target_source: FloatArray
    probability: float
    covariance: FloatArray
    fitness: float
    target_fitness: float
    kept: bool
    residual: float
    reason: str


@dataclass(frozen=True, eq=False)
class Scene:
    """Poses of many scans.

    Attributes
    ----------
    poses : (N,4,4) array of float64
        Maps points of each scan into the frame of its component, that of the component's first scan.
    components : list of list of int
        Rows of the scans that hang together, the largest first; a scan that belongs to none is alone. Scans
        that were left out are in none.
    edges : list of Edge
        Every pair whose pose was accepted, or brought back by the others.
    probability : (N,) array of float64
        That each scan is placed right; 1 for the first of each component, NaN for scans that were left out.
    covariance : (N,6,6) array of float64
        Of each pose, of (rotation vector, translation) in the frame of its component.
    names : list of str
        What each scan is called.
    scans : tuple
        The clouds, paths or prepared scans that were given.
    voxel : float
        Edge length of the voxels, in the unit of the points.
    tried : int
        Pairs that were registered.
    notes : tuple of str
        What a user should know: sentences.
    seconds : dict of str to float
        Wall time of each stage, in order.
    """

    poses: FloatArray
    components: list[list[int]]
    edges: list[Edge]
    probability: FloatArray
    covariance: FloatArray
    names: list[str]
    scans: tuple[AnyCloud, ...]
    voxel: float
    tried: int
    notes: tuple[str, ...]
    seconds: dict[str, float]
