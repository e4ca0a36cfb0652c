"""Two clouds in, a pose that their surfaces confirm out."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from cgroup._checks.run_options import as_threads
from cgroup._checks.values import as_choice, refusal
from cgroup._runtime.progress import StageClock, as_stage_function
from cgroup.errors import NoConsensusError
from cgroup.features import ORIGIN
from cgroup.group import check_method, group
from cgroup.registration.correspond import PaperFront, correspond
from cgroup.registration.matching import without_frames
from cgroup.registration.pair import prepare_pair
from cgroup.registration.poses import as_axis, group_poses
from cgroup.registration.prepared import DenseFront
from cgroup.registration.report import explain_failure, registration_of
from cgroup.registration.search import EFFORTS, Search
from cgroup.types import PointCloud

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from cgroup.features import Cloud, Viewpoint
    from cgroup.registration.prepared import PreparedScan
    from cgroup.registration.result import Registration
    from cgroup.registration.scan import Scan
    from cgroup.registration.search import Effort, Found
    from cgroup.types import FloatArray

FRONTS = ("dense", "paper")


def register(
    source: PreparedScan | PointCloud | Cloud | ArrayLike,
    target: PreparedScan | PointCloud | Cloud | ArrayLike,
    *,
    voxel: float | None = None,
    source_viewpoint: Viewpoint | None = None,
    target_viewpoint: Viewpoint | None = None,
    axis: ArrayLike | None = None,
    effort: Effort = "normal",
    front: Literal["dense", "paper"] | DenseFront | PaperFront = "dense",
    method: str | None = None,
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
    **options: Any,  # noqa: ANN401 - those of the method
) -> Registration:
    """Place a source cloud on a target cloud, or say that no pose can be trusted.

    Both clouds are thinned to voxels, and matched by FPFH. Groups of matches propose poses; these are
    verified on the two surfaces (`cgroup.verification`), the best is refined, and judged.

    Parameters
    ----------
    source, target : PreparedScan, PointCloud, Cloud or (N,3) array_like of float
        Whole clouds, in the same unit; scale is not estimated. To register one cloud with many, `prepare` it
        once.
    voxel : float, optional
        Edge length of the voxels, in the unit of the points: the one length that all others are multiples
        of. By default the smallest 2^(k/4) that leaves 5,000 voxels at most, on average of the two.
    source_viewpoint, target_viewpoint : (float, float, float), optional
        Where the scanner stood, in the cloud's frame, if the cloud is one single scan. What lies before its
        surface then speaks against a pose; at low overlap nothing helps more. Not for clouds fused from
        several.
    axis : (3,) array_like of float, optional
        A direction that both clouds share, such as that of gravity; the pose may tilt it by 10 degrees.
    effort : {"low", "normal", "high"}
        How long to search: mutual matches only; all matches where these aren't enough; and then finer voxels
        with the three nearest matches of each.
    front : {"dense", "paper"}, DenseFront or PaperFront
        Where matches come from: every voxel, or the keypoints of a detector, as `correspond` matches them.
    method : str, optional
        Grouping method that proposes poses, one of `cgroup.METHODS`; "lc" unless given, "gtm" with the
        paper's front.
    threads : int, optional
        Threads to compute on, None for all cores.
    progress : callable, optional
        Called with the name of each stage as it begins.
    **options
        Options of the grouping method.

    Returns
    -------
    Registration
        With `Registration.ok`, always.

    Raises
    ------
    NoConsensusError
        If no pose can be trusted; its ``registration`` is the best guess, or None where there is not even
        one.
    InputError
        If a cloud or an option can't be worked with; the message names it.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.registration import register
    >>> pair = standin_pair(pixels=60)
    >>> done = register(pair.source, pair.target)
    >>> done.ok
    True
    >>> bool(abs(done.T_target_source - pair.T_target_source).max() < done.voxel)
    True
    """
    as_choice("effort", effort, EFFORTS)
    clock = StageClock(as_stage_function(progress))
    direction = None if axis is None else as_axis(axis)
    kind = _front_of(front)
    chosen = ("gtm" if isinstance(kind, PaperFront) else "lc") if method is None else check_method(method)
    search = Search(chosen, options, direction, effort, as_threads(threads), clock)
    dense = front if isinstance(front, DenseFront) else None
    scans = prepare_pair(source, target, voxel, (source_viewpoint, target_viewpoint), dense, threads, clock)
    found = _search_keypoints(search, scans, kind) if isinstance(kind, PaperFront) else search.run(*scans)
    return _answer(found, scans, direction, clock)


def _front_of(front: object) -> DenseFront | PaperFront:
    if isinstance(front, DenseFront | PaperFront):
        return front
    if not isinstance(front, str) or front not in FRONTS:
        remedy = f"choose one of {', '.join(FRONTS)}, or give a DenseFront or PaperFront"
        raise refusal("front", front, remedy)  # noqa: EM101 - no message, but the parameter's name
    return DenseFront() if front == "dense" else PaperFront()


def _search_keypoints(
    search: Search, scans: tuple[PreparedScan, PreparedScan], front: PaperFront
) -> Found | None:
    """Search among the poses of a group of the paper's matches."""
    matches = correspond(
        *(_as_read(scan.scan) for scan in scans),
        **asdict(front),
        source_viewpoint=scans[0].viewpoint or ORIGIN,
        target_viewpoint=scans[1].viewpoint or ORIGIN,
        threads=search.threads,
        progress=search.clock.start,
    )
    search.clock.start("grouping")
    chosen = without_frames(matches) if search.method == "lc" else matches
    poses = group_poses(group(chosen, search.method, threads=search.threads, **search.options))
    return search.confirm(*scans, matches, poses)


def _as_read(scan: Scan) -> PointCloud | Cloud:
    if scan.normals is None and scan.faces is None:
        return scan.cloud
    return PointCloud(np.asarray(scan.cloud.points, dtype=np.float64), scan.normals, scan.faces)


def _answer(
    found: Found | None,
    scans: tuple[PreparedScan, PreparedScan],
    axis: FloatArray | None,
    clock: StageClock,
) -> Registration:
    """Return a pose that can be trusted, or raise with the best guess."""
    registration = None if found is None else registration_of(found, clock.stop())
    if registration is not None and registration.ok:
        return registration
    error = NoConsensusError(explain_failure(registration, *scans, axis))
    error.registration = registration
    raise error
