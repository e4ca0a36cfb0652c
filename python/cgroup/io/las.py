"""LAS and LAZ files: move one; merge original files into one, or into an E57, with attributes of points."""

from __future__ import annotations

import copy
import logging
import math
import os
import struct
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup._checks.values import as_items, as_path
from cgroup.errors import InputError
from cgroup.io._e57 import Scan, scan_of, write_e57
from cgroup.io._motion import MOST_LOST, XYZ, Motion
from cgroup.io.attributes import unkept_attributes
from cgroup.io.clouds import read_cloud
from cgroup.io.files import check_outputs, faults_of, open_input, write_stream
from cgroup.rigid import apply, check_rigid
from cgroup.types import FloatArray

# Its messages become errors here.
logging.getLogger("laspy").addHandler(logging.NullHandler())

_LAS, _HEAD = (".las", ".laz"), 375
_POINTS = 500_000  # that are moved at a time
_MOST = 2**31 - 2  # of a coordinate in units of its scale
_FINE = 1e-7  # share of the extent of other formats that a step of the coordinates is at most
_MOST_16 = 2**16 - 1  # largest number of 16 bits: of files in point_source_id, and of intensities
_Scale: TypeAlias = tuple[float, float]  # intensities that are stored as 0 and _MOST_16
_Range: TypeAlias = tuple[float, float, bool]  # least and largest intensity, or 0; whether all are whole
_AS_IS, _NONE = (0.0, float(_MOST_16)), (0.0, 0.0, True)
_WITH_SCAN_ANGLE, _ANGLE = 6, 0.006  # point format since which scan angles are in this unit, in degrees


def check_laspy(files: Iterable[Path]) -> None:
    """Raise `InputError` for LAS files without laspy."""
    for file in files:
        if file.suffix.lower() in _LAS and find_spec("laspy") is None:
            raise InputError(f"{file}: moving it needs laspy; pip install 'cgroup[las]'")


def move_las(motion: Motion, source: BinaryIO, out: BinaryIO, *, is_packed: bool = False) -> None:
    """Move the points of a file; all records are kept but for the index of COPC."""
    import laspy  # noqa: PLC0415 - slow to load, optional

    with _open_las(source) as reader:
        header, evlrs = copy.deepcopy(reader.header), reader.evlrs
        header.evlrs = None
        for kept in (header.vlrs, evlrs or []):
            _drop_index(kept, motion)
        if header.point_format.has_waveform_packet:
            motion.notes.append("waveforms: not copied; points keep their addresses in the original file")
        header.scales, header.offsets = _choose_grid([motion], [header])
        with laspy.LasWriter(out, header, do_compress=is_packed, closefd=False) as writer:
            for points in _blocks(reader):
                _move_points(motion, points, points, header)
                writer.write_points(points)
            if evlrs:
                writer.write_evlrs(evlrs)


def _open_las(source: BinaryIO) -> Any:  # noqa: ANN401 - of laspy
    import laspy  # noqa: PLC0415 - slow to load, optional

    head, size = source.read(_HEAD).ljust(_HEAD, b"\0"), source.seek(0, os.SEEK_END)
    vlrs, more = struct.unpack_from("<I139xI", head, 100)
    records = vlrs + (more if head[25] > 3 else 0)
    if head[:4] != b"LASF" or 54 * records > size:
        raise InputError(f"{records} records in {size} bytes")
    source.seek(0)
    reader = laspy.open(source, closefd=False)
    if not ((reader.header.scales > 0) & np.isfinite(reader.header.scales)).all():
        raise InputError(f"its scales are {reader.header.scales}, not above 0; repair the header")
    return reader


def _blocks(reader: Any) -> Iterator[Any]:  # noqa: ANN401 - of laspy
    """Yield the points of a file; raise if it has fewer than its header declares."""
    count = 0
    for points in reader.chunk_iterator(_POINTS):
        count += len(points)
        yield points
    if count < reader.header.point_count:
        raise InputError(f"{count} of {reader.header.point_count} points")


def _drop_index(records: Any, motion: Motion) -> None:  # noqa: ANN401 - of laspy
    """Remove records of COPC, which refer to places in the file."""
    for record in [record for record in records if record.user_id == "copc"]:
        records.remove(record)
        motion.notes.append("the index of COPC: not kept; write it again, as with untwine")


def _choose_grid(
    motions: Sequence[Motion], headers: Sequence[Any], names: Sequence[str] = ("",)
) -> tuple[FloatArray, FloatArray]:
    """Return scales and offsets: as fine as before, and at most a millionth of a file's extent."""
    ends, sizes, finest = [], [], []
    for motion, header, name in zip(motions, headers, names, strict=True):
        if header.point_count:
            box = np.array([header.mins, header.maxs])
            if not (np.abs(box - header.offsets) <= 2.0**32 * header.scales).all() or (box[0] > box[1]).any():
                raise InputError(f"{name}its box, {box[0]} to {box[1]}, has no points; repair the header")
            ends.append(apply(motion.matrix, np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3)))
            sizes.append(motion.scale * float(np.linalg.norm(box[1] - box[0])) or math.inf)
            finest.append(motion.scale * float(np.min(header.scales)))
    if not ends:
        return headers[0].scales, headers[0].offsets
    low, high = np.min(ends, axis=(0, 1)), np.max(ends, axis=(0, 1))
    before = grid = min(finest)
    while min(sizes) < 0.5 * grid / MOST_LOST:
        grid /= 10
    while (high - low).max() / 2 + 1 > _MOST * grid:
        grid *= 10
    if grid > before:
        note = f"coordinates: rounded to {grid:g}, as 32 bits hold no finer ones of this extent"
        for motion in motions:
            motion.notes.append(note)
    return np.full(3, grid), np.floor((low + high) / 2)


def _move_points(motion: Motion, points: Any, moved: Any, header: Any) -> None:  # noqa: ANN401 - of laspy
    """Write the columns that change into other records, or the same, in the grid of a header."""
    given = {name.lower(): name for name in points.point_format.dimension_names if name not in "XYZ"}
    given |= zip(XYZ, XYZ, strict=True)
    columns = motion.move({name: np.array(points[given[name]]) for name in motion.names(given)})
    moved.scales, moved.offsets = header.scales, header.offsets
    try:
        for name, values in columns.items():
            moved[given[name]][:] = values
    except OverflowError as error:
        reason = "its points are outside the box that its header declares; repair the header"
        raise InputError(reason) from error


def merge_files(
    paths: Iterable[str | os.PathLike[str]], poses: Iterable[ArrayLike], out: str | os.PathLike[str]
) -> list[str]:
    """Write several files of points, each moved by its pose, as one LAS, LAZ or E57.

    In LAS, ``point_source_id`` is the number of each point's file, from 1. LAS and LAZ files keep all other
    attributes, and the first one's VLRs; of other files positions, colours and intensities are kept, which
    are scaled to 16 bits, alike for all files, unless they are such whole numbers. In E57, each file is a
    scan with its pose, in float64: coordinates stay in the frame of the file, relative to the scanner if its
    position is known. Colours, normals and intensities are kept.

    Parameters
    ----------
    paths : sequence of path-like
        Files of clouds; LAS needs the extra ``cgroup[las]``.
    poses : sequence of (4,4) array_like of float
        Pose of each file, as for `transform_file`.
    out : path-like
        ``.las``, ``.laz`` or ``.e57``; an existing file is replaced when the new one is complete.

    Returns
    -------
    list of str
        One note for each attribute that could not be kept, with the name of its file.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.types import PointCloud
    >>> from cgroup.io import merge_files, read_cloud, write_cloud
    >>> write_cloud("a.ply", PointCloud(np.eye(3)))
    >>> write_cloud("b.ply", PointCloud(np.zeros((1, 3))))
    >>> pose = np.eye(4)
    >>> pose[0, 3] = 5.0
    >>> merge_files(["a.ply", "b.ply"], [np.eye(4), pose], "both.laz")
    []
    >>> read_cloud("both.laz").points[-1].tolist()
    [5.0, 0.0, 0.0]
    """
    files = [as_path("paths", path) for path in as_items("paths", paths, "give files of clouds")]
    motions = [Motion(check_rigid(pose, "poses"), 1.0) for pose in as_items("poses", poses, "one per file")]
    out = as_path("out", out)
    if len(files) != len(motions) or not 0 < len(files) <= _MOST_16:
        got = f"{len(files)} files, {len(motions)} poses"
        raise InputError("paths, poses", got, f"give one to {_MOST_16} files, and one pose per file")
    if out.suffix.lower() not in (*_LAS, ".e57"):
        raise InputError("out", str(out), "give a name that ends in .las, .laz or .e57")
    check_outputs([out], files)
    merge = _write_scans if out.suffix.lower() == ".e57" else _write_joined
    merge(files, motions, out)
    notes = ((file.name, note) for file, one in zip(files, motions, strict=True) for note in one.notes)
    return [*dict.fromkeys(f"{name}: {note}" for name, note in notes)]


def _write_scans(files: Sequence[Path], motions: Sequence[Motion], out: Path) -> None:
    """Write E57, with a scan for each file."""

    def scans() -> Iterator[Scan]:
        for file, motion in zip(files, motions, strict=True):
            if file.suffix.lower() not in _LAS:
                motion.notes.extend(f"{name}: not kept" for name in unkept_attributes(file))
                yield scan_of(file.name, read_cloud(file), motion.matrix)
                continue
            header, *_, blocks = _open(file)
            factor = 257 if any(_colors_of(points).max(initial=0) > 255 for points in blocks) else 1
            lost = [*unkept_attributes(file), *header.point_format.extra_dimension_names]
            lost += ["coordinate system"] if _projection(header) else []
            motion.notes.extend(f"{name}: not kept" for name in lost)
            motion.notes.extend(["colors: rounded to 8 bits"] * (factor > 1))
            blocks = map(partial(_columns, factor=factor), _open(file)[-1])
            yield file.name, motion.matrix, header.point_count, blocks

    write_stream(out, partial(write_e57, scans=scans()))


def _columns(points: Any, factor: int) -> Sequence[Any]:  # noqa: ANN401 - of laspy
    """Return the columns of LAS that E57 keeps."""
    colors = np.rint(_colors_of(points) / factor)
    xyz = np.column_stack([points.x, points.y, points.z])
    return xyz, None, colors if colors.shape[1] else None, points.intensity


def _colors_of(points: Any) -> NDArray[np.uint16]:  # noqa: ANN401 - of laspy
    """Return the colours (n,3) of LAS; (n,0) without colours."""
    names = [name for name in ("red", "green", "blue") if name in points.point_format.dimension_names]
    return np.array([points[name] for name in names], np.uint16).reshape(len(names), len(points)).T


def _write_joined(files: Sequence[Path], motions: Sequence[Motion], out: Path) -> None:
    headers, lost, ranges = zip(*(_open(file)[:-1] for file in files), strict=True)
    low, high = scale = _share_scale(ranges)
    for motion, notes, strengths in zip(motions, lost, ranges, strict=True):
        motion.notes.extend(notes)
        if strengths != _NONE and scale != _AS_IS:
            motion.notes.append(f"intensity: {low:g} to {high:g} written as 0 to {_MOST_16}")
    joined = _join(files, headers, motions)

    def write(stream: BinaryIO) -> None:
        from laspy import LasWriter  # noqa: PLC0415 - slow to load, optional

        is_laz = out.suffix.lower() == ".laz"
        with LasWriter(stream, joined, do_compress=is_laz, closefd=False) as writer:
            for number, (file, motion) in enumerate(zip(files, motions, strict=True), 1):
                for points in _open(file, scale)[-1]:
                    writer.write_points(_convert(points, joined, motion, number))

    write_stream(out, write)


def _open(path: Path, scale: _Scale = _AS_IS) -> tuple[Any, list[str], _Range, Iterator[Any]]:
    """Return a file's header, notes on what its points lose, the range of its intensities, and its points."""
    parts = _parts(path, scale)  # a generator: the errors of writing its blocks are not those of this file
    return next(parts), next(parts), next(parts), parts


def _parts(path: Path, scale: _Scale) -> Iterator[Any]:
    with faults_of(path, "las"):
        if path.suffix.lower() in _LAS:
            with open_input(path) as source, _open_las(source) as reader:
                yield from (reader.header, [], _NONE)
                yield from _blocks(reader)
            return
        import laspy  # noqa: PLC0415 - slow to load, optional

        cloud = read_cloud(path)
        own = laspy.LasHeader(point_format=6 if cloud.colors is None else 7, version="1.4")
        extent = float(np.ptp(cloud.points, axis=0).max()) if len(cloud) else 0.0
        own.scales = np.full(3, 10.0 ** math.floor(math.log10(_FINE * (extent or 1.0))))
        own.offsets = cloud.points.mean(axis=0) if len(cloud) else np.zeros(3)
        made = laspy.LasData(own)
        made.xyz = cloud.points
        if cloud.colors is not None:
            made.red, made.green, made.blue = (257 * cloud.colors.T.astype(np.uint16)).tolist()
        notes = [f"{name}: not kept" for name in ("normals", "faces") if getattr(cloud, name) is not None]
        strengths = _NONE
        if cloud.intensities is not None:
            known = np.where(np.isfinite(cloud.intensities), cloud.intensities, 0.0).astype(np.float64)
            strengths = min(known.min(initial=0.0), 0.0), known.max(initial=0.0), not (known % 1).any()
            scaled = np.rint((known - scale[0]) * (_MOST_16 / (scale[1] - scale[0])))
            made.intensity = scaled.clip(0, _MOST_16).astype(np.uint16)
        made.update_header()
        notes += (f"{name}: not kept" for name in unkept_attributes(path))
        yield from (made.header, notes, strengths, made.points)


def _share_scale(ranges: Sequence[_Range]) -> _Scale:
    """Return the intensities that LAS stores as 0 and 65,535."""
    low, high = min(one[0] for one in ranges), max(one[1] for one in ranges)
    if low == 0.0 and high <= _MOST_16 and all(is_whole for *_, is_whole in ranges):
        return _AS_IS
    return low, 1.0 if low == 0.0 and high <= 1.0 else high


def _join(files: Sequence[Path], headers: Sequence[Any], motions: Sequence[Motion]) -> Any:  # noqa: ANN401 - of laspy
    """Return a header whose points have the attributes of all files, on one grid."""
    import laspy  # noqa: PLC0415 - slow to load, optional

    joined, kinds = copy.deepcopy(headers[0]), [header.point_format for header in headers]
    names = {name for kind in kinds for name in kind.standard_dimension_names}
    if max(kind.id for kind in kinds) >= _WITH_SCAN_ANGLE:
        number = 8 if "nir" in names else 7 if "red" in names else 6
    else:
        number = ("gps_time" in names) + 2 * ("red" in names)
    extra: dict[str, Any] = {}
    for file, header, kind, motion in zip(files, headers, kinds, motions, strict=True):
        for one in kind.extra_dimensions:
            if str(extra.setdefault(one.name, one)) != str(one):
                raise InputError(f"{file}: its dimension {one.name} is of another type before; rename it")
        if kind.has_waveform_packet:
            motion.notes.append("waveforms: not kept")
        if header.number_of_evlrs:
            motion.notes.append("extended VLRs: not kept")
        if header.global_encoding.gps_time_type != joined.global_encoding.gps_time_type:
            motion.notes.append(f"GPS times: counted from another day than those of {files[0].name}")
        if _projection(header) not in ([], _projection(joined)):
            motion.notes.append(f"coordinate system: not that of {files[0].name}, which is kept")
    whole = laspy.PointFormat(number)
    whole.dimensions.extend(extra.values())
    _drop_index(joined.vlrs, motions[0])
    joined.evlrs, minor = None, max(2, *(header.version.minor for header in headers), 4 * (number > 5))
    joined.set_version_and_point_format(laspy.header.Version(1, minor), whole)
    joined.scales, joined.offsets = _choose_grid(motions, headers, [f"{file}: " for file in files])
    return joined


def _projection(header: Any) -> list[bytes]:  # noqa: ANN401 - of laspy
    return [one.record_data_bytes() for one in header.vlrs if one.user_id == "LASF_Projection"]


def _convert(points: Any, joined: Any, motion: Motion, number: int) -> Any:  # noqa: ANN401 - of laspy
    """Return moved points as records of the joined header."""
    import laspy  # noqa: PLC0415 - slow to load, optional

    moved = laspy.ScaleAwarePointRecord.zeros(len(points), header=joined)
    moved.copy_fields_from(points)
    has_rank = "scan_angle_rank" in points.point_format.dimension_names
    if has_rank and joined.point_format.id >= _WITH_SCAN_ANGLE:
        moved.scan_angle = np.rint(points.scan_angle_rank / _ANGLE)
    _move_points(motion, points, moved, joined)
    moved.point_source_id = np.full(len(points), number, np.uint16)
    return moved
