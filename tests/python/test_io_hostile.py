"""Files that are made to hurt: they end in one sentence, soon, and in little memory."""

import io
import os
import socket
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cloud_files import CLOUDS, TETRAHEDRON, npy, npz

from cgroup import features
from cgroup.benchmark.config import parse_config
from cgroup.errors import InputError, OutOfMemoryError
from cgroup.evaluation.recall_protocols import read_protocol
from cgroup.io import read_cloud, read_correspondences, read_descriptors, read_transform
from interrupts import interrupt, posix_only

READERS = [read_cloud, read_correspondences, read_descriptors, read_transform]

PCD_BOMB = (
    b"VERSION 0.7\nFIELDS x y z w\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1000000000\nWIDTH 1\nHEIGHT 1\nPOINTS 1\n"
    b"DATA ascii\n0 0 0\n"
)


def npy_header(shape: tuple[int, ...], kind: Any = "<f8") -> bytes:
    """An array without its numbers."""
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": kind, "fortran_order": False, "shape": shape})
    return file.getvalue()


def zipped(name: str, content: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, content)
    return file.getvalue()


HOSTILE = {
    "count.pcd": PCD_BOMB.replace(b"1000000000", b"1").replace(b"COUNT 1", b"COUNT 1000000000"),
    "unneeded.pcd": PCD_BOMB,
    "points.pcd": CLOUDS["binary.pcd"].replace(b"POINTS 4", b"POINTS 400000000000"),
    "overflow.pcd": CLOUDS["binary.pcd"].replace(b"POINTS 4", b"POINTS 1537228672809129302"),
    "expands.pcd": CLOUDS["compressed.pcd"].split(b"binary_compressed\n")[0].replace(b"S 4", b"S 300000000")
    + b"binary_compressed\n"
    + b"\x04\0\0\0\xff\xff\xff\xff\0a\0a",
    "vertices.ply": CLOUDS["little.ply"].replace(b"vertex 4", b"vertex 4000000000"),
    "text.ply": CLOUDS["ascii.ply"].replace(b"vertex 4", b"vertex 4000000000"),
    "nothing.ply": CLOUDS["little.ply"].replace(
        b"element vertex 4\n", b"element nothing 9000000000000000000\nelement vertex 9\n"
    ),
    "list.ply": CLOUDS["big.ply"].replace(b"list uchar int", b"list uint int"),
    "counts.off": CLOUDS["mesh.off"].replace(b"4 4 6", b"4000000000 4 6"),
    "faces.off": CLOUDS["mesh.off"].replace(b"4 4 6", b"4 4000000000 6"),
    "count.pts": CLOUDS["count.pts"].replace(b"4\n", b"4000000000\n", 1),
    "count.ptx": CLOUDS["grid.ptx"].replace(b"2\n2\n", b"2000000000\n2000000000\n", 1),
    "count.glb": CLOUDS["mesh.glb"].replace(b'"count": 4, ', b'"count": 4e9'),
    "zeros.gltf": CLOUDS["mesh.gltf"]
    .replace(b'{"bufferView": 0, ', b"{")
    .replace(b'"count": 4', b'"count": 400000000000'),
    "count.asc": CLOUDS["points.asc"].replace(b"4\n", b"4000000000\n", 1),
    "fewer.asc": CLOUDS["points.asc"].replace(b"4\n", b"3\n", 1),
    "count.vtk": CLOUDS["ascii.vtk"].replace(b"POINTS 4", b"POINTS 4000000000"),
    "overflow.vtk": CLOUDS["binary.vtk"].replace(b"POINTS 4", b"POINTS 6148914691236517206"),
    "cells.vtk": CLOUDS["binary.vtk"].replace(b"POLYGONS 4 16", b"POLYGONS 4000000000 16"),
    "corners.vtk": CLOUDS["new.vtk"].replace(b"POLYGONS 5 12", b"POLYGONS 5 4000000000"),
    "field.vtk": CLOUDS["ascii.vtk"].replace(b"POINTS", b"FIELD a 1\nb 4000000000 4000000000 int\nPOINTS"),
    "records.npy": npy_header((10**12,), [("x", "<f8"), ("y", "<f8"), ("z", "<f8")]),
    "objects_in.npy": npy_header((4,), [("x", "|O"), ("y", "<f8"), ("z", "<f8")]) + b"\0" * 100,
    "empty_in.npy": npy_header((10**12,), [("x", "<f8", (0,)), ("y", "<f8", (0,)), ("z", "<f8", (0,))]),
    "lengths.npz": npz(x=np.zeros(3), y=np.zeros(3), z=np.zeros(2)),
    "count.stl": b"\0" * 80 + b"\xff" * 4 + b"\0" * 500,
    "shape.npy": npy_header((10**12, 3)),
    "exabytes.npy": npy_header((2**40, 2**40, 3)),
    "negative.npy": npy_header((-1, 3)) + b"\0" * 100,
    "nothing.npy": npy_header((10**15, 3), "<U0"),
    "objects.npy": npy_header((4, 3), "|O") + b"\0" * 100,
    "shape.npz": zipped("points.npy", npy_header((10**12, 3))),
    "bomb.npz": zipped("points.npy", npy_header((3 << 20, 3)) + bytes(72 << 20)),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_little_is_believed(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(HOSTILE[name])
    with pytest.raises(InputError, match=name) as caught:
        read_cloud(tmp_path / name)
    assert len(str(caught.value)) < 400
    assert str(caught.value).isprintable()


FOREIGN = {
    "ascii.ply": (b"comment made by hand", b"comment caf\xe9"),
    "ascii.pcd": (b"# .PCD", b"# \xe9 .PCD"),
    "mesh.obj": (b"# by hand", b"# \xe9\no \xff\xfe\nusemtl caf\xe9"),
    "mesh.off": (b"OFF\n", b"OFF # \xe9\n"),
    "ascii.stl": (b"solid tetrahedron", b"solid caf\xe9"),
    "points.xyz": (b"// x", b"// \xe9 x"),
    "count.pts": (b"4\n", b"# \xe9\n4\n"),
    "names.csv": (b"label", b"caf\xe9"),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_bytes_of_any_language_are_read(name: str, tmp_path: Path) -> None:
    before, after = FOREIGN[name]
    assert before in CLOUDS[name]
    for mark in (b"", b"\xef\xbb\xbf"):
        (tmp_path / name).write_bytes(
            mark + CLOUDS[name].replace(before, after).removeprefix(b"\xef\xbb\xbf")
        )
        assert len(read_cloud(tmp_path / name)) == 4


def test_texture_coordinates_are_left_out(tmp_path: Path) -> None:
    text = (
        b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        b"property float u\nproperty float v\nelement face 1\nproperty list uchar int vertex_indices\n"
        b"property list uchar float texcoord\nend_header\n"
        b"0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2 6 0 0 1 0 0 1\n"
    )
    (tmp_path / "a.ply").write_bytes(text)
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.ply").faces, [[0, 1, 2]])


def test_control_characters_of_a_file_are_not_passed_on(tmp_path: Path) -> None:
    bad = b"1 2 \x1b[2J\xea\x9f\x94\n"
    for read, name, content in (
        (read_cloud, "a.xyz", b"1 2 3\n" + bad),
        (read_cloud, "a.npy", CLOUDS["points.npy"][:30] + 9 * bad),
        (read_correspondences, "a.npz", npz(**{"\x1b[2J": np.zeros(3)})),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=name) as caught:
            read(tmp_path / name)
        assert str(caught.value).isprintable()


# --- NPZ -------------------------------------------------------------------------------------


def test_arrays_that_are_not_asked_for_stay_packed(tmp_path: Path) -> None:
    broken = zipped("unneeded.npy", npy_header((10**12,)))
    for name, read, arrays in (
        ("c.npz", read_correspondences, {"source": TETRAHEDRON, "target": TETRAHEDRON}),
        ("p.npz", read_cloud, {"points": TETRAHEDRON}),
    ):
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            for key, array in arrays.items():
                archive.writestr(f"{key}.npy", npy(array))
            archive.writestr("unneeded.npy", broken)
        assert len(read(tmp_path / name)) == 4  # type: ignore[operator]


def test_arrays_are_read_as_numpy_reads_them(tmp_path: Path) -> None:
    for arrays in ({"xyz": TETRAHEDRON, "rgb": np.zeros(3)}, {"anything": TETRAHEDRON}):
        (tmp_path / "a.npz").write_bytes(npz(**arrays))
        np.testing.assert_array_equal(read_cloud(tmp_path / "a.npz").points, TETRAHEDRON)
    for kind in ("<f8", ">f4", "<i2", "f2", "?"):
        for order in "CF":
            array = np.asarray(TETRAHEDRON.astype(kind), order=order)
            np.save(tmp_path / "a.npy", array)
            np.testing.assert_array_equal(read_cloud(tmp_path / "a.npy").points, array)


# --- what isn't a file -----------------------------------------------------------------------


@posix_only
@pytest.mark.parametrize("read", READERS)
def test_only_files_are_read(read: Callable[[Path], object], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.npz")
    (tmp_path / "endless.npz").symlink_to("/dev/zero")
    (tmp_path / "folder.npz").mkdir()
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "s.npz"))
        for name, says in {
            **dict.fromkeys(("pipe", "endless", "s"), "is a pipe, a device or a socket"),
            "folder": "is a directory",
            "missing": "no such file",
            "zero\0byte": "a path can't hold a zero byte",
            "z" * 300: "File name too long",
        }.items():
            with pytest.raises(InputError, match=says):
                read(tmp_path / f"{name}.npz")


# --- interruption ----------------------------------------------------------------------------


READING = """
import threading
import cgroup.io.clouds as formats
from cgroup._checks.values import run_options

# The first look for a signal says that the core is at work.
entered = threading.Event()
def look(share):
    if not entered.is_set():
        entered.set()
        print("parsing", flush=True)

formats.run_options = lambda **_: run_options(threads=1, progress=look)
try:
    while True:
        formats.read_cloud({path!r})
except KeyboardInterrupt:
    print("interrupted")
"""


def assert_reading_is_interrupted(path: Path) -> None:
    assert interrupt(READING.format(path=str(path)), after="parsing") == "interrupted\n"


PLY_HEAD = (
    "ply\nformat ascii 1.0\nelement vertex 2000000\n"
    "property float x\nproperty float y\nproperty float z\nend_header\n"
)


@posix_only
@pytest.mark.parametrize(
    ("name", "head", "word"), [("a.ply", PLY_HEAD, ""), ("a.obj", "", "v "), ("a.xyz", "", "")]
)
def test_reading_is_interrupted(name: str, head: str, word: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(head + 2_000_000 * f"{word}0.125 2.5 3\n")
    assert_reading_is_interrupted(tmp_path / name)


# --- with NumPy alone ------------------------------------------------------------------------


def test_numpy_is_enough(tmp_path: Path) -> None:
    for name, content in CLOUDS.items():
        (tmp_path / name).write_bytes(content)
    program = f"""
import sys
from pathlib import Path
for name in ("trimesh", "pypcd4", "laspy", "lazrs", "scipy", "pandas", "matplotlib"):
    sys.modules[name] = None
from cgroup.io import read_cloud, write_cloud
for path in sorted(Path({str(tmp_path)!r}).iterdir()):
    write_cloud(path.with_name("again.ply"), read_cloud(path))
    assert len(read_cloud(path.with_name("again.ply"))) == 4
print("fine")
"""
    assert subprocess.check_output([sys.executable, "-c", program], text=True) == "fine\n"


def test_texts_nested_too_deeply_are_refused(tmp_path: Path) -> None:
    text = "a = " + "[" * 100_000
    (tmp_path / "own.toml").write_text(text)
    with pytest.raises(InputError, match="own.toml"):
        read_protocol(str(tmp_path / "own.toml"))
    with pytest.raises(InputError, match="not TOML"):
        parse_config(text)


def test_arrays_that_memory_cannot_hold_are_an_error_of_memory() -> None:
    with pytest.raises(OutOfMemoryError, match="no memory"):
        features.voxel_downsample(np.broadcast_to(np.zeros(3), (10**13, 3)), 1.0)
