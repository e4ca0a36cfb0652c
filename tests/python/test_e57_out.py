"""Written E57: read back by pye57 and `read_cloud`, bit for bit; scans of merged files with their poses."""

from pathlib import Path

import laspy
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from las_files import UTM, make_pose

from cgroup.errors import InputError
from cgroup.io import merge_files, read_cloud, write_cloud
from cgroup.rigid import apply
from cgroup.types import PointCloud

pye57 = pytest.importorskip("pye57", reason="pye57 has no wheel for this machine")

PER_PACKET = 1024
FIELDS = [f"cartesian{axis}" for axis in "XYZ"], ["colorRed", "colorGreen", "colorBlue"]


def read_scan(
    path: Path, row: int
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None, np.ndarray, str]:
    """Points, colours and intensities as stored, the pose, and the name of a scan."""
    file = pye57.E57(str(path))
    head, names = file.get_header(row), {*file.get_header(row).point_fields}
    found = file.read_scan_raw(row, ignore_unsupported_fields=True)
    points, colors = (
        np.stack([found[name] for name in group], 1) if {*group} <= names else None for group in FIELDS
    )
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = head.rotation_matrix, head.translation
    name = head.node["name"].value()
    file.close()
    assert points is not None
    return points, colors, found.get("intensity"), pose, name


def random_cloud(count: int, *, normals: bool, colors: bool, viewpoint: bool, seed: int) -> PointCloud:
    rng = np.random.default_rng(seed)
    return PointCloud(
        UTM + rng.normal(0, 100, (count, 3)),
        np.eye(3)[rng.integers(0, 3, count)] if normals else None,
        colors=rng.integers(0, 256, (count, 3)).astype(np.uint8) if colors else None,
        viewpoint=np.array(UTM) + 1.5 if viewpoint else None,
    )


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    st.integers(1, 3 * PER_PACKET),
    st.booleans(),
    st.booleans(),
    st.booleans(),
    st.integers(0, 2**32 - 1),
)
@example(PER_PACKET, True, True, True, 0)
@example(2 * PER_PACKET + 1, False, True, False, 1)
def test_every_number_is_kept(
    tmp_path: Path, count: int, normals: bool, colors: bool, viewpoint: bool, seed: int
) -> None:
    cloud = random_cloud(count, normals=normals, colors=colors, viewpoint=viewpoint, seed=seed)
    path = tmp_path / "scan.e57"
    write_cloud(path, cloud)
    points, red_green_blue, _, pose, name = read_scan(path, 0)
    origin = np.zeros(3) if cloud.viewpoint is None else cloud.viewpoint
    assert name == "scan"
    np.testing.assert_array_equal(points, cloud.points - origin)
    np.testing.assert_array_equal(pose[:3], np.column_stack([np.eye(3), origin]))
    again = read_cloud(path)
    np.testing.assert_array_equal(again.points, points + origin)
    for found, given_ in (
        (red_green_blue, cloud.colors),
        (again.colors, cloud.colors),
        (again.normals, cloud.normals),
    ):
        assert (found is None) == (given_ is None)
        if given_ is not None:
            np.testing.assert_array_equal(found, given_)
    np.testing.assert_array_equal(again.viewpoint, cloud.viewpoint)


def write_las(path: Path, count: int, brightest: int) -> laspy.LasData:
    rng = np.random.default_rng(count)
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.array(UTM)
    data = laspy.LasData(header)
    data.xyz = UTM + rng.uniform(0, 50, (count, 3))
    data.intensity = rng.integers(0, 65536, count)
    data.red, data.green, data.blue = rng.integers(0, brightest + 1, (3, count))
    data.write(path)
    return laspy.read(path)


@pytest.mark.parametrize("brightest", [255, 65535])
def test_merged_files_are_scans_with_poses(brightest: int, tmp_path: Path) -> None:
    las = write_las(tmp_path / "a.las", 3000, brightest)
    cloud = random_cloud(5, normals=True, colors=True, viewpoint=True, seed=2)
    write_cloud(tmp_path / "b & c.pcd", cloud)
    poses = [make_pose(1), make_pose(2)]
    out = tmp_path / "all.e57"
    notes = merge_files([tmp_path / "a.las", tmp_path / "b & c.pcd"], poses, out)
    assert "a.las: classification: not kept" in notes
    assert not [note for note in notes if "intensity" in note or note.startswith("b")]

    points, colors, intensities, pose, name = read_scan(out, 0)
    assert name == "a.las"
    np.testing.assert_array_equal(points, las.xyz)
    stored = np.column_stack([las.red, las.green, las.blue])
    np.testing.assert_array_equal(colors, np.rint(stored * (255 / brightest)))
    assert ("a.las: colors: rounded to 8 bits" in notes) == (brightest > 255)
    np.testing.assert_array_equal(intensities, las.intensity)
    np.testing.assert_allclose(pose, poses[0], rtol=0, atol=1e-9)

    points, colors, intensities, pose, name = read_scan(out, 1)
    assert (name, intensities) == ("b & c.pcd", None)
    np.testing.assert_array_equal(points, cloud.points - cloud.viewpoint)
    np.testing.assert_array_equal(colors, cloud.colors)
    np.testing.assert_allclose(pose[:3, 3], apply(poses[1], cloud.viewpoint[None])[0], rtol=0, atol=1e-8)

    whole = read_cloud(out)
    moved = np.vstack([apply(poses[0], las.xyz), apply(poses[1], cloud.points)])
    np.testing.assert_allclose(whole.points, moved, rtol=0, atol=1e-7)
    np.testing.assert_array_equal(whole.colors[:3000], np.rint(stored * (255 / brightest)))


def test_files_without_points_and_a_wrong_precision(tmp_path: Path) -> None:
    write_las(tmp_path / "none.las", 0, 255)
    write_cloud(tmp_path / "one.ply", np.zeros((1, 3)))
    merge_files([tmp_path / "none.las", tmp_path / "one.ply"], [np.eye(4)] * 2, tmp_path / "all.e57")
    assert read_cloud(tmp_path / "all.e57").points.tolist() == [[0, 0, 0]]
    file = pye57.E57(str(tmp_path / "all.e57"))
    assert [file.get_header(row).point_count for row in range(file.scan_count)] == [0, 1]
    with pytest.raises(InputError, match="dtype: got 'float32'; choose one of float64"):
        write_cloud(tmp_path / "a.e57", np.zeros((1, 3)), dtype="float32")
