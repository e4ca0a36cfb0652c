"""Scans with a pose, meshes with nodes, depth images: E57, PTX, glTF, PNG; and writing, bit by bit."""

import base64
import json
import os
import struct
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from cloud_files import CLOUDS, E57, FACES, MESH, PTX, TETRAHEDRON, png
from e57_files import FLOAT, SINGLE, e57, integer, pose, scaled, seal
from gltf_files import document, glb, gltf, mesh
from pypcd4 import PointCloud as PcdCloud

from cgroup import features
from cgroup.datasets import standin_pair
from cgroup.errors import InputError
from cgroup.io import PointCloud, read_cloud, read_depth, write_cloud
from cgroup.registration import prepare, register

HALF = 0.5**0.5
TURNED = [[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]  # by 90 degrees about z


@pytest.fixture
def read(tmp_path: Path) -> Callable[[str, bytes], PointCloud]:
    def write_and_read(name: str, content: bytes) -> PointCloud:
        (tmp_path / name).write_bytes(content)
        return read_cloud(tmp_path / name)

    return write_and_read


def refuse(read: Callable[..., object], name: str, content: bytes, says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        read(name, content)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 400


Read = Callable[[str, bytes], PointCloud]

# --- writing ---------------------------------------------------------------------------------


def full_cloud(count: int = 50) -> PointCloud:
    rng = np.random.default_rng(3)
    colors = rng.integers(0, 256, (count, 3)).astype(np.uint8)
    faces = rng.integers(0, count, (9, 3))
    place = np.array([1.0, -2.5, 1 / 3])
    return PointCloud(rng.normal(size=(count, 3)), rng.normal(size=(count, 3)), faces, colors, 0, place)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_we_and_others_read_what_is_written(dtype: Any, tmp_path: Path) -> None:
    cloud = full_cloud()
    ply, pcd = tmp_path / "a.ply", tmp_path / "a.pcd"
    for path in (ply, pcd):
        write_cloud(path, cloud, dtype=dtype)
    theirs = PcdCloud.from_path(pcd)
    assert theirs.metadata.viewpoint == (1.0, -2.5, 1 / 3, 1.0, 0.0, 0.0, 0.0)
    assert theirs.types[0] == np.dtype(dtype)
    mesh = trimesh.load(ply, process=False)
    np.testing.assert_array_equal(mesh.faces, cloud.faces)
    np.testing.assert_array_equal(read_cloud(ply).faces, cloud.faces)
    np.testing.assert_array_equal(read_cloud(pcd).viewpoint, cloud.viewpoint)
    of_pcd = (
        theirs.numpy(("x", "y", "z")),
        theirs.numpy(("normal_x", "normal_y", "normal_z")),
        PcdCloud.decode_rgb(theirs.numpy(("rgb",)).astype(np.float32).reshape(-1)),
    )
    of_ply = mesh.vertices, mesh.vertex_normals, mesh.visual.vertex_colors[:, :3]
    ours = [(again.points, again.normals, again.colors) for again in map(read_cloud, (ply, pcd))]
    for points, normals, colors in (of_pcd, of_ply, *ours):
        np.testing.assert_array_equal(points, cloud.points.astype(dtype))
        np.testing.assert_array_equal(normals, cloud.normals.astype(dtype))
        np.testing.assert_array_equal(colors, cloud.colors)


def test_single_precision_loses_no_digits_without_a_word(tmp_path: Path) -> None:
    far = full_cloud().points * 50 + [500_000, 5_000_000, 300]
    with pytest.raises(InputError, match=r"dtype: got float32, which moves points by up to 0\.2.*float64"):
        write_cloud(tmp_path / "a.pcd", far, dtype="float32")
    with pytest.raises(InputError, match="by up to inf"):
        write_cloud(tmp_path / "a.pcd", [[0, 0, 0], [1e300, 0, 0]], dtype="float32")
    assert not (tmp_path / "a.pcd").exists()
    write_cloud(tmp_path / "a.pcd", far)
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.pcd").points, far)
    # What is of single precision already loses nothing, wherever it lies.
    single = far.astype(np.float32)
    write_cloud(tmp_path / "a.ply", single, dtype="float32")
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.ply").points, single)
    write_cloud(tmp_path / "a.ply", PointCloud(np.full((2, 3), np.nan)), dtype="float32")


def test_wrong_clouds_are_not_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"dtype: got 'f4'; choose one of float64, float32"):
        write_cloud(tmp_path / "a.ply", TETRAHEDRON, dtype="f4")  # type: ignore[arg-type]
    for name in ("a.ply", "a.pcd", "a.e57"):
        with pytest.raises(InputError, match=r"3 values of normals for 4 points"):
            write_cloud(tmp_path / name, PointCloud(TETRAHEDRON, np.zeros((3, 3))))
        with pytest.raises(InputError, match=r"normals: got shape \[4, 2\]; give \(N,3\)"):
            write_cloud(tmp_path / name, PointCloud(TETRAHEDRON, np.zeros((4, 2))))
        with pytest.raises(InputError, match=r"colors: got shape \[4\]; give \(N,3\)"):
            write_cloud(tmp_path / name, PointCloud(TETRAHEDRON, colors=np.zeros(4, np.uint8)))
        assert not (tmp_path / name).exists()
    for faces, reason in (
        ([[0, 1, -1]], "point -1"),
        ([[0, 1, 4]], "point 4"),
        ([[0, 1, 2, 3]], r"shape \[1, 4\]"),
    ):
        with pytest.raises(InputError, match=f"faces: got .*{reason}"):
            write_cloud(tmp_path / "a.ply", PointCloud(TETRAHEDRON, faces=np.array(faces)))


# --- thinning --------------------------------------------------------------------------------


def test_voxels_keep_normals_and_colors(tmp_path: Path) -> None:
    cloud = full_cloud(500)
    voxels = features.voxel_downsample(cloud, 0.8)
    alone = features.voxel_downsample(cloud.points, 0.8, normals=cloud.normals)
    np.testing.assert_array_equal(voxels.points, alone.points)
    np.testing.assert_array_equal(voxels.normals, alone.normals)
    assert alone.colors is None
    means = [cloud.colors[voxels.indices == row].astype(float).mean(axis=0) for row in range(len(voxels))]
    np.testing.assert_array_equal(voxels.colors, np.rint(means))
    write_cloud(tmp_path / "a.pcd", cloud)
    again = features.voxel_downsample(tmp_path / "a.pcd", 0.8)
    np.testing.assert_array_equal(again.colors, voxels.colors)
    write_cloud(tmp_path / "again.pcd", again)
    np.testing.assert_array_equal(read_cloud(tmp_path / "again.pcd").colors, voxels.colors)
    with pytest.raises(InputError, match="4 for 500 points"):
        features.voxel_downsample(PointCloud(cloud.points, colors=cloud.colors[:4]), 0.8)


def test_colors_of_other_libraries_are_written(tmp_path: Path) -> None:
    colors = np.array([[255, 0, 7, 255]] * 4, np.uint8)
    write_cloud(tmp_path / "a.ply", trimesh.PointCloud(TETRAHEDRON, colors=colors))
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.ply").colors, colors[:, :3])

    class Cloud:  # as Open3D's
        points = TETRAHEDRON
        colors = TETRAHEDRON[:, [2, 0, 1]] / 3.1

    write_cloud(tmp_path / "a.pcd", Cloud())
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.pcd").colors, np.rint(255 * Cloud.colors))
    Cloud.colors = Cloud.colors[:2]
    write_cloud(tmp_path / "a.pcd", Cloud())
    assert read_cloud(tmp_path / "a.pcd").colors is None


# --- where the scanner stood -----------------------------------------------------------------


def test_viewpoints_of_files_are_taken(tmp_path: Path) -> None:
    pair = standin_pair(pixels=45)
    points = pair.source.points
    away = np.eye(4)
    away[:3, 3] = [7, 8, 9]  # the origin can't be told from a place that isn't known
    cloud = PointCloud(points, viewpoint=np.zeros(3)).transformed(away)
    for name in ("a.ply", "a.pcd"):
        write_cloud(tmp_path / name, cloud)
    assert prepare(tmp_path / "a.ply").viewpoint is None
    known = tmp_path / "a.pcd"
    assert prepare(known).viewpoint == (7, 8, 9)
    assert prepare(known, viewpoint=(1, 2, 300)).viewpoint == (1, 2, 300)
    given, taken = (register(source, pair.target) for source in (prepare(known), known))
    np.testing.assert_array_equal(taken.T_target_source, given.T_target_source)
    # What can't be meant is as though it wasn't there; that of a whole model isn't asked for.
    assert prepare(PointCloud(cloud.points, viewpoint=np.full(3, 1e9))).viewpoint is None
    normals = cloud.points / np.linalg.norm(cloud.points, axis=1, keepdims=True)
    model = PointCloud(cloud.points, normals, viewpoint=cloud.viewpoint)
    assert prepare(model, normals="given").viewpoint is None
    with pytest.raises(InputError, match=r"cloud\.viewpoint"):
        prepare(PointCloud(cloud.points, viewpoint=np.zeros(2)))


# --- PTX -------------------------------------------------------------------------------------


def test_ptx(read: Read) -> None:
    cloud = read("a.ptx", PTX)
    np.testing.assert_array_equal(cloud.viewpoint, [10, 20, 30])
    np.testing.assert_array_equal(cloud.colors, FACES)
    turned = PTX.replace(b"1 0 0 0\n0 1 0 0\n", b"0 1 0 0\n-1 0 0 0\n").replace(b"10 20 30 1", b"0 0 5 1")
    empty = turned.replace(b"-10 -20 -30", b"0 0 0")
    both = read("a.ptx", PTX + empty)
    assert (len(both), both.dropped, both.viewpoint) == (7, 1, None)
    expected = (TETRAHEDRON - [10, 20, 30]) @ np.transpose(TURNED) + [0, 0, 5]
    np.testing.assert_array_equal(both.points[4:], expected[1:])
    refuse(read, "a.ptx", PTX.replace(b"2\n2\n", b"2\n2000000000\n", 1), "points: got 4000000000 of at least")
    refuse(read, "a.ptx", PTX.replace(b"2\n2\n", b"2\n3\n", 1), "the end of the file")


# --- E57 -------------------------------------------------------------------------------------

XYZ = {name: (FLOAT, TETRAHEDRON[:, i]) for i, name in enumerate(("cartesianX", "cartesianY", "cartesianZ"))}
COLORS = ("colorRed", "colorGreen", "colorBlue")


@pytest.mark.parametrize("bits", [0, 1, 7, 8, 13, 24, 31, 32, 33, 57, 58, 63, 64])
@pytest.mark.parametrize("size", [3, 1000])
def test_integers_of_any_width(bits: int, size: int, read: Read) -> None:
    rng = np.random.default_rng(bits)
    least = -(2**63) if bits == 64 else -1234
    stored = [least + int.from_bytes(rng.bytes(8), "little") % 2**bits for _ in range(60)]
    stored[:2] = [least, least + 2**bits - 1]
    kind = 'type="Integer"' if bits == 64 else scaled(bits, 0.5, 7.0, least)
    cloud = read("a.e57", e57(({**XYZ_OF(60), "cartesianX": (kind, stored)}, ""), size=size))
    exact = [float(value) if bits == 64 else float(value) * 0.5 + 7 for value in stored]
    np.testing.assert_array_equal(cloud.points[:, 0], exact)
    np.testing.assert_array_equal(cloud.points[:, 1], np.arange(60))


def XYZ_OF(count: int) -> dict[str, tuple[str, Any]]:  # noqa: N802 - as XYZ
    return {name: (SINGLE, np.arange(count)) for name in XYZ}


def test_e57(read: Read) -> None:
    stored = ([0, 1, 254, 255], [9, 9, 9, 9], [0, 0, 0, 3])
    colors = {name: (integer(0, 255), values) for name, values in zip(COLORS, stored, strict=True)}
    normals = {
        f"nor:normal{axis}": (SINGLE, column) for axis, column in zip("XYZ", np.eye(4)[:3], strict=True)
    }
    states = {"cartesianInvalidState": (integer(0, 2), [0, 0, 2, 1])}
    turn = pose(1, 2, 3, (HALF, 0, 0, HALF))
    cloud = read("a.e57", e57((XYZ | colors | normals | states, turn)))
    np.testing.assert_allclose(cloud.points, TETRAHEDRON[:2] @ np.transpose(TURNED) + [1, 2, 3])
    np.testing.assert_allclose(cloud.normals, np.eye(3)[:2] @ np.transpose(TURNED), atol=1e-15)
    np.testing.assert_array_equal(cloud.colors, [[0, 9, 0], [1, 9, 0]])
    np.testing.assert_allclose(cloud.viewpoint, [1, 2, 3])
    assert cloud.dropped == 2
    # Several scans; what one of them lacks is left out, and so is the place of those that differ.
    both = read("a.e57", e57((XYZ | colors, turn), (XYZ, ""), (XYZ_OF(30), pose(0, 0, 9))))
    assert (len(both), both.colors, both.viewpoint) == (38, None, None)
    np.testing.assert_array_equal(both.points[4:8], TETRAHEDRON)
    np.testing.assert_array_equal(both.points[-1], [29, 29, 38])
    same = read("a.e57", e57((XYZ, turn), (XYZ, turn)))
    np.testing.assert_array_equal(same.viewpoint, [1, 2, 3])
    assert read("a.e57", e57((XYZ, pose(0, 0, 0)))).viewpoint is None
    # Colours between limits: those of the scan, or those of the fields.
    deep = {name: (integer(0, 65535), [0, 257, 65535, 32896]) for name in colors}
    np.testing.assert_array_equal(read("a.e57", e57((XYZ | deep, ""))).colors[:, 0], [0, 1, 255, 128])
    limits = "".join(f"<{n}Minimum/><{n}Maximum>4095</{n}Maximum>" for n in COLORS)
    half = {name: (integer(0, 65535), [0, 4095, 5000, 2048]) for name in colors}
    cloud = read("a.e57", e57((XYZ | half, f"<colorLimits>{limits}</colorLimits>")))
    np.testing.assert_array_equal(cloud.colors[:, 0], [0, 255, 255, 128])


def test_spherical_coordinates(read: Read) -> None:
    polar = {
        "sphericalRange": (FLOAT, [2.0, 2.0, 3.0]),
        "sphericalAzimuth": (FLOAT, [0.0, np.pi / 2, 0.0]),
        "sphericalElevation": (FLOAT, [np.pi / 2, 0.0, 0.0]),
        "sphericalInvalidState": (integer(0, 2), [0, 0, 1]),
    }
    cloud = read("a.e57", e57((polar, "")))
    np.testing.assert_allclose(cloud.points, [[0, 0, 2], [0, 2, 0]], atol=1e-15)
    assert cloud.dropped == 1


def test_e57_as_libe57_has_it(tmp_path: Path) -> None:
    pye57 = pytest.importorskip("pye57", reason="pye57 isn't installed")
    rng = np.random.default_rng(0)
    with pye57.E57(str(tmp_path / "theirs.e57"), mode="w") as file:
        for count in (5, 20_000):
            data = {name: rng.normal(size=count) for name in XYZ}
            data |= {name: rng.integers(0, 256, count).astype(np.uint8) for name in COLORS}
            turn = rng.normal(size=4)
            file.write_scan_raw(data, rotation=turn / np.linalg.norm(turn), translation=rng.normal(size=3))
    ours = tmp_path / "ours.e57"
    fields = {
        **XYZ_OF(3000),
        "cartesianY": (scaled(21, 0.001, 5.0), rng.integers(0, 2**21, 3000)),
        "cartesianInvalidState": (integer(0, 2), np.arange(3000) % 3 // 2),
    }
    ours.write_bytes(e57((fields, pose(1, 2, 3, (HALF, HALF, 0, 0))), size=900))
    for path in (ours, tmp_path / "theirs.e57"):
        with pye57.E57(str(path)) as file:
            scans = [
                file.read_scan(row, colors=path != ours, ignore_missing_fields=True)
                for row in range(file.scan_count)
            ]
        cloud = read_cloud(path)
        points = np.concatenate([np.stack([scan[name] for name in XYZ], axis=1) for scan in scans])
        np.testing.assert_allclose(cloud.points, points, rtol=1e-12, atol=1e-12)
        if path != ours:
            colors = np.concatenate([np.stack([scan[name] for name in COLORS], axis=1) for scan in scans])
            np.testing.assert_array_equal(cloud.colors, colors)


def replace_in(file: bytes, *changes: tuple[bytes, bytes]) -> bytes:
    """Replace parts of an E57 file by others of the same length."""
    plain = b"".join(file[i : i + 1020] for i in range(0, len(file), 1024))
    for before, after in changes:
        assert before in plain
        plain = plain.replace(before, after.ljust(len(before)))
    return seal(b"".join(plain[i : i + 1020] + bytes(4) for i in range(0, len(plain), 1020)))


def test_damaged_e57_says_why(read: Read) -> None:
    for place in (60, 700, len(E57) - 3):
        damaged = bytearray(E57)
        damaged[place] ^= 4
        says = f"page {place // 1024} does not match its checksum.*copy it again"
        refuse(read, "a.e57", bytes(damaged), says)
    assert replace_in(E57) == E57
    for before, after, says in (
        (b'recordCount="4"', b'recordCount="5"', "bytes for 5 points"),
        (b'recordCount="4"', b'recordCount=""', "invalid literal"),
        (b"cartesianZ ", b"cartesianQ ", "no points"),
        (b'<?xml version="1.0"', b"<!DOCTYPE a><a>", "document type"),
        (b'fileOffset="48"', b'fileOffset="99"', "from byte"),
        (b'type="Float">1</x>', b'type="Float">x</x>', "could not convert"),
        (b'<w type="Float">1</w>', b'<w type="Float">3</w>', "quaternion"),
    ):
        refuse(read, "a.e57", replace_in(E57, (before, after)), says)
    refuse(read, "a.e57", e57(({**XYZ, "cartesianX": (integer(5, 4), [5] * 4)}, "")), "from 5 to 4")
    refuse(read, "a.e57", E57[:8] + b"\2" + E57[9:], "version 2")
    refuse(read, "a.e57", E57[:-1], "bytes")


def test_e57_that_promises_much_takes_little(read: Read) -> None:
    nothing = {name: (integer(7, 7), [7]) for name in XYZ}
    assert len(read("a.e57", e57((nothing, "")))) == 1
    many = {name: (integer(7, 7), np.broadcast_to(7, 10**9)) for name in XYZ}
    refuse(read, "a.e57", e57((many, "")), "its points would grow from 1024 to 24000000000 bytes")
    # Records without bits take no bytes, so that their fields have to be few.
    fields = XYZ | {
        f"{name[:-1]}{i}": (integer(7, 7), [7] * 4) for i in range(500) for name in ["cartesian0"]
    }
    assert len(read("a.e57", e57((fields, ""), size=900))) == 4
    names = [f"colorRe{chr(97 + i)}" for i in range(26)]
    repeated = e57((dict.fromkeys(names, nothing["cartesianX"]) | nothing, ""))
    again = replace_in(repeated, *((f"<{name} ".encode(), b"<colorRed ") for name in names))
    refuse(read, "a.e57", again, "a scan with several fields colorRed")
    deep = "<q>" * 100_000 + "</q>" * 100_000
    assert len(read("a.e57", e57((XYZ, deep)))) == 4


def test_scans_without_points_are_left_out(read: Read) -> None:
    empty = {name: (FLOAT, []) for name in XYZ}
    refuse(read, "a.e57", e57((empty, "")), "holds no points")
    # Nothing need be where the records would be, as libE57's ZeroPoints.e57 has it.
    zero = (b'recordCount="4"', b'recordCount="0"'), (b'fileOffset="48"', b'fileOffset="0"')
    refuse(read, "a.e57", replace_in(E57, *zero), "a.e57: holds no points")
    colors = dict.fromkeys(COLORS, (integer(0, 255), [1] * 4))
    cloud = read("a.e57", e57((XYZ | colors, pose(1, 2, 3)), (empty, "")))
    assert len(cloud) == 4
    np.testing.assert_array_equal(cloud.colors, np.ones((4, 3)))
    np.testing.assert_array_equal(cloud.viewpoint, [1, 2, 3])


# --- glTF ------------------------------------------------------------------------------------


def test_gltf_as_trimesh_has_it(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    scene, matrices = trimesh.Scene(), trimesh.transformations
    ball = trimesh.creation.icosphere(1)
    ball.visual.vertex_colors = rng.integers(0, 256, (len(ball.vertices), 4)).astype(np.uint8)
    for turn in (np.eye(4), matrices.random_rotation_matrix(rng.random(3)), np.diag([2, 3, -1, 1])):
        scene.add_geometry(ball, transform=matrices.translation_matrix(rng.normal(size=3)) @ turn)
    scene.export(tmp_path / "a.glb", include_normals=True)
    for file, content in scene.export(file_type="gltf", include_normals=True).items():
        (tmp_path / file.replace("model", "a")).write_bytes(content)
    for name in ("a.glb", "a.gltf"):
        cloud = read_cloud(tmp_path / name)
        parts = trimesh.load(tmp_path / name, process=False).dump()
        triangles = np.concatenate([part.triangles for part in parts])
        ours = cloud.points[cloud.faces]
        order, theirs = (np.lexsort(np.sort(t, axis=1).mean(axis=1).round(9).T) for t in (ours, triangles))
        np.testing.assert_allclose(
            np.sort(ours[order], axis=1), np.sort(triangles[theirs], axis=1), rtol=1e-6, atol=1e-6
        )
        assert cloud.colors is not None
        # Triangles and normals both look outwards, also where a node mirrors.
        normals = np.cross(ours[:, 1] - ours[:, 0], ours[:, 2] - ours[:, 0])
        assert (np.einsum("ij,ij->i", normals, cloud.normals[cloud.faces[:, 0]]) > 0).all()
        np.testing.assert_allclose(np.linalg.norm(cloud.normals, axis=1), 1)


SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")


def test_primitives_and_nodes(read: Read) -> None:
    strip, fan = ([[0, 1, 2], [1, 3, 2]], [[1, 2, 0], [2, 3, 0]])
    for mode, faces in ((4, [[0, 1, 2]]), (5, strip), (6, fan), (0, None), (1, None)):
        cloud = read("a.glb", glb(*document(SQUARE, meshes=mesh({"POSITION": 0}, mode=mode))))
        np.testing.assert_array_equal(cloud.points, SQUARE)
        assert (cloud.faces is None) == (faces is None)
        if faces is not None:
            np.testing.assert_array_equal(cloud.faces, faces)
    # Two primitives that share their points have them once; children follow their parents.
    shared = mesh({"POSITION": 0}, indices=1)
    shared[0]["primitives"] *= 2
    nodes = [
        {"children": [1], "translation": [0, 0, 5], "rotation": [0, 0, HALF, HALF], "scale": [2, 2, 2]},
        {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 1]},
        {"mesh": 0},
    ]
    content = document(SQUARE, np.arange(3, dtype="<u1"), meshes=shared, nodes=nodes)
    cloud = read("a.gltf", gltf(*content))
    np.testing.assert_array_equal(cloud.faces, [[0, 1, 2]] * 2 + [[4, 5, 6]] * 2)
    np.testing.assert_allclose(
        cloud.points[:4], 2 * np.add(SQUARE, [1, 0, 0]) @ np.transpose(TURNED) + [0, 0, 5], atol=1e-14
    )
    np.testing.assert_array_equal(cloud.points[4:], SQUARE)
    content[0].update(scene=1, scenes=[{"nodes": [0]}, {"nodes": [2]}])
    np.testing.assert_array_equal(read("a.gltf", gltf(*content)).points, SQUARE)


def test_numbers_of_gltf(read: Read) -> None:
    colors = np.array([[0, 65535, 32768, 9]] * 4, "<u2")
    entries, content = document(SQUARE, colors, meshes=mesh({"POSITION": 0, "COLOR_0": 1}, mode=0))
    entries["accessors"][1]["normalized"] = True
    np.testing.assert_array_equal(read("a.glb", glb(entries, content)).colors, [[0, 255, 128]] * 4)
    # Interleaved, quantized, sparse, and zeros.
    whole = np.zeros(4, [("position", "<i2", 4), ("color", "u1", 4)])
    whole["position"][:, :3], whole["color"] = 3 * SQUARE, [1, 2, 3, 4]
    entries, content = document(whole.view("<u1").reshape(-1), np.array([2], "<u1"), np.ones((1, 3), "<i2"))
    entries["bufferViews"][0]["byteStride"] = whole.itemsize
    quantized = {"bufferView": 0, "componentType": 5122, "count": 4, "type": "VEC3"}
    color = {"bufferView": 0, "byteOffset": 8, "componentType": 5121, "count": 4, "type": "VEC4"}
    color["normalized"] = True
    entries["accessors"] = [quantized, color]
    entries["meshes"] = mesh({"POSITION": 0, "COLOR_0": 1}, mode=0)
    cloud = read("a.glb", glb(entries, content))
    np.testing.assert_array_equal(cloud.points, 3 * SQUARE)
    np.testing.assert_array_equal(cloud.colors, [[1, 2, 3]] * 4)
    places = {"bufferView": 1, "componentType": 5121}
    quantized["sparse"] = {"count": 1, "indices": places, "values": {"bufferView": 2}}
    np.testing.assert_array_equal(read("a.glb", glb(entries, content)).points[2], [1, 1, 1])
    del quantized["bufferView"]
    np.testing.assert_array_equal(
        read("a.glb", glb(entries, content)).points, [[0] * 3, [0] * 3, [1] * 3, [0] * 3]
    )
    quantized["count"] = 10**12
    refuse(read, "a.glb", glb(entries, content), "bytes that would grow")


def changed(change: Callable[[dict[str, Any]], object]) -> bytes:
    entries = json.loads(json.dumps(MESH[0]))
    change(entries)
    return glb(entries, MESH[1])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d["nodes"].append({"children": [0, 0]}), "two parents"),
        (lambda d: d.update(nodes=[{"children": [0]}], scenes=[{"nodes": [0]}]), "two parents, or itself"),
        (lambda d: d["nodes"].append({"mesh": -1}), "meshes: got entry -1; the file has 1"),
        (lambda d: d["accessors"][0].update(count=5), "5 rows from byte 0 on in 48 of 48 bytes"),
        (lambda d: d["accessors"][0].update(count=-5), "count: got -5; a whole number"),
        (lambda d: d["accessors"][0].update(byteOffset=1), "rows from byte 1"),
        (lambda d: d["accessors"][0].update(componentType=5130), "component type: got 5130"),
        (lambda d: d["accessors"][0].update(type="SCALAR"), 'got "SCALAR"; VEC3 belongs there'),
        (lambda d: d["accessors"][1].update(componentType=5126, count=6), "a triangle that names point"),
        (lambda d: d["bufferViews"][0].update(byteLength=10**15), "of 1000000000000000 bytes"),
        (lambda d: d["bufferViews"][0].update(byteStride=10**15), "rows from byte 0"),
        (lambda d: d["buffers"][0].update(byteLength=10**15), "buffer 0: got"),
        (lambda d: d["buffers"][0].update(uri="other.bin"), "no .bin file beside it|no such file"),
        (lambda d: d["asset"].update(version="1.0"), 'version: got "1.0"; version 2 is read'),
        (lambda d: d["meshes"][0]["primitives"][0].update(extensions={"KHR_draco_mesh_compression": {}}), "Draco"),
        (lambda d: d["bufferViews"][0].update(extensions={"EXT_meshopt_compression": {}}), "meshopt"),
        (lambda d: d.update(nodes="abc"), "not a readable"),
        (lambda d: d["nodes"][0].update(matrix=[1, 2]), "not a readable"),
    ],
)  # fmt: skip
def test_damaged_gltf_says_why(change: Callable[[dict[str, Any]], object], says: str, read: Read) -> None:
    refuse(read, "a.glb", changed(change), says)


def test_chunks_are_checked(read: Read) -> None:
    many = document(np.zeros((5000, 3), "<f4"), meshes=mesh({"POSITION": 0}), nodes=[{"mesh": 0}] * 1000)
    refuse(read, "a.glb", glb(*many), "bytes that would grow")
    many = document(np.zeros((5000, 3), "<f4"), meshes=mesh({"POSITION": 0}, mode=5))
    many[0]["meshes"][0]["primitives"] *= 1000
    refuse(read, "a.glb", glb(*many), "bytes that would grow")
    whole = CLOUDS["mesh.glb"]
    for length in (len(whole) - 1, 25, 13):
        refuse(read, "a.glb", whole[:length], "bytes")
    refuse(read, "a.glb", whole[:12] + b"\xff" * 4 + whole[16:], "a chunk of 4294967295 bytes")
    refuse(read, "a.glb", whole[:4] + b"\3" + whole[5:], "version 3")
    refuse(read, "a.gltf", b"[" * 100_000, "not a readable GLTF file")


def test_buffers_lie_beside_the_file(tmp_path: Path, read: Read) -> None:
    secret = tmp_path / "secret.bin"
    secret.write_bytes(MESH[1])
    folder = tmp_path / "folder"
    (folder / "inner").mkdir(parents=True)
    (folder / "mesh one.bin").write_bytes(MESH[1])
    (folder / "inner" / "mesh.bin").write_bytes(MESH[1])
    (folder / "mesh.txt").write_bytes(MESH[1])

    def with_buffer(uri: str) -> PointCloud:
        entries = MESH[0] | {"buffers": [{"byteLength": len(MESH[1]), "uri": uri}]}
        return read("folder/a.gltf", json.dumps(entries).encode())

    np.testing.assert_array_equal(with_buffer("mesh%20one.bin").points, TETRAHEDRON)
    elsewhere = [
        "../secret.bin", "%2e%2e/secret.bin", "..\\secret.bin", str(secret), secret.as_uri(), "inner/mesh.bin", "mesh.txt",
        "https://example.org/mesh.bin", "..", ".bin/..", "C:mesh.bin",
    ]  # fmt: skip
    if os.name == "posix":
        (folder / "link.bin").symlink_to(secret)
        elsewhere.append("link.bin")
    for uri in elsewhere:
        with pytest.raises(InputError, match="is no .bin file beside it; put it there, or write GLB"):
            with_buffer(uri)
    with pytest.raises(InputError, match="no such file"):
        with_buffer("missing.bin")
    with pytest.raises(InputError, match="not a readable GLTF"):
        with_buffer("data:;base64,!!!")
    plain = base64.b64encode(MESH[1]).decode()
    assert len(with_buffer(f"data:;base64,{plain}")) == 4


# --- depth images ----------------------------------------------------------------------------

DEPTHS = np.array([[0, 1000, 2000], [5000, 65535, 1]], np.uint16)
CAMERA = (500.0, 400.0, 1.5, 0.5)


def test_depth_images(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(png(DEPTHS))
    np.save(tmp_path / "a.npy", DEPTHS)
    np.save(tmp_path / "real.npy", np.where(DEPTHS == 1, np.nan, DEPTHS) / 1000)
    matrix = [[500, 0, 1.5], [0, 400, 0.5], [0, 0, 1]]
    rows, columns = np.nonzero(DEPTHS)
    z = DEPTHS[rows, columns] / 1000
    expected = np.stack([(columns - 1.5) * z / 500, (rows - 0.5) * z / 400, z], axis=1)
    for name in ("a.png", "a.npy"):
        for camera in (CAMERA, matrix):
            cloud = read_depth(tmp_path / name, camera)
            np.testing.assert_array_equal(cloud.points, expected)
            np.testing.assert_array_equal(cloud.viewpoint, [0, 0, 0])
            assert cloud.dropped == 1
        tum = read_depth(tmp_path / name, CAMERA, scale=5000)
        np.testing.assert_allclose(tum.points, expected / 5)
    real = read_depth(tmp_path / "real.npy", CAMERA)
    np.testing.assert_array_equal(real.points, expected[:-1])
    assert real.dropped == 2


def test_wrong_depth_images_say_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(name: str, content: bytes, says: str) -> None:
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=says):
            read_depth(tmp_path / name, CAMERA)

    whole = png(DEPTHS)
    refused("a.png", png(DEPTHS, bits=8), "8 bits of colour type 0; a depth image has one channel of 16 bits")
    refused("a.png", png(DEPTHS, kind=2), "16 bits of colour type 2")
    refused("a.png", png(0 * DEPTHS), "none of its 6 pixels has a depth")
    refused("a.png", png(DEPTHS, size=(100_000, 100_000)), "its pixels would grow from")
    refused("a.png", b"hello", "doesn't begin as a PNG")
    refused("a.png", whole[:-1], r"not a readable PNG file, or cut off \(the end of the file\)")
    damaged = bytearray(whole)
    damaged[50] ^= 1
    refused("a.png", bytes(damaged), "byte 33 do not match their checksum.*copy it again")
    header = whole[8:33]
    larger = struct.pack(">I", 13) + b"IHDR" + struct.pack(">IIBBBBB", 10_000, 8000, 16, 0, 0, 0, 0)
    larger += struct.pack(">I", zlib.crc32(larger[4:]))
    refused("a.png", whole[:8] + header + larger + whole[33:], "not a readable PNG")
    refused("a.jpg", whole, "depth images are read from .png and .npy")
    np.save(tmp_path / "a.npy", np.zeros((2, 2, 3)))
    refused("a.npy", (tmp_path / "a.npy").read_bytes(), r"shape \(2, 2, 3\); a depth image has")
    for camera, says in (
        ((500, 500, 1), "intrinsics: got .500.0, 500.0, 1.0.; give fx, fy, cx, cy"),
        ((0, 500, 1, 1), "give fx"),
        ((500, np.nan, 1, 1), "give fx"),
        ([[500, 1, 1], [0, 500, 1], [0, 0, 1]], "give fx"),
        (np.eye(4), r"got shape \(4, 4\)"),
    ):
        with pytest.raises(InputError, match=says):
            read_depth(tmp_path / "a.png", camera)
    with pytest.raises(InputError, match="known are .*; `read_depth` reads depth images"):
        read_cloud(tmp_path / "a.png")
    with pytest.raises(InputError, match="scale"):
        read_depth(tmp_path / "a.png", CAMERA, scale=0)
    monkeypatch.setitem(sys.modules, "PIL", None)
    refused("a.png", whole, r"reading it needs PIL; pip install 'cgroup\[scans\]'")
