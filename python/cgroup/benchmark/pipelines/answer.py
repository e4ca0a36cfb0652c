"""Input and output of pipelines that register two clouds or many scans."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cgroup.features import Viewpoint
from cgroup.types import FloatArray


@dataclass(frozen=True, eq=False)
class Clouds:
    """Two clouds to register.

    Attributes
    ----------
    source, target : (N,3) and (M,3) array of float64
        Whole clouds, in the same unit.
    source_viewpoint, target_viewpoint : (float, float, float) or None
        Positions of the scanners; None where unknown.
    voxel : float
        Edge length of the voxels for downsampling.
    threads, seed : int
        Number of threads, and key of random numbers.
    """

    source: FloatArray
    target: FloatArray
    source_viewpoint: Viewpoint | None
    target_viewpoint: Viewpoint | None
    voxel: float
    threads: int = 1
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer of a pipeline.

    Attributes
    ----------
    T_target_source : (4,4) array of float64 or None
        The pose; None without one.
    ok : bool
        Whether the pipeline accepts the pose; true for pipelines without such a rule.
    probability : float
        Probability that the pose is correct, NaN where not estimated.
    covariance : (6,6) array of float64 or None
        Of the pose, as `cgroup.registration.Registration.covariance`.
    decoy : float
        Probability of the best pose of the mirrored source, NaN where not searched for.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.benchmark.pipelines import Answer
    >>> def stays(clouds, clock):  # named "module:stays" in a configuration
    ...     clock.start("pose")
    ...     return Answer(np.eye(4), ok=False)
    >>> Answer(np.eye(4), ok=True).probability
    nan
    """

    T_target_source: FloatArray | None
    ok: bool
    probability: float = np.nan
    covariance: FloatArray | None = None
    decoy: float = np.nan


@dataclass(frozen=True, eq=False)
class Scans:
    """Scans to register.

    Attributes
    ----------
    points : sequence of (n,3) array of float64
        Points of each scan in its own frame, all in one unit.
    voxel, threads, seed : float, int, int
        As for `Clouds`.
    """

    points: Sequence[FloatArray]
    voxel: float
    threads: int = 1
    seed: int = 0


@dataclass(frozen=True, eq=False)
class SceneAnswer:
    """The answer of a solver.

    Attributes
    ----------
    poses : (N,4,4) array of float64
        Poses of the scans in the frames of their components.
    components : list of list of int
        Rows of connected scans.
    tried : int
        Pairs of scans that were registered.
    """

    poses: FloatArray
    components: list[list[int]]
    tried: int
