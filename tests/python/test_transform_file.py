"""Original files moved by a pose: attributes stay bit for bit, positions and directions are right."""

import json
import struct
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pye57
import pytest
from command_lines import fail, results_in, run, succeed, undocumented
from e57_files import FLOAT, e57, integer
from e57_files import pose as e57_pose
from gltf_files import glb
from hypothesis import given
from hypothesis import strategies as st
from las_files import UTM, fill_attributes, make_pose
from plyfile import PlyData, PlyElement
from pypcd4 import Encoding, PointCloud

from cgroup.errors import InputError
from cgroup.io import read_cloud, transform_file, write_transform
from cgroup.io._motion import _basis, rotate_harmonics
from cgroup.rigid import apply
from cgroup.rigid.transforms import scaling, turn
from cgroup.scenes.scene import format_poses


def check_moved(before: np.ndarray, after: np.ndarray, matrix: np.ndarray, share: float = 1e-6) -> None:
    expected = apply(matrix, np.asarray(before, float))
    extent = np.linalg.norm(np.ptp(expected, axis=0))
    assert np.abs(np.asarray(after, float) - expected).max() <= share * extent


def columns(records: Any, *names: str) -> np.ndarray:
    return np.stack([np.asarray(records[name], float) for name in names], axis=1)


def without_limits_of_normals(record: Any) -> bytes:
    """Return a record of LAS; the first three extra dimensions are normals, whose limits change."""
    content = bytearray(record.record_data_bytes())
    for k in range(3 if record.record_id == 4 else 0):
        content[192 * k + 64 : 192 * k + 112] = bytes(48)
    return bytes(content)


def las_file(path: Path, count: int = 1000, *, form: int = 7, extent: float = 80.0) -> laspy.LasData:
    rng = np.random.default_rng(1)
    header = laspy.LasHeader(point_format=form, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.array([1000.0, 2000.0, 0.0])
    for name, kind in (("NormalX", "f4"), ("NormalY", "f4"), ("NormalZ", "f4"), ("deviation", "u2")):
        header.add_extra_dim(laspy.ExtraBytesParams(name=name, type=kind))
    header.add_extra_dim(
        laspy.ExtraBytesParams("height", "i4", scales=np.array([0.01]), offsets=np.array([0.0]))
    )
    header.vlrs.append(laspy.VLR("cgroup_test", 7, "a record", b"content"))
    data = laspy.LasData(header)
    data.xyz = rng.uniform(0, extent, (count, 3)) + np.array([1000, 2000, 0])
    fill_attributes(data, rng)
    data.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR("cgroup_test", 8, "a later record", b"more" * 20_000)])
    data.write(path)
    return laspy.read(path)


@pytest.mark.parametrize("form", [0, 3, 6, 7, 8])
@pytest.mark.parametrize("suffixes", [(".las", ".las"), (".laz", ".laz"), (".las", ".laz"), (".laz", ".las")])
@pytest.mark.parametrize("scale", [1.0, 0.3048])
def test_las(tmp_path: Path, form: int, suffixes: tuple[str, str], scale: float) -> None:
    source, out = tmp_path / f"in{suffixes[0]}", tmp_path / f"out{suffixes[1]}"
    before, pose = las_file(source, form=form), make_pose(1, UTM)
    assert transform_file(source, pose, out, scale=scale) == []
    after = laspy.read(out)
    check_moved(before.xyz, after.xyz, pose @ scaling(scale))
    normals = [columns(one, "NormalX", "NormalY", "NormalZ") for one in (before, after)]
    np.testing.assert_allclose(normals[1], normals[0] @ pose[:3, :3].T, atol=1e-6)
    for name in before.points.array.dtype.names:
        if name not in {"X", "Y", "Z", "NormalX", "NormalY", "NormalZ"}:
            assert before.points.array[name].tobytes() == after.points.array[name].tobytes(), name
    for records in ("vlrs", "evlrs"):
        kept = [
            [(one.user_id, one.record_id, without_limits_of_normals(one)) for one in getattr(data, records)]
            for data in (before, after)
        ]
        assert kept[0] == kept[1]
    for name in ("uuid", "creation_date", "system_identifier", "file_source_id", "version", "point_count"):
        assert getattr(before.header, name) == getattr(after.header, name)
    check_moved(read_cloud(source).points, read_cloud(out).points, pose @ scaling(scale))


def test_small_las_files_get_a_finer_grid_and_wide_ones_a_coarser_one(tmp_path: Path) -> None:
    before = las_file(tmp_path / "in.las", extent=0.5)
    transform_file(tmp_path / "in.las", make_pose(2), tmp_path / "out.las")
    check_moved(before.xyz, laspy.read(tmp_path / "out.las").xyz, make_pose(2))
    header = laspy.LasHeader(point_format=0)
    header.scales = np.full(3, 1.0)
    wide = laspy.LasData(header)
    wide.points.array = np.zeros(2, wide.points.array.dtype)
    wide.points.array["X"], wide.points.array["Y"] = [-(2**31) + 1, 2**31 - 1], [-(2**31) + 1, 2**31 - 1]
    wide.write(tmp_path / "wide.las")
    half = np.eye(4)
    half[:2, :2] = np.array([[1, -1], [1, 1]]) / np.sqrt(2)
    assert "rounded to 10" in " ".join(transform_file(tmp_path / "wide.las", half, tmp_path / "out.las"))
    check_moved(laspy.read(tmp_path / "wide.las").xyz, laspy.read(tmp_path / "out.las").xyz, half)


def test_las_without_points_and_with_a_wrong_box(tmp_path: Path) -> None:
    empty = laspy.LasData(laspy.LasHeader(point_format=7))
    empty.write(tmp_path / "empty.laz")
    assert transform_file(tmp_path / "empty.laz", make_pose(0, UTM), tmp_path / "out.laz") == []
    assert len(laspy.read(tmp_path / "out.laz").points) == 0
    las_file(tmp_path / "in.las")
    content = bytearray((tmp_path / "in.las").read_bytes())
    struct.pack_into("<6d", content, 179, *[1e-7, 0] * 3)
    (tmp_path / "in.las").write_bytes(content)
    with pytest.raises(InputError, match=r"in\.las: .*outside the box"):
        transform_file(tmp_path / "in.las", make_pose(0), tmp_path / "bad.las")
    header = las_file(tmp_path / "in.las").header
    end = header.offset_to_point_data + 100 * header.point_format.size
    (tmp_path / "cut.las").write_bytes((tmp_path / "in.las").read_bytes()[:end])
    with pytest.raises(InputError, match=r"cut\.las: .*100 of 1000 points"):
        transform_file(tmp_path / "cut.las", make_pose(0), tmp_path / "bad.las")
    assert not (tmp_path / "bad.las").exists()


TYPES = ["i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"]


@st.composite
def layouts(draw: st.DrawFn) -> np.dtype:
    """Positions, maybe normals, among other properties, in any order."""
    real = st.sampled_from(["f4", "f8"])
    fields = [(name, draw(real)) for name in "xyz"]
    if draw(st.booleans()):
        fields += [(name, draw(real)) for name in ("nx", "ny", "nz")]
    fields += [(f"other_{k}", draw(st.sampled_from(TYPES))) for k in range(draw(st.integers(0, 6)))]
    return np.dtype(draw(st.permutations(fields)))


def fill(kind: np.dtype, count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    records = np.frombuffer(rng.bytes(count * kind.itemsize), kind).copy()
    for name in kind.names or ():
        if kind[name].kind == "f":
            records[name] = rng.normal(size=count)
    return records


def check_records(before: np.ndarray, after: np.ndarray, pose: np.ndarray, scale: float) -> None:
    check_moved(columns(before, *"xyz"), columns(after, *"xyz"), pose @ scaling(scale))
    moved = {*"xyz"}
    for names in (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z")):
        if {*names} <= {*(before.dtype.names or ())}:
            moved |= {*names}
            expected = columns(before, *names) @ pose[:3, :3].T
            np.testing.assert_allclose(columns(after, *names), expected, atol=1e-6)
    assert before.dtype.names == after.dtype.names
    for name in {*(before.dtype.names or ())} - moved:
        assert before[name].dtype.newbyteorder("=") == after[name].dtype.newbyteorder("="), name
        assert before[name].astype(after[name].dtype).tobytes() == after[name].tobytes(), name


@given(layouts(), st.integers(0, 30), st.integers(0, 99), st.sampled_from(["<", ">", ""]), st.booleans())
def test_ply(
    tmp_path_factory: pytest.TempPathFactory, kind: np.dtype, count: int, seed: int, order: str, far: bool
) -> None:
    folder = tmp_path_factory.mktemp("ply")
    before, pose = fill(kind, count + 2, seed), make_pose(seed, UTM if far else (1, 2, 3))
    cells = np.array([(np.arange(3), 5), (np.arange(4), 6)], [("indices", object), ("label", "u1")])
    elements = [
        PlyElement.describe(cells, name, len_types={"indices": "u1"}, val_types={"indices": "i4"})
        for name in ("strip", "face")
    ]
    file = PlyData(
        [elements[0], PlyElement.describe(before, "vertex"), elements[1]],
        text=not order,
        byte_order=order or "=",
        comments=["of a test"],
    )
    file.write(folder / "in.ply")
    notes = transform_file(folder / "in.ply", pose, folder / "out.ply", scale=2.5)
    after = PlyData.read(folder / "out.ply")
    check_records(before, after["vertex"].data, pose, 2.5)
    assert after.comments == ["of a test"]
    for name in ("strip", "face"):
        assert [list(row[0]) for row in after[name].data] == [[0, 1, 2], [0, 1, 2, 3]]
        assert after[name].data["label"].tolist() == [5, 6]
    single = any(kind[axis] == "f4" for axis in "xyz")
    assert [note.startswith("x y z: written in double") for note in notes] == [True] * (single and far)
    assert np.allclose(read_cloud(folder / "out.ply").points, columns(after["vertex"].data, *"xyz"))


def splats(degree: int, count: int = 40) -> np.ndarray:
    rest = 3 * ((degree + 1) ** 2 - 1)
    names = [*"xyz", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *(f"f_rest_{k}" for k in range(rest))]
    names += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    return fill(np.dtype([(name, "f4") for name in names]), count, degree)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_splats(tmp_path: Path, degree: int) -> None:
    before, pose, scale = splats(degree), make_pose(degree), 1.7
    PlyData([PlyElement.describe(before, "vertex")]).write(tmp_path / "in.ply")
    assert transform_file(tmp_path / "in.ply", pose, tmp_path / "out.ply", scale=scale) == []
    after = PlyData.read(tmp_path / "out.ply")["vertex"].data
    check_moved(columns(before, *"xyz"), columns(after, *"xyz"), pose @ scaling(scale))
    covariances = []
    for records in (before, after):
        w, x, y, z = (
            columns(records, *(f"rot_{k}" for k in range(4)))
            / np.linalg.norm(columns(records, *(f"rot_{k}" for k in range(4))), axis=1, keepdims=True)
        ).T
        axes = turn(x, y, z, w) * np.exp(columns(records, *(f"scale_{k}" for k in range(3))))[:, None]
        covariances.append(axes @ axes.transpose(0, 2, 1))
    expected = scale**2 * pose[:3, :3] @ covariances[0] @ pose[:3, :3].T
    np.testing.assert_allclose(covariances[1], expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())
    directions = np.random.default_rng(0).normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for color in range(3):
        seen = []
        for records, there in ((before, directions), (after, directions @ pose[:3, :3].T)):
            bases = [_basis(there, k) for k in range(1, degree + 1)]
            basis = np.concatenate([np.full((40, 1), 0.2820948), *bases], axis=1)
            more = (degree + 1) ** 2 - 1
            names = [f"f_dc_{color}", *(f"f_rest_{color * more + k}" for k in range(more))]
            seen.append((columns(records, *names) * basis).sum(axis=1))
        np.testing.assert_allclose(seen[1], seen[0], atol=1e-5)
    for name in ("opacity", "f_dc_0", "f_dc_1", "f_dc_2"):
        assert before[name].tobytes() == after[name].tobytes()


def test_harmonics_are_those_of_3d_gaussian_splatting() -> None:
    x, y, z = 0.36, -0.48, 0.8
    xx, yy, zz = x * x, y * y, z * z
    third = [
        -0.5900435899266435 * y * (3 * xx - yy),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (4 * zz - xx - yy),
        0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
        -0.4570457994644658 * x * (4 * zz - xx - yy),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3 * yy),
    ]
    second = [
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (2 * zz - xx - yy),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (xx - yy),
    ]
    for degree, expected in ((2, second), (3, third)):
        np.testing.assert_allclose(_basis(np.array([[x, y, z]]), degree)[0], expected, atol=1e-15)
        matrix = rotate_harmonics(make_pose(4)[:3, :3], degree)
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(2 * degree + 1), atol=1e-12)


@pytest.mark.parametrize("encoding", [Encoding.ASCII, Encoding.BINARY, Encoding.BINARY_COMPRESSED])
@pytest.mark.parametrize("away", [(1, 2, 3), UTM])
def test_pcd(tmp_path: Path, encoding: Encoding, away: Any) -> None:
    names = ("x", "y", "z", "intensity", "ring", "normal_x", "normal_y", "normal_z", "time")
    types = ("f4", "f4", "f4", "f4", "u2", "f4", "f4", "f4", "f8")
    before = np.tile(fill(np.dtype(list(zip(names, types, strict=True))), 30, 3), 10)
    pose = make_pose(6, away)
    before["ring"] %= 16
    cloud = PointCloud.from_points(
        [before[name] for name in names], names, [np.dtype(kind) for kind in types]
    )
    cloud.metadata.viewpoint = (1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0)
    cloud.save(tmp_path / "in.pcd", encoding)
    before = PointCloud.from_path(tmp_path / "in.pcd").pc_data  # ASCII has fewer digits
    notes = transform_file(tmp_path / "in.pcd", pose, tmp_path / "out.pcd", scale=2.0)
    after = PointCloud.from_path(tmp_path / "out.pcd")
    check_records(before, after.pc_data, pose, 2.0)
    assert any(note.startswith("x y z") for note in notes) == (away is UTM)
    assert any(note.startswith("compression") for note in notes) == (encoding is Encoding.BINARY_COMPRESSED)
    view = np.array(after.metadata.viewpoint)
    np.testing.assert_allclose(
        view[:3], apply(pose @ scaling(2.0), np.array([[1.0, 2.0, 3.0]]))[0], rtol=1e-9
    )
    w, x, y, z = view[3:]
    np.testing.assert_allclose(turn(x, y, z, w), pose[:3, :3], atol=1e-9)


def test_pcd_with_an_unknown_viewpoint_and_fields_of_several_numbers(tmp_path: Path) -> None:
    header = "# .PCD\nVERSION 0.7\nFIELDS x y z _ fpfh\nSIZE 4 4 4 1 4\nTYPE F F F U F\nCOUNT 1 1 1 4 3\nWIDTH 1\nHEIGHT 2\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA binary\n"
    body = struct.pack("<3f4B3f", 1, 2, 3, 9, 8, 7, 6, 0.5, 0.25, 0.125) * 2
    (tmp_path / "in.pcd").write_bytes(header.encode() + body[:-4] + b"\0\0\0\0")
    pose = np.eye(4)
    pose[:3, 3] = 1, 2, 4
    notes = transform_file(tmp_path / "in.pcd", pose, tmp_path / "out.pcd")
    assert [note.partition(":")[0] for note in notes] == ["x y z", "VIEWPOINT"]  # the points are one
    out = (tmp_path / "out.pcd").read_bytes()
    assert out.endswith(struct.pack("<3d", 2, 4, 7) + body[40:-4] + b"\0\0\0\0")


def test_e57(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    scans = []
    for more in (e57_pose(1, 2, 3, (0.5, 0.5, 0.5, 0.5)), ""):
        fields = {f"cartesian{axis}": (FLOAT, rng.normal(size=400)) for axis in "XYZ"}
        scans.append((fields | {"intensity": (integer(0, 1023), rng.integers(0, 1023, 400).tolist())}, more))
    (tmp_path / "in.e57").write_bytes(e57(*scans))
    pose = make_pose(3, UTM)
    assert transform_file(tmp_path / "in.e57", pose, tmp_path / "out.e57") == []
    check_moved(read_cloud(tmp_path / "in.e57").points, read_cloud(tmp_path / "out.e57").points, pose, 1e-8)
    transform_file(tmp_path / "out.e57", np.linalg.inv(pose), tmp_path / "back.e57")
    np.testing.assert_allclose(
        read_cloud(tmp_path / "back.e57").points, read_cloud(tmp_path / "in.e57").points, atol=1e-8
    )
    with pytest.raises(InputError, match="scale"):
        transform_file(tmp_path / "in.e57", pose, tmp_path / "no.e57", scale=2)
    content = bytearray((tmp_path / "in.e57").read_bytes())
    content[2000] ^= 1
    (tmp_path / "in.e57").write_bytes(content)
    with pytest.raises(InputError, match="checksum"):
        transform_file(tmp_path / "in.e57", pose, tmp_path / "no.e57")
    assert not (tmp_path / "no.e57").exists()


def test_e57_files_of_another_library(tmp_path: Path) -> None:
    rng, pose = np.random.default_rng(0), make_pose(3, UTM)
    file = pye57.E57(str(tmp_path / "in.e57"), mode="w")
    fields = {f"cartesian{axis}": rng.normal(size=3000) for axis in "XYZ"} | {
        "intensity": rng.uniform(size=3000)
    }
    for k in range(3):
        file.write_scan_raw(
            fields, rotation=np.array([0.5, 0.5, -0.5, 0.5]), translation=np.array([k, 2.0, 3.0])
        )
    file.close()
    assert transform_file(tmp_path / "in.e57", pose, tmp_path / "out.e57") == []
    one, other = (pye57.E57(str(tmp_path / name)) for name in ("in.e57", "out.e57"))
    for k in range(3):
        before, after = one.read_scan_raw(k), other.read_scan_raw(k)
        assert all(before[name].tobytes() == after[name].tobytes() for name in fields)
        for name in ("guid", "pointFields", "intensityLimits"):
            assert str(getattr(one.get_header(k), name, None)) == str(
                getattr(other.get_header(k), name, None)
            )
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = other.get_header(k).rotation_matrix, other.get_header(k).translation
        first = np.eye(4)
        first[:3, :3], first[:3, 3] = one.get_header(k).rotation_matrix, one.get_header(k).translation
        np.testing.assert_allclose(matrix, pose @ first, rtol=1e-14, atol=1e-12)


def test_ptx(tmp_path: Path) -> None:
    scans = [make_pose(k, (k, 2, 3)) for k in range(2)]
    lines = []
    for scan in scans:
        lines += [
            "2",
            "1",
            " ".join(map(repr, scan[:3, 3].tolist())),
            *(" ".join(map(repr, row)) for row in scan[:3, :3].T.tolist()),
        ]
        lines += [" ".join(map(repr, row)) for row in scan.T.tolist()]
        lines += ["1.5 2.5 3.5 0.25 1 2 3", "0 1 0 0.5 4 5 6"]
    (tmp_path / "in.ptx").write_text("".join(f"{line}\r\n" for line in lines), newline="")
    pose = make_pose(9, UTM)
    assert transform_file(tmp_path / "in.ptx", pose, tmp_path / "out.ptx", scale=0.5) == []
    check_moved(
        read_cloud(tmp_path / "in.ptx").points,
        read_cloud(tmp_path / "out.ptx").points,
        pose @ scaling(0.5),
        1e-8,
    )
    after = (tmp_path / "out.ptx").read_bytes().decode().split("\r\n")
    assert after[10:12] == lines[10:12]
    np.testing.assert_allclose(
        [float(word) for word in after[2].split()], apply(pose @ scaling(0.5), scans[0][None, :3, 3])[0]
    )


def test_a_ptx_file_that_is_cut_off(tmp_path: Path) -> None:
    lines = ["2", "2", "0 0 0", *("1 0 0", "0 1 0", "0 0 1"), *("1 0 0 0", "0 1 0 0", "0 0 1 0", "0 0 0 1")]
    (tmp_path / "in.ptx").write_text("\n".join([*lines, "1 2 3 0.5", "1 2 3 0.5", "1 2 3 0.5"]))
    with pytest.raises(InputError, match="1 points before that of a scan"):
        transform_file(tmp_path / "in.ptx", np.eye(4), tmp_path / "out.ptx")
    assert not (tmp_path / "out.ptx").exists()


def test_list_elements_and_whole_numbers_of_ply(tmp_path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty int x\nproperty int y\nproperty int z\n"
    head += "element edge 1\nproperty list uchar int x\nproperty int y\nproperty int z\nend_header\n"
    (tmp_path / "in.ply").write_text(f"{head}0 0 0\n1 2 3\n1 7 8 9\n")
    notes = transform_file(tmp_path / "in.ply", make_pose(1), tmp_path / "out.ply")
    assert len(notes) == 1
    vertices, edges = (PlyData.read(tmp_path / "out.ply")[name].data for name in ("vertex", "edge"))
    expected = apply(make_pose(1), np.array([[0.0, 0, 0], [1, 2, 3]]))
    np.testing.assert_allclose(columns(vertices, *"xyz"), expected, rtol=1e-15, atol=1e-15)
    assert (list(edges["x"][0]), edges["y"].tolist(), edges["z"].tolist()) == ([7], [8], [9])


def test_normals_of_whole_numbers_stay_in_their_range(tmp_path: Path) -> None:
    kind = np.dtype([(name, "f4") for name in "xyz"] + [(name, "i1") for name in ("nx", "ny", "nz")])
    before = np.array([(0, 0, 0, 127, 127, 0), (1, 1, 1, 0, 0, 100)], kind)
    PlyData([PlyElement.describe(before, "vertex")]).write(tmp_path / "in.ply")
    quarter = np.eye(4)
    quarter[:2, :2] = np.array([[1, -1], [1, 1]]) / np.sqrt(2)
    transform_file(tmp_path / "in.ply", quarter, tmp_path / "out.ply")
    after = PlyData.read(tmp_path / "out.ply")["vertex"].data
    assert columns(after, "nx", "ny", "nz").tolist() == [[0, 127, 0], [0, 0, 100]]


@pytest.mark.parametrize("header", ["time,x,y,z\n", '"time","X","Y","Z"\n'])
def test_names_of_columns_count_where_rows_end_in_a_separator(tmp_path: Path, header: str) -> None:
    (tmp_path / "in.csv").write_text(f"{header}0.5,1,2,3,\n")
    pose = np.eye(4)
    pose[:3, 3] = 10, 20, 30
    assert transform_file(tmp_path / "in.csv", pose, tmp_path / "out.csv") == []
    assert (tmp_path / "out.csv").read_text() == f"{header}0.5,11.0,22.0,33.0,\n"


def test_a_gltf_file_without_its_buffer_leaves_no_output(tmp_path: Path) -> None:
    (tmp_path / "in.gltf").write_text(
        json.dumps({"asset": {"version": "2.0"}, "buffers": [{"uri": "lost.bin", "byteLength": 4}]})
    )
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match=r"in\.gltf: .*lost\.bin: no such file"):
        transform_file(tmp_path / "in.gltf", np.eye(4), tmp_path / "out" / "in.gltf")
    assert not [*(tmp_path / "out").iterdir()]


def test_meshes(tmp_path: Path) -> None:
    pose, matrix = make_pose(5), make_pose(5) @ scaling(3.0)
    (tmp_path / "in.obj").write_text(
        "# of a test\nmtllib a.mtl\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nvt 0.5 0.5\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\n"
    )
    assert transform_file(tmp_path / "in.obj", pose, tmp_path / "out.obj", scale=3.0) == [
        "a.mtl: not copied; materials are in separate files"
    ]
    before, after = read_cloud(tmp_path / "in.obj"), read_cloud(tmp_path / "out.obj")
    check_moved(before.points, after.points, matrix)
    np.testing.assert_array_equal(before.faces, after.faces)
    np.testing.assert_array_equal(before.colors, after.colors)
    (normal,) = [line for line in (tmp_path / "out.obj").read_text().splitlines() if line.startswith("vn")]
    np.testing.assert_allclose([float(word) for word in normal.split()[1:]], pose[:3, 2])
    kind = np.dtype([("numbers", "<f4", (4, 3)), ("attribute", "<u2")])
    triangles = fill(kind, 50, 0)
    triangles["numbers"] = np.random.default_rng(0).normal(size=(50, 4, 3))
    (tmp_path / "in.stl").write_bytes(
        b"solid but binary".ljust(80) + struct.pack("<I", 50) + triangles.tobytes()
    )
    assert transform_file(tmp_path / "in.stl", pose, tmp_path / "out.stl", scale=3.0) == []
    moved = np.frombuffer((tmp_path / "out.stl").read_bytes()[84:], kind)
    check_moved(triangles["numbers"][:, 1:].reshape(-1, 3), moved["numbers"][:, 1:].reshape(-1, 3), matrix)
    np.testing.assert_allclose(moved["numbers"][:, 0], triangles["numbers"][:, 0] @ pose[:3, :3].T, atol=1e-6)
    np.testing.assert_array_equal(moved["attribute"], triangles["attribute"])
    with pytest.raises(InputError, match="single precision"):
        transform_file(tmp_path / "in.stl", make_pose(5, UTM), tmp_path / "far.stl")
    (tmp_path / "text.stl").write_text(
        "solid a\n  facet normal 0 0 1\n    outer loop\n      vertex 0 0 0\n      vertex 1 0 0\n      vertex 0 1 0\n    endloop\n  endfacet\nendsolid a\n"
    )
    transform_file(tmp_path / "text.stl", pose, tmp_path / "moved.stl")
    check_moved(read_cloud(tmp_path / "text.stl").points, read_cloud(tmp_path / "moved.stl").points, pose)
    assert "      vertex " in (tmp_path / "moved.stl").read_text()


def test_gltf(tmp_path: Path) -> None:
    points = np.random.default_rng(0).normal(size=(9, 3)).astype("<f4")
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}, {"nodes": [0, 1]}],
        "nodes": [{"mesh": 0, "translation": [1, 2, 3]}, {"mesh": 0, "scale": [2, 2, 2]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 0}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 9, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 108}],
        "buffers": [{"byteLength": 108, "uri": "points.bin"}],
    }
    (tmp_path / "points.bin").write_bytes(points.tobytes())
    (tmp_path / "in.gltf").write_text(json.dumps(document))
    (tmp_path / "out").mkdir()
    transform_file(tmp_path / "in.gltf", make_pose(1), tmp_path / "out" / "moved.gltf", scale=2)
    check_moved(
        read_cloud(tmp_path / "in.gltf").points,
        read_cloud(tmp_path / "out" / "moved.gltf").points,
        make_pose(1) @ scaling(2),
    )
    del document["buffers"][0]["uri"]  # type: ignore[index]
    (tmp_path / "in.glb").write_bytes(glb(document, points.tobytes()))
    transform_file(tmp_path / "in.glb", make_pose(2), tmp_path / "out.glb")
    check_moved(read_cloud(tmp_path / "in.glb").points, read_cloud(tmp_path / "out.glb").points, make_pose(2))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.xyz", "2\n0.5 1 2 7 0.1000\n1 2 3 8 0.2000\n"),
        (
            "a.txt",
            "# made by hand\nx\ty\tz\tnx\tny\tnz\ttime\n1\t2\t3\t0\t0\t1\t007\n\n4\t5\t6\t1\t0\t0\t008\n",
        ),
        ("a.csv", "time,X,Y,Z,Nx,Ny,Nz\n0.10,1,2,3,0,0,1\n0.20,4,5,6,1,0,0"),
        ("a.asc", "//X Y Z Intensity\r\n1 2 3 010\r\n4 5 6 020\r\n"),
        ("a.xyzn", "1 2 3 0 0 1\n4 5 6 1 0 0\n"),
        ("a.pts", "2\n1 2 3 -200 1 2 3\n4 5 6 100 4 5 6\n"),
        ("a.csv", "1;2;3;x y\n4;5;6;w\n"),
    ],
)
def test_texts(tmp_path: Path, name: str, text: str) -> None:
    pose, source, out = make_pose(7, UTM), tmp_path / name, tmp_path / f"out{Path(name).suffix}"
    source.write_text(text, newline="")
    transform_file(source, pose, out)
    separator = next((one for one in ";,\t" if one in text), None)
    before, after = (
        [line.split(separator) for line in file.read_text().splitlines()] for file in (source, out)
    )
    named = next(([word.lower() for word in row] for row in before if "z" in map(str.lower, row)), None)
    normals = (
        [named.index(axis) for axis in ("nx", "ny", "nz")]
        if named and "nx" in named
        else [3, 4, 5]
        if name.endswith("xyzn")
        else []
    )
    places = [named.index(axis) for axis in "xyz"] if named and "//X" not in text else [0, 1, 2]
    rows = [k for k, row in enumerate(before) if len(row) >= 4 and row[0][0].isdigit()]
    assert len(rows) == 2
    numbers = [
        np.array([[float(table[k][c]) for c in (*places, *normals)] for k in rows])
        for table in (before, after)
    ]
    np.testing.assert_allclose(numbers[1][:, :3], apply(pose, numbers[0][:, :3]), rtol=1e-15, atol=1e-8)
    if normals:
        np.testing.assert_allclose(numbers[1][:, 3:], numbers[0][:, 3:] @ pose[:3, :3].T, atol=1e-15)
    for k, (one, other) in enumerate(zip(before, after, strict=True)):
        kept = [c for c in range(len(one)) if k not in rows or c not in {*places, *normals}]
        assert [one[c] for c in kept] == [other[c] for c in kept]
    assert ("\r\n" in text) == (b"\r\n" in out.read_bytes())


def test_kitti_scans(tmp_path: Path) -> None:
    points = np.random.default_rng(0).normal(size=(100, 4)).astype("<f4")
    (tmp_path / "in.bin").write_bytes(points.tobytes())
    transform_file(tmp_path / "in.bin", make_pose(1), tmp_path / "out.bin")
    after = np.fromfile(tmp_path / "out.bin", "<f4").reshape(-1, 4)
    check_moved(points[:, :3], after[:, :3], make_pose(1))
    np.testing.assert_array_equal(points[:, 3], after[:, 3])


@pytest.mark.parametrize(
    "suffix", [".las", ".laz", ".ply", ".pcd", ".e57", ".ptx", ".stl", ".glb", ".gltf", ".bin"]
)
@pytest.mark.parametrize(
    "content", [b"", b"nonsense\n", b"ply\nformat ascii 1.0\n", b"\0" * 300, b"LASF" + b"\1" * 371]
)
def test_damaged_files_leave_no_output(tmp_path: Path, suffix: str, content: bytes) -> None:
    source, out = tmp_path / f"in{suffix}", tmp_path / f"out{suffix}"
    source.write_bytes(content)
    if suffix in {".stl", ".bin"} and content.startswith((b"nonsense", b"ply", b"\0")):
        return  # a text without triangles, and points at the origin
    with pytest.raises(InputError, match=rf"in{suffix}: "):
        transform_file(source, np.eye(4), out)
    assert [*tmp_path.iterdir()] == [source]


def test_outputs_are_no_inputs_and_of_the_same_format(tmp_path: Path) -> None:
    source = tmp_path / "in.xyz"
    source.write_text("1 2 3\n1,5 2,5 3,5\n")
    (tmp_path / "link.xyz").hardlink_to(source)
    for out, message in (
        ("in.xyz", "is one of the inputs"),
        ("link.xyz", "is one of the inputs"),
        ("a.ply", "format"),
        ("a.xyz", "decimal points"),
    ):
        with pytest.raises(InputError, match=message):
            transform_file(source, np.eye(4), tmp_path / out)
    with pytest.raises(InputError, match="not moved"):
        transform_file(tmp_path / "a.vtk", np.eye(4), tmp_path / "b.vtk")
    assert source.read_text() == "1 2 3\n1,5 2,5 3,5\n"


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    pose = make_pose(1)
    write_transform("pose.txt", pose)
    for folder in ("a", "b"):
        Path(folder).mkdir()
        Path(folder, "scan.xyz").write_text("1 2 3 7\n4 5 6 8\n")
    line = ("apply", "pose.txt", "a/scan.xyz", "b/scan.xyz", "--out", "moved")
    document = json.loads(succeed(capsys, *line, "--json"))
    assert results_in(Path("moved")) == ["a_scan.xyz", "b_scan.xyz"]
    assert not undocumented(document, document["results"]["moved"][0])
    np.testing.assert_array_equal(document["results"]["moved"][0]["T_moved_file"], pose)
    assert "columns without names" in succeed(capsys, *line)
    Path("moved/a_scan.xyz").write_text("mine")
    assert "is there, and not as cgroup wrote it" in fail(capsys, *line)
    assert Path("moved/a_scan.xyz").read_text() == "mine"
    assert "one of the inputs" in fail(capsys, "apply", "pose.txt", "a/scan.xyz", "--out", "a")
    Path("empty.xyz").touch()
    assert "empty" in fail(capsys, "apply", "pose.txt", "empty.xyz", "--out", "other")
    assert not Path("other").exists()
    assert "not moved" in fail(capsys, "apply", "pose.txt", "a/scan.vtk")


def test_command_with_a_scene(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene").mkdir()
    poses = np.stack([np.eye(4), make_pose(2, UTM)])
    names = ["one.xyz", "two.xyz", "lost.xyz"]
    Path("scene/poses.tum").write_text(format_poses(".tum", poses, [0, 1], names))
    for name in names:
        Path(name).write_text("1 2 3\n4 5 6\n")
    succeed(capsys, "apply", "scene", *names[:2], "--out", "moved")
    for name, pose in zip(names, poses, strict=False):
        np.testing.assert_allclose(np.loadtxt(Path("moved", name)), apply(pose, np.loadtxt(name)), atol=1e-8)
    status, out, err = run(capsys, "apply", "scene", *names, "--out", "moved")
    assert (status, "lost.xyz" in out, "1 of 3 files left out" in err) == (3, True, True)
    Path("other.xyz").write_text("1 2 3\n")
    assert "no scan of this name" in fail(capsys, "apply", "scene", "other.xyz", "--out", "others")
    Path("scene/poses.tum").unlink()
    assert "without poses.tum" in fail(capsys, "apply", "scene", "one.xyz", "--out", "others")
