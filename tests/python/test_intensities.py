"""Intensities of points: read and written by every format that has them, selected, averaged and merged."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import laspy
import numpy as np
import pytest
from bag_files import cloud_message
from e57_files import FLOAT, e57
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from las_files import make_pose
from test_foreign_clouds import Frame, Tensor, TensorMap

from cgroup.datasets import standin_pair
from cgroup.errors import InputError
from cgroup.features import voxel_downsample
from cgroup.io import merge_files, read_cloud, write_cloud
from cgroup.registration import register
from cgroup.scenes import register_all
from cgroup.types import PointCloud
from cgroup.types.point_cloud import join_clouds

PTX_HEAD = "1\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
PLY_HEAD = (
    "ply\nformat ascii 1.0\nelement vertex 2\nproperty float scalar_Intensity\n"
    "property float x\nproperty float y\nproperty float z\nend_header\n"
)
E57_COLUMNS = {"cartesianX": [1.0, 4], "cartesianY": [2.0, 5], "cartesianZ": [3.0, 6], "intensity": [-7.5, 9]}
INVALID = {"isIntensityInvalid": (FLOAT, [1.0, 0.0])}


def cloud_of(count: int, seed: int, *, normals: bool = False, colors: bool = False) -> PointCloud:
    rng = np.random.default_rng(seed)
    return PointCloud(
        rng.normal(0, 100, (count, 3)),
        np.eye(3)[rng.integers(0, 3, count)] if normals else None,
        colors=rng.integers(0, 256, (count, 3)).astype(np.uint8) if colors else None,
        intensities=rng.normal(0, 1000, count).astype(np.float32),
    )


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    suffix=st.sampled_from(["ply", "pcd", "e57"]),
    dtype=st.sampled_from(["float32", "float64"]),
    count=st.integers(8, 2500),
    normals=st.booleans(),
    colors=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_written_intensities_are_read_again(
    tmp_path: Path, suffix: str, dtype: str, count: int, normals: bool, colors: bool, seed: int
) -> None:
    cloud, path = cloud_of(count, seed, normals=normals, colors=colors), tmp_path / f"a.{suffix}"
    write_cloud(path, cloud, dtype="float64" if suffix == "e57" else dtype)
    again = read_cloud(path)
    np.testing.assert_array_equal(again.intensities, cloud.intensities)
    assert again.intensities.dtype == np.float32
    np.testing.assert_allclose(again.points, cloud.points, rtol=1e-6 if dtype == "float32" else 0)
    for found, wanted in ((again.normals, cloud.normals), (again.colors, cloud.colors)):
        assert (found is None) == (wanted is None)
        assert wanted is None or np.array_equal(found, wanted)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.ply", PLY_HEAD + "-7.5 1 2 3\n9 4 5 6\n"),
        ("a.pcd", "FIELDS x intensity y z\nWIDTH 2\nDATA ascii\n1 -7.5 2 3\n4 9 5 6\n"),
        ("a.pts", "2\n1 2 3 -7.5\n4 5 6 9\n"),
        ("b.pts", "2\n1 2 3 -7.5 0 0 0\n4 5 6 9 0 0 0\n"),
        ("a.ptx", PTX_HEAD + "1 2 3 -7.5\n4 5 6 9\n"),
        ("a.csv", "Intensity,x,y,z\n-7.5,1,2,3\n9,4,5,6\n"),
        ("a.bin", np.array([1, 2, 3, -7.5, 4, 5, 6, 9], np.float32).tobytes()),
        ("a.e57", e57(({name: (FLOAT, column) for name, column in E57_COLUMNS.items()}, ""))),
    ],
)
def test_formats_with_intensities(tmp_path: Path, name: str, content: str | bytes) -> None:
    (tmp_path / name).write_bytes(content.encode() if isinstance(content, str) else content)
    cloud = read_cloud(tmp_path / name)
    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert cloud.intensities.tolist() == [-7.5, 9]


def test_invalid_intensities_of_e57_are_nan(tmp_path: Path) -> None:
    columns = {name: (FLOAT, column) for name, column in E57_COLUMNS.items()}
    (tmp_path / "a.e57").write_bytes(e57((columns | INVALID, "")))
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.e57").intensities, [np.nan, 9])


def test_points_keep_their_intensities() -> None:
    one, other = cloud_of(6, 1), cloud_of(4, 2)
    moved = one.transformed(make_pose(3))
    np.testing.assert_array_equal(moved.intensities, one.intensities)
    mask = np.arange(6) % 2 == 0
    np.testing.assert_array_equal(one.select(mask).intensities, one.intensities[::2])
    np.testing.assert_array_equal(
        join_clouds([one, other]).intensities, np.concatenate([one.intensities, other.intensities])
    )
    assert join_clouds([one, PointCloud(np.zeros((1, 3)))]).intensities is None


def test_merged_scenes_have_mean_intensities(tmp_path: Path) -> None:
    pair = standin_pair(pixels=60)
    scans = [pair.source, pair.target]
    scans = [PointCloud(one.points, intensities=np.ones(len(one), np.float32)) for one in scans]
    for name, scan in zip(("a.e57", "b.ply"), scans, strict=True):
        write_cloud(tmp_path / name, scan)
    for given_ in (scans, [tmp_path / "a.e57", tmp_path / "b.ply"]):
        assert (register_all(given_).merged().intensities == 1).all()
        done = register(*given_)
        assert (done.merged(*given_).intensities == 1).all()
        assert (done.place(given_[0]).intensities == 1).all()


def test_voxels_have_mean_intensities() -> None:
    points, strengths = np.array([[0.0, 0, 0], [0.2, 0, 0], [5, 0, 0]]), np.array([1, 2, 7], np.float32)
    voxels = voxel_downsample(PointCloud(points, intensities=strengths), 1.0)
    np.testing.assert_array_equal(voxels.intensities[voxels.indices], [1.5, 1.5, 7])
    with pytest.raises(InputError, match=r"points\.intensities: got 2 for 3 points"):
        voxel_downsample(PointCloud(points, intensities=strengths[:2]), 1.0)


@pytest.mark.parametrize(
    ("given_", "stored", "note"),
    [
        ([0, 7, 65535], [0, 7, 65535], ""),
        ([0, 0.5, 1], [0, 32768, 65535], "0 to 1"),
        ([0.25, np.nan, 0.5], [16384, 0, 32768], "0 to 1"),
        ([-2048, 2047, 2047], [0, 65535, 65535], "-2048 to 2047"),
        ([0, 1e6, 4e5], [0, 65535, 26214], "0 to 1e+06"),
    ],
)
def test_merged_las_has_16_bits(tmp_path: Path, given_: list[float], stored: list[int], note: str) -> None:
    write_cloud(tmp_path / "a.ply", PointCloud(np.eye(3), intensities=np.array(given_, np.float32)))
    wanted = [f"a.ply: intensity: {note} written as 0 to 65535"] if note else []
    assert merge_files([tmp_path / "a.ply"], [np.eye(4)], tmp_path / "out.las") == wanted
    assert laspy.read(tmp_path / "out.las").intensity.tolist() == stored
    assert merge_files([tmp_path / "a.ply"], [np.eye(4)], tmp_path / "out.e57") == []
    np.testing.assert_array_equal(read_cloud(tmp_path / "out.e57").intensities, np.array(given_, np.float32))


def test_merged_las_has_one_scale_for_all_files(tmp_path: Path) -> None:
    for name, given_ in (("a.ply", [0.0, 0.5, 1.0]), ("b.pcd", [0.0, 2.0, 4.0]), ("c.ply", [0.0, 0.0, 0.0])):
        write_cloud(tmp_path / name, PointCloud(np.eye(3), intensities=np.array(given_, np.float32)))
    write_cloud(tmp_path / "d.ply", PointCloud(np.eye(3)))
    paths = [tmp_path / name for name in ("a.ply", "b.pcd", "c.ply", "d.ply")]
    notes = merge_files(paths, [np.eye(4)] * 4, tmp_path / "out.laz")
    assert notes == [f"{name}: intensity: 0 to 4 written as 0 to 65535" for name in ("a.ply", "b.pcd")]
    stored = laspy.read(tmp_path / "out.laz").intensity.reshape(4, 3).tolist()
    assert stored == [[0, 8192, 16384], [0, 32768, 65535], [0, 0, 0], [0, 0, 0]]
    write_cloud(tmp_path / "a.ply", PointCloud(np.eye(3), intensities=np.array([0, 7, 200], np.float32)))
    assert merge_files(paths, [np.eye(4)] * 4, tmp_path / "out.laz") == []
    assert laspy.read(tmp_path / "out.laz").intensity[:6].tolist() == [0, 7, 200, 0, 2, 4]


STRENGTHS = np.array([0, 700, 65535], np.uint16)


def clouds_of_libraries() -> dict[str, Any]:
    """Clouds of other libraries with intensities, by name."""
    columns = np.column_stack([np.eye(3), STRENGTHS])
    rows = np.rec.fromarrays(columns.T, names="x,y,z,Intensity")
    tensors = TensorMap(positions=Tensor(np.eye(3)), intensities=Tensor(STRENGTHS[:, None]))
    return {
        "table": Frame(["x", "y", "z", "intensity"], columns),
        "CloudCompare": Frame(["//X", "Y", "Z", "Scalar_Intensity"], columns),
        "records": np.array(rows, rows.dtype),
        "laspy": SimpleNamespace(xyz=np.eye(3), points=rows, intensity=STRENGTHS),
        "Open3D": SimpleNamespace(point=tensors),
    }


@pytest.mark.parametrize("kind", [*clouds_of_libraries(), "ROS"])
def test_intensities_of_other_libraries_are_kept(tmp_path: Path, kind: str) -> None:
    given_ = {**clouds_of_libraries(), "ROS": cloud_message(np.eye(3))}[kind]
    write_cloud(tmp_path / "a.ply", given_)
    wanted = np.zeros(3) if kind == "ROS" else STRENGTHS
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.ply").intensities, wanted)


@pytest.mark.parametrize(
    "column", [np.array(["a", "b", "c"]), np.array([1, None, 2], object), np.array([1j, 2, 3])]
)
def test_intensities_that_are_no_real_numbers_are_not_read(tmp_path: Path, column: np.ndarray) -> None:
    records = np.zeros(3, [*((axis, float) for axis in "xyz"), ("intensity", column.dtype)])
    records["intensity"] = column
    write_cloud(tmp_path / "a.ply", records)
    assert read_cloud(tmp_path / "a.ply").intensities is None
    write_cloud(tmp_path / "a.ply", SimpleNamespace(xyz=np.eye(3), intensity=np.arange(2)))
    assert read_cloud(tmp_path / "a.ply").intensities is None
