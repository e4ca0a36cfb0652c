"""Our readers beside trimesh and pypcd4, on what these write and on published files, bit by bit."""

import contextlib
import io
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import trimesh
from cloud_oracle import PARSERS as ORACLES
from hypothesis import given, settings
from hypothesis import strategies as st
from pypcd4 import Encoding
from pypcd4 import PointCloud as PcdCloud
from shared_data import shared_file

from cgroup.io import PointCloud, read_cloud, write_cloud
from cgroup.io.clouds import PARSERS
from cgroup.types import FloatArray, IndexArray


@contextlib.contextmanager
def peers_may_warn() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


FIELDS = ("points", "normals", "faces", "colors", "viewpoint")


def same(first: np.ndarray | None, second: np.ndarray | None) -> bool:
    if first is None or second is None:
        return first is second
    return (first.shape, first.dtype, first.tobytes()) == (second.shape, second.dtype, second.tobytes())


def check(suffix: str, content: bytes) -> PointCloud:
    ours = PARSERS[suffix](content)
    with peers_may_warn():
        theirs = ORACLES[suffix](content)
    for name in FIELDS:
        assert same(getattr(ours, name), getattr(theirs, name)), name
    return theirs


def coordinates(kind: type) -> st.SearchStrategy[float]:
    width = 32 if kind is np.float32 else 64
    return st.floats(width=width, allow_nan=False, allow_infinity=False)


@st.composite
def meshes(draw: st.DrawFn, kind: type = np.float64) -> tuple[FloatArray, IndexArray]:
    n = draw(st.integers(3, 12))
    value = draw(st.sampled_from([coordinates(kind), st.integers(-3, 3).map(float)]))
    points = np.array(draw(st.lists(st.tuples(value, value, value), min_size=n, max_size=n)), dtype=kind)
    corner = st.integers(0, n - 1)
    faces = draw(st.lists(st.tuples(corner, corner, corner), min_size=1, max_size=8))
    return points, np.array(faces, dtype=np.int64)


def export(points: Any, faces: Any, **options: Any) -> bytes:
    with peers_may_warn():
        mesh = trimesh.Trimesh(points, faces, process=False)
        content = mesh.export(**options)
    return content.encode() if isinstance(content, str) else content


@given(meshes(), st.sampled_from(["ascii", "binary_little_endian"]))
def test_ply(mesh: tuple[FloatArray, IndexArray], encoding: str) -> None:
    check(".ply", export(*mesh, file_type="ply", encoding=encoding.removesuffix("_little_endian")))


@given(meshes())
def test_off(mesh: tuple[FloatArray, IndexArray]) -> None:
    points, faces = mesh
    read = check(".off", export(points, faces, file_type="off", digits=17))
    assert same(read.faces, faces)


@given(meshes())
def test_obj(mesh: tuple[FloatArray, IndexArray]) -> None:
    rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh[0].tolist()]
    rows += [f"f {a} {b} {c}" for a, b, c in (mesh[1] + 1).tolist()]
    check(".obj", "\n".join(rows).encode())


@given(meshes(np.float32), st.sampled_from(["stl", "stl_ascii"]))
def test_stl(mesh: tuple[FloatArray, IndexArray], file_type: str) -> None:
    check(".stl", export(*mesh, file_type=file_type))


@given(
    # At least two: pypcd4 can't read one in ASCII.
    st.lists(st.tuples(*[coordinates(np.float32)] * 3), min_size=2, max_size=40),
    st.sampled_from(["ascii", "binary", "binary_compressed"]),
    st.sampled_from([np.float32, np.float64]),
    st.booleans(),
)
def test_pcd(rows: list[tuple[float, ...]], encoding: str, kind: type, more: bool) -> None:
    columns = [*np.array(rows, dtype=kind).T]
    fields, kinds = ["x", "y", "z"], [kind] * 3
    if more:
        bits = np.arange(len(rows), dtype=np.uint32) * 0x0A0B0C
        fields += ["rgb", "ring", "normal_x", "normal_y", "normal_z"]
        kinds += [np.float32, np.uint16, np.float32, np.float32, np.float32]
        columns += [bits.view(np.float32), bits.astype(np.uint16), *np.array(rows, dtype=np.float32).T]
    file = io.BytesIO()
    with peers_may_warn():
        PcdCloud.from_points(tuple(columns), tuple(fields), tuple(kinds)).save(file, Encoding(encoding))
    check(".pcd", file.getvalue())


@given(st.lists(st.tuples(*[st.floats()] * 4), min_size=1, max_size=20), st.sampled_from(" ,;\t"))
def test_text(rows: list[tuple[float, ...]], separator: str) -> None:
    text = "# x y z\n" + "\n".join(separator.join(map(repr, row)) for row in rows)
    ours, theirs = (parsers[".xyz"](text.encode()).points for parsers in (PARSERS, ORACLES))
    np.testing.assert_array_equal(ours, theirs)  # NaN may differ in its sign


@settings(max_examples=30)
@given(meshes(), st.booleans())
def test_own_files(
    tmp_path_factory: pytest.TempPathFactory, mesh: tuple[FloatArray, IndexArray], more: bool
) -> None:
    points, faces = mesh
    colors = np.arange(3 * len(points), dtype=np.uint8).reshape(-1, 3)
    normals = np.float64(np.float32(points / 1e300))
    cloud = PointCloud(points, normals, faces, colors) if more else PointCloud(points)
    path = tmp_path_factory.mktemp("own") / "a.ply"
    write_cloud(path, cloud)
    read = read_cloud(path)
    assert all(same(getattr(read, name), getattr(cloud, name)) for name in FIELDS)
    check(".ply", path.read_bytes())


@pytest.mark.parametrize(
    "name",
    [
        "b3r/models/bunny.ply",
        "u3or/models/cheff_small.ply",
        "lidar/small_gicp_source.ply",
        "u3or/pcl/rs1.pcd",
        "pcl/bun4.pcd",
        "threedmatch/7-scenes-redkitchen/cloud_bin_7.pcd",
    ],
)
def test_published_files(name: str) -> None:
    path = shared_file(f"data/{name}")
    check(path.suffix, path.read_bytes())


def test_polygons_are_cut_as_trimesh_cuts_them() -> None:
    text = b"OFF\n5 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 2 0\n4 0 1 2 3\n4 4 3 2 1\n"
    ours, theirs = PARSERS[".off"](text), ORACLES[".off"](text)
    # Its triangles may begin with another corner, and follow in another order.
    turned = [
        sorted(tuple(np.roll(face, -int(np.argmin(face)))) for face in each)
        for each in (ours.faces, theirs.faces)
    ]
    assert turned[0] == turned[1]
