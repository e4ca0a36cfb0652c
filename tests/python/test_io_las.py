"""LAS and LAZ: as laspy reads them, and no file ends, holds up or fills the process."""

import io
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cloud_files import CLOUDS, TETRAHEDRON, las
from test_io_hostile import assert_reading_is_interrupted

from cgroup.errors import InputError
from cgroup.io import read_cloud
from cgroup.io.clouds import PARSERS
from interrupts import posix_only

laspy = pytest.importorskip("laspy", reason="laspy isn't installed")
lazrs = pytest.importorskip("lazrs", reason="lazrs isn't installed")

VERSIONS = [*((f, "1.2") for f in range(4)), (4, "1.3"), (5, "1.3"), *((f, "1.4") for f in range(11))]
MEMORY = 256 << 20


def random_las(point_format: int, version: str, count: int, *, is_wild: bool = False) -> "laspy.LasData":
    """Points of a scan, or any at all, with values in every field, and bytes that the format doesn't have."""
    rng = np.random.default_rng([point_format, count])
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.scales, header.offsets = [0.001, 0.01, 0.25], [1e6, -5, 3]
    if is_wild:
        header.add_extra_dim(laspy.ExtraBytesParams(name="more", type="u4"))
    record = laspy.ScaleAwarePointRecord.zeros(count, header=header)
    for name in record.array.dtype.names:
        kind = record.array.dtype[name]
        if kind.kind == "f":
            steps = rng.choice([0, 1e-5, 2e-5, 1e-3, 100], count)
            values = np.cumsum(steps) + rng.choice([0, 1e5], count, p=[0.9, 0.1])
        elif name in "XYZ" and not is_wild:
            values = np.cumsum(rng.integers(-50, 60, count))
        else:
            values = np.where(
                rng.random(count) < 0.5, rng.integers(9, size=count), rng.integers(2**62, size=count)
            )
        record.array[name] = values.astype(kind)
    las_data = laspy.LasData(header)
    las_data.points = record
    return las_data


@pytest.mark.parametrize("suffix", ["las", "laz"])
@pytest.mark.parametrize(("point_format", "version"), VERSIONS)
def test_as_laspy_reads_them(point_format: int, version: str, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    several_chunks = 60_000 if version == "1.4" and point_format in {3, 8} else 2
    for count, is_wild in ((1, False), (several_chunks, True), (2000, False)):
        random_las(point_format, version, count, is_wild=is_wild).write(path)
        theirs, ours = laspy.read(path), read_cloud(path)
        np.testing.assert_array_equal(ours.points, theirs.xyz)
        wanted = theirs.intensity if theirs.intensity.any() else None
        np.testing.assert_array_equal(ours.intensities, wanted)
        if "red" not in theirs.point_format.dimension_names:
            assert ours.colors is None
            continue
        colors = np.stack([theirs.red, theirs.green, theirs.blue], axis=1)
        np.testing.assert_array_equal(ours.colors, colors >> 8 if colors.max() > 255 else colors)


@pytest.mark.parametrize("value", [[65535, 256, 0], [255, 1, 0]])
def test_colors_of_16_bits_or_of_8(value: list[int], tmp_path: Path) -> None:
    las_data = random_las(3, "1.2", 4)
    las_data.red, las_data.green, las_data.blue = np.array([value] * 4).T
    las_data.write(tmp_path / "a.laz")
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.laz").colors, [[255, 1, 0]] * 4)


@pytest.mark.parametrize("name", ["points.las", "points.laz", "layered.laz"])
def test_a_file_cut_off_anywhere_is_refused(name: str) -> None:
    content, parse = CLOUDS[name], PARSERS[Path(name).suffix]
    np.testing.assert_array_equal(parse(content).points, TETRAHEDRON)
    for end in range(1, len(content)):
        with pytest.raises(InputError, match="got "):
            parse(content[:end])


def changed(content: bytes, at: int, *numbers: int) -> bytes:
    return content[:at] + struct.pack(f"<{len(numbers)}I", *numbers) + content[at + 4 * len(numbers) :]


def repeated_chunks(number: int, points: np.ndarray) -> bytes:
    """LAZ of point format 0, each chunk of which holds the same 50,000 points."""
    vlr = lazrs.LazVlr.new_for_compression(0, 0)
    packed = bytes(lazrs.compress_points(vlr, points.view(np.uint8), False))
    chunk = packed[8 : struct.unpack_from("<q", packed)[0]]
    table = io.BytesIO()
    lazrs.write_chunk_table(table, [(50_000, len(chunk))] * number, vlr)
    body = struct.pack("<q", 8 + number * len(chunk)) + chunk * number + table.getvalue()
    return las(body, 50_000 * number, 0, laszip=vlr.record_data())


def hostile() -> dict[str, bytes]:
    """Files that ended the process, held it up or filled its memory."""
    laz, layered, plain = (CLOUDS[name] for name in ("points.laz", "layered.laz", "points.las"))
    start, layers = struct.unpack_from("<I", laz, 96)[0], struct.unpack_from("<I", layered, 96)[0] + 8 + 36
    table = struct.unpack_from("<q", laz, start)[0]
    return {
        "chunks.laz": changed(laz, table + 4, 0xFFFFFFF0),
        "table.laz": changed(laz, start, 0xFFFFFFFF, 0x7FFFFFFF),
        "layer.laz": changed(layered, layers + 4, 0xFFFFFFF0),
        "count.laz": changed(laz, 107, 0xFFFFFFFF),
        "count.las": changed(plain, 107, 0xFFFFFFFF),
        "start.las": changed(plain, 96, 0xFFFFFFFF),
        "point.laz": changed(laz, 105, 0x0004FFFF),
        "equal.laz": repeated_chunks(400, np.zeros(50_000 * 20, np.uint8)),
    }


@pytest.mark.skipif(sys.platform != "linux", reason="memory is bounded through /proc and setrlimit")
def test_no_file_ends_or_fills_the_process(tmp_path: Path) -> None:
    files = hostile()
    assert len(files["equal.laz"]) < 200_000  # 20 million points
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    program = f"""
import resource
from pathlib import Path
from cgroup.errors import InputError
from cgroup.io import read_cloud
used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + {MEMORY},) * 2)
for path in sorted(Path({str(tmp_path)!r}).iterdir()):
    try:
        print(path.name, len(read_cloud(path)))
    except InputError as error:
        print(path.name, "refused" if len(str(error)) < 400 else error)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=600
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == [f"{name} refused" for name in sorted(files)]


def test_records_that_nobody_needs_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "a.las").write_bytes(changed(CLOUDS["points.las"], 100, 0xFFFFFFFF))
    assert len(read_cloud(tmp_path / "a.las")) == 4


@posix_only
def test_reading_laz_is_interrupted(tmp_path: Path) -> None:
    points = np.random.default_rng(1).integers(256, size=50_000 * 20, dtype=np.uint8)
    (tmp_path / "a.laz").write_bytes(repeated_chunks(20, points))
    assert_reading_is_interrupted(tmp_path / "a.laz")
