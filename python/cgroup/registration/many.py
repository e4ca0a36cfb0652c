"""Many pairs of scans, each scan made ready once, on all cores."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cgroup._checks.values import as_choice, as_count, as_instance, as_items, refusal
from cgroup._runtime.progress import StageClock, as_stage_function
from cgroup._runtime.workers import count_workers, work_side_by_side
from cgroup.errors import InputError
from cgroup.group import check_method
from cgroup.registration.pair import common_voxel
from cgroup.registration.poses import as_axis
from cgroup.registration.prepared import DenseFront, PreparedScan, prepare_scan
from cgroup.registration.report import registration_of
from cgroup.registration.scan import as_scan
from cgroup.registration.search import EFFORTS, Search

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import ArrayLike

    from cgroup.features import Cloud, Viewpoint
    from cgroup.registration.result import Registration
    from cgroup.registration.search import Effort
    from cgroup.types import PointCloud


def register_many(
    scans: Sequence[PreparedScan | PointCloud | Cloud | ArrayLike],
    pairs: Iterable[tuple[int, int]] | None = None,
    *,
    voxel: float | None = None,
    viewpoints: Sequence[Viewpoint | None] | None = None,
    axis: ArrayLike | None = None,
    effort: Effort = "normal",
    front: DenseFront | None = None,
    method: str = "lc",
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
    **options: Any,  # noqa: ANN401 - those of the method
) -> list[Registration | None]:
    """Register many pairs of scans, one thread each, on all cores.

    Every scan is made ready once, however many pairs it is in. All have the same voxel.

    Parameters
    ----------
    scans : sequence of PreparedScan, PointCloud, Cloud or (N,3) array_like of float
        Two or more, in the same unit.
    pairs : iterable of (int, int), optional
        Rows of `scans`: which is moved, and which it is moved to. By default each of the others is registered
        to the first.
    voxel : float, optional
        Edge length of the voxels, in the unit of the points; by default the smallest 2^(k/4) that leaves
        5,000 voxels at most, on average of all scans.
    viewpoints : sequence of (float, float, float) or None, optional
        Where the scanner stood, one per scan, in its frame; None for a cloud that is not one single scan.
    axis : (3,) array_like of float, optional
        A direction that all clouds share, such as that of gravity; a pose may tilt it by 10 degrees.
    effort : {"low", "normal", "high"}
        How long to search: mutual matches only; all matches where these aren't enough; and then finer voxels
        with the three nearest matches of each.
    front : DenseFront, optional
        Radii of normals, frames and descriptors, in voxels.
    method : str
        Grouping method that proposes poses, one of `cgroup.METHODS`.
    threads : int, optional
        Number of scans, then of pairs worked on at a time; None for one per core.
    progress : callable, optional
        Called with ``"scan 3 of 10"`` or ``"pair 5 of 45"`` as each begins, by several threads.
    **options
        Options of the grouping method.

    Returns
    -------
    list of Registration or None
        In the order of the pairs. `Registration.ok` is false where the pose can't be trusted; None where not
        even a guess was found.

    Raises
    ------
    InputError
        If a scan, a pair or an option can't be worked with; the message names it.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.registration import register_many
    >>> pair, other = standin_pair(pixels=60), standin_pair(seed=1, pixels=60)
    >>> found = register_many([pair.target, pair.source, other.source])
    >>> [done is not None and done.ok for done in found]
    [True, False]
    """
    as_choice("effort", effort, EFFORTS)
    workers = count_workers(threads)
    if front is not None:
        as_instance("front", front, DenseFront)
    given = as_items("scans", scans, "give two clouds or more")
    if not given:
        message = "scans: got none; give two or more"
        raise InputError(message)
    wanted = _as_pairs(pairs, len(given))
    places = _as_viewpoints(viewpoints, len(given))
    direction = None if axis is None else as_axis(axis)
    begin, proposer = as_stage_function(progress), check_method(method)
    clouds = [
        cloud if isinstance(cloud, PreparedScan) else as_scan(f"scans[{row}]", cloud)
        for row, cloud in enumerate(given)
    ]
    size, radii = common_voxel(clouds, voxel, front, threads)

    def make_ready(row: int, stop_with_the_others: Callable[[], None]) -> PreparedScan:
        cloud = clouds[row]
        if isinstance(cloud, PreparedScan):
            return cloud
        begin(f"scan {row + 1} of {len(clouds)}")
        place = places[row]
        return prepare_scan(
            cloud, size, place, radii, 1, lambda _: stop_with_the_others(), by_frames=place is None
        )

    def register_one(number: int, stop_with_the_others: Callable[[], None]) -> Registration | None:
        begin(f"pair {number + 1} of {len(wanted)}")
        source, target = (prepared[row] for row in wanted[number])
        if source.by_frames or target.by_frames:
            source, target = source.turned_by_frames, target.turned_by_frames
        clock = StageClock(lambda _: stop_with_the_others())
        found = Search(proposer, options, direction, effort, 1, clock).run(source, target)
        return None if found is None else registration_of(found, clock.stop())

    prepared = work_side_by_side(range(len(clouds)), make_ready, workers)
    return work_side_by_side(range(len(wanted)), register_one, workers)


def _as_pairs(pairs: Iterable[tuple[int, int]] | None, scans: int) -> list[tuple[int, int]]:
    """Check pairs of rows."""
    if pairs is None:
        return [(row, 0) for row in range(1, scans)]
    checked: list[tuple[int, int]] = []
    remedy = "give two rows of scans, source and target"
    for number, pair in enumerate(as_items("pairs", pairs, f"for each pair {remedy}")):
        name = f"pairs[{number}]"
        rows = as_items(name, pair, remedy)
        if len(rows) != 2:
            raise refusal(name, pair, remedy)
        source, target = (as_count(name, row, 0) for row in rows)
        if max(source, target) >= scans:
            message = f"{name}: got {(source, target)}, but there are {scans} scans; rows begin with 0"
            raise InputError(message)
        checked.append((source, target))
    return checked


def _as_viewpoints(viewpoints: Sequence[Viewpoint | None] | None, scans: int) -> Sequence[Viewpoint | None]:
    if viewpoints is None:
        return [None] * scans
    places = as_items("viewpoints", viewpoints, "give one per scan, or None for it")
    if len(places) != scans:
        message = f"viewpoints: got {len(places)} for {scans} scans; give one per scan, or None for it"
        raise InputError(message)
    return places
