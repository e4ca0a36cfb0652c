"""Two scans made ready alike: the same voxel, the same radii, normals on the same side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

from cgroup import features
from cgroup._checks.values import as_length
from cgroup.errors import InputError
from cgroup.registration.checks import as_viewpoint, check_sizes
from cgroup.registration.prepared import VOXELS, DenseFront, PreparedScan, prepare_scan
from cgroup.registration.scan import Scan, as_scan

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from cgroup._runtime.progress import StageClock
    from cgroup.features import Cloud, Viewpoint
    from cgroup.types import PointCloud

_Half: TypeAlias = "PreparedScan | Scan"


def prepare_pair(
    source: PreparedScan | PointCloud | Cloud | ArrayLike,
    target: PreparedScan | PointCloud | Cloud | ArrayLike,
    voxel: float | None,
    viewpoints: tuple[Viewpoint | None, Viewpoint | None],
    front: DenseFront | None,
    threads: int | None,
    clock: StageClock,
) -> tuple[PreparedScan, PreparedScan]:
    """Make both scans ready, where they aren't; front and viewpoints are those of scans that aren't."""
    clock.start("voxel size")
    halves = [
        cloud if isinstance(cloud, PreparedScan) else as_scan(name, cloud)
        for name, cloud in (("source", source), ("target", target))
    ]
    _refuse_late_options(halves, viewpoints, front)
    size, radii = common_voxel(halves, voxel, front, threads)
    by_frames = any(
        half.by_frames if isinstance(half, PreparedScan) else viewpoint is None
        for half, viewpoint in zip(halves, viewpoints, strict=True)
    )

    def finish(half: _Half, place: Any) -> PreparedScan:  # noqa: ANN401 - checked where it is used
        if isinstance(half, PreparedScan):
            return half.turned_by_frames if by_frames else half

        def begin(stage: str) -> None:
            clock.start(f"{half.name} {stage}")

        return prepare_scan(half, size, place, radii, threads, begin, by_frames=by_frames)

    return finish(halves[0], viewpoints[0]), finish(halves[1], viewpoints[1])


def common_voxel(
    halves: Sequence[_Half], voxel: float | None, front: DenseFront | None, threads: int | None
) -> tuple[float, DenseFront]:
    """Return voxel and radii that all scans share: those of prepared ones, those given, or chosen ones."""
    check_sizes([_whole(half) for half in halves])
    prepared = [half for half in halves if isinstance(half, PreparedScan)]
    if prepared:
        return _shared(prepared, voxel), prepared[0].front
    return _voxel(halves, voxel, threads), front or DenseFront()


def _refuse_late_options(
    halves: Sequence[_Half], viewpoints: tuple[Viewpoint | None, Viewpoint | None], front: DenseFront | None
) -> None:
    """Raise `InputError` for what would have had to be known when a scan was prepared."""
    for name, half, viewpoint in zip(("source", "target"), halves, viewpoints, strict=True):
        if not isinstance(half, PreparedScan):
            continue
        if viewpoint is not None and as_viewpoint(half.scan, viewpoint) != half.viewpoint:
            message = (
                f"{name}_viewpoint: the {name} is prepared, with viewpoint={half.viewpoint}; prepare it anew"
            )
            raise InputError(message)
        if front is not None and front != half.front:
            message = f"front: got {front}, but the {name} is prepared, with {half.front}; prepare it anew"
            raise InputError(message)


def _shared(prepared: Sequence[PreparedScan], voxel: float | None) -> float:
    """Return the voxel of scans that are ready."""
    first = prepared[0]
    alike = all(scan.voxel == first.voxel and scan.front == first.front for scan in prepared)
    if alike and (voxel is None or as_length("voxel", voxel) == first.voxel):
        return first.voxel
    sizes = " and ".join(dict.fromkeys(f"{scan.voxel:.4g}" for scan in prepared))
    asked = "" if voxel is None else f", voxel={voxel}"
    message = f"scans: prepared with voxels of {sizes}{asked}; prepare them with the same voxel and front"
    raise InputError(message)


def _voxel(halves: Sequence[_Half], voxel: float | None, threads: int | None) -> float:
    """Return the voxel given, or one that suits both scans."""
    if voxel is not None:
        return as_length("voxel", voxel)
    clouds = [_whole(half).cloud for half in halves]
    return features.choose_voxel(*clouds, voxels=VOXELS, threads=threads)


def _whole(half: _Half) -> Scan:
    return half.scan if isinstance(half, PreparedScan) else half
