"""The input and the output of a pipeline."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from cgroup.features import Viewpoint
    from cgroup.types import FloatArray


@dataclass(frozen=True, eq=False)
class Clouds:
    """Two clouds to be registered.

    Attributes
    ----------
    source, target : (N,3) and (M,3) array of float64
        Whole clouds, in the same unit.
    source_viewpoint, target_viewpoint : (float, float, float) or None
        Where the scanners stood; None where that isn't known.
    voxel : float
        Edge length of the voxels that clouds are thinned out to.
    threads : int
        Threads to compute on, for pipelines that can be told.
    seed : int
        For pipelines that draw random numbers.

    Examples
    --------
    >>> from cgroup.benchmark.pipelines import Clouds
    >>> from cgroup.datasets import standin_pair
    >>> pair = standin_pair(pixels=60)
    >>> clouds = Clouds(
    ...     pair.source.points, pair.target.points, (0, 0, 0), (0, 0, 0), voxel=4.0
    ... )
    >>> clouds.voxel, clouds.threads, clouds.seed
    (4.0, 1, 0)
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
    """The answer of a pipeline on two clouds.

    Attributes
    ----------
    T_target_source : (4,4) array of float64 or None
        Its pose; None where it finds none.
    ok : bool
        Whether it holds the pose to be right; pipelines without a rule for that always do.
    probability : float
        That the pose is right, NaN where a pipeline doesn't say.
    covariance : (6,6) array of float64 or None
        Of the pose, as `cgroup.registration.Registration.covariance`.

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
