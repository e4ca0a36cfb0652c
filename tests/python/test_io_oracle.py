"""Our readers on random clouds that trimesh and pypcd4 write, and on published files that these read."""

import contextlib
import io
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from pypcd4 import Encoding
from pypcd4 import PointCloud as PcdCloud
from shared_data import shared_file

from cgroup.io import PointCloud, read_cloud, write_cloud
from cgroup.io.clouds import PARSERS
from cgroup.types import FloatArray, IndexArray

Mesh = tuple[FloatArray, IndexArray]


@contextlib.contextmanager
def peers_may_warn() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def coordinates(kind: type) -> st.SearchStrategy[float]:
    width = 32 if kind is np.float32 else 64
    return st.floats(width=width, allow_nan=False, allow_infinity=False)


@st.composite
def meshes(draw: st.DrawFn, kind: type = np.float64) -> Mesh:
    n = draw(st.integers(3, 12))
    value = draw(st.sampled_from([coordinates(kind), st.integers(-3, 3).map(float)]))
    points = np.array(draw(st.lists(st.tuples(value, value, value), min_size=n, max_size=n)), dtype=kind)
    corner = st.integers(0, n - 1)
    faces = draw(st.lists(st.tuples(corner, corner, corner), min_size=1, max_size=8))
    return points, np.array(faces, dtype=np.int64)


def export(points: Any, faces: Any, **options: Any) -> bytes:
    with peers_may_warn():
        content = trimesh.Trimesh(points, faces, process=False).export(**options)
    return content.encode() if isinstance(content, str) else content


def load(content: bytes, file_type: str) -> Any:
    with peers_may_warn():
        return trimesh.load(io.BytesIO(content), file_type=file_type, process=False)


def assert_same_triangles(cloud: Any, triangles: Any) -> None:
    """Points of equal coordinates are one; the triangles keep their order."""
    np.testing.assert_array_equal(cloud.points[cloud.faces], triangles)
    assert len(np.unique(cloud.points + 0.0, axis=0)) == len(cloud.points)


@given(meshes(), st.sampled_from(["ascii", "binary"]))
def test_ply(mesh: Mesh, encoding: str) -> None:
    content = export(*mesh, file_type="ply", encoding=encoding)
    ours, theirs = PARSERS[".ply"](content), load(content, "ply")
    np.testing.assert_array_equal(ours.points, theirs.vertices)
    np.testing.assert_array_equal(ours.faces, mesh[1])


@given(meshes())
def test_off(mesh: Mesh) -> None:
    rows = [f"{x!r} {y!r} {z!r}" for x, y, z in mesh[0].tolist()]
    rows += [f"3 {a} {b} {c}" for a, b, c in mesh[1].tolist()]
    cloud = PARSERS[".off"](f"OFF\n{len(mesh[0])} {len(mesh[1])} 0\n{chr(10).join(rows)}".encode())
    np.testing.assert_array_equal(cloud.points, mesh[0])
    np.testing.assert_array_equal(cloud.faces, mesh[1])


@given(meshes())
def test_obj(mesh: Mesh) -> None:
    rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh[0].tolist()]
    rows += [f"f {a} {b} {c}" for a, b, c in (mesh[1] + 1).tolist()]
    assert_same_triangles(PARSERS[".obj"]("\n".join(rows).encode()), mesh[0][mesh[1]])


@given(meshes(np.float32), st.sampled_from(["stl", "stl_ascii"]))
def test_stl(mesh: Mesh, file_type: str) -> None:
    content = export(*mesh, file_type=file_type)
    assert_same_triangles(PARSERS[".stl"](content), load(content, file_type).triangles)


@given(
    # At least two: pypcd4 can't read one in ASCII.
    st.lists(st.tuples(*[coordinates(np.float32)] * 3), min_size=2, max_size=40),
    st.sampled_from(["ascii", "binary", "binary_compressed"]),
    st.sampled_from([np.float32, np.float64]),
)
def test_pcd(rows: list[tuple[float, ...]], encoding: str, kind: type) -> None:
    colors = np.arange(len(rows), dtype=np.uint32) * 0x0A0B0C
    normals = np.array(rows, dtype=np.float32).T
    columns = (*np.array(rows, dtype=kind).T, colors.view(np.float32), colors.astype(np.uint16), *normals)
    fields = ("x", "y", "z", "rgb", "ring", "normal_x", "normal_y", "normal_z")
    kinds = (*[kind] * 3, np.float32, np.uint16, *[np.float32] * 3)
    file = io.BytesIO()
    with peers_may_warn():
        PcdCloud.from_points(columns, fields, kinds).save(file, Encoding(encoding))
        theirs = PcdCloud.from_fileobj(io.BytesIO(file.getvalue()))
    ours = PARSERS[".pcd"](file.getvalue())
    np.testing.assert_array_equal(ours.points, theirs.numpy(fields[:3]))
    np.testing.assert_array_equal(ours.normals, theirs.numpy(fields[5:]))
    if encoding != "ascii":  # whose digits do not hold a colour
        unpacked = np.stack([colors >> 16 & 255, colors >> 8 & 255, colors & 255], axis=1)
        np.testing.assert_array_equal(ours.colors, unpacked)


@given(st.lists(st.tuples(*[st.floats()] * 4), min_size=1, max_size=20), st.sampled_from(" ,;\t"))
def test_text(rows: list[tuple[float, ...]], separator: str) -> None:
    text = "# x y z\n" + "\n".join(separator.join(map(repr, row)) for row in rows)
    np.testing.assert_array_equal(PARSERS[".xyz"](text.encode()).points, np.array(rows)[:, :3])


@settings(max_examples=30)
@given(meshes(), st.booleans())
def test_own_files(tmp_path_factory: pytest.TempPathFactory, mesh: Mesh, more: bool) -> None:
    points, faces = mesh
    colors = np.arange(3 * len(points), dtype=np.uint8).reshape(-1, 3)
    normals = np.float64(np.float32(points / 1e300))
    cloud = PointCloud(points, normals, faces, colors) if more else PointCloud(points)
    path = tmp_path_factory.mktemp("own") / "a.ply"
    write_cloud(path, cloud)
    read = read_cloud(path)
    for name in ("points", "normals", "faces", "colors"):
        np.testing.assert_array_equal(getattr(read, name), getattr(cloud, name))
    np.testing.assert_array_equal(load(path.read_bytes(), "ply").vertices, points)


@pytest.mark.parametrize(
    "name",
    [
        "b3r/models/bunny.ply",
        "u3or/models/cheff_small.ply",
        "lidar/small_gicp_source.ply",
        "threedmatch/7-scenes-redkitchen/cloud_bin_7.pcd",
    ],
)
def test_published_files(name: str) -> None:
    path = shared_file(f"data/{name}")
    cloud = PARSERS[path.suffix](path.read_bytes())
    if path.suffix == ".pcd":
        expected = PcdCloud.from_path(path).numpy(("x", "y", "z"))
    else:
        theirs = load(path.read_bytes(), "ply")
        expected = theirs.vertices
        np.testing.assert_array_equal(cloud.faces, getattr(theirs, "faces", None))
    np.testing.assert_array_equal(cloud.points, expected)


def test_polygons_are_cut_as_trimesh_cuts_them() -> None:
    text = b"OFF\n5 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 2 0\n4 0 1 2 3\n4 4 3 2 1\n"
    # Its triangles may begin with another corner, and follow in another order.
    turned = [
        sorted(tuple(np.roll(face, -int(np.argmin(face)))) for face in faces)
        for faces in (PARSERS[".off"](text).faces, load(text, "off").faces)
    ]
    assert turned[0] == turned[1]
