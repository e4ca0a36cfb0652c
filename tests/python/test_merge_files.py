"""Merging original files: all points, all attributes, the source scan of each, one grid."""

from pathlib import Path

import laspy
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from las_files import UTM, fill_attributes, make_pose

from cgroup.errors import InputError
from cgroup.io import merge_files, write_cloud
from cgroup.rigid import apply
from cgroup.types import PointCloud

LEGACY_ONLY = {"scan_angle_rank"}


def write_las(path: Path, form: int, seed: int, extra: dict[str, str], count: int = 200) -> laspy.LasData:
    """Write random attributes within what all point formats can hold."""
    rng = np.random.default_rng(seed)
    header = laspy.LasHeader(point_format=form, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.array([100.0, 200.0, 0.0])
    for name, kind in extra.items():
        header.add_extra_dim(laspy.ExtraBytesParams(name=name, type=kind))
    data = laspy.LasData(header)
    data.xyz = rng.uniform(0, 50, (count, 3)) + np.array([100, 200, 0])
    fill_attributes(data, rng, most=7)
    data.intensity = rng.integers(0, 65535, count, endpoint=True)
    data.write(path)
    return laspy.read(path)


def check_part(
    before: laspy.LasData, after: laspy.LasData, rows: slice, pose: np.ndarray, number: int
) -> None:
    moved = apply(pose, before.xyz)
    extent = np.linalg.norm(np.ptp(after.xyz, axis=0))
    np.testing.assert_allclose(after.xyz[rows], moved, rtol=0, atol=1e-6 * extent + 1e-3)
    assert (np.asarray(after.point_source_id)[rows] == number).all()
    kept = {*after.point_format.dimension_names}
    for name in before.point_format.dimension_names:
        if name in {"X", "Y", "Z", "point_source_id"} or (name in LEGACY_ONLY and name not in kept):
            continue
        assert name in kept
        assert np.array_equal(np.asarray(before[name]), np.asarray(after[name])[rows]), name
    if "scan_angle_rank" in before.point_format.dimension_names and "scan_angle" in kept:
        degrees = np.asarray(after.scan_angle)[rows] * 0.006
        np.testing.assert_allclose(degrees, before.scan_angle_rank, atol=0.0031)


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    forms=st.lists(st.sampled_from([0, 1, 2, 3, 6, 7, 8]), min_size=1, max_size=4),
    seed=st.integers(0, 2**32 - 1),
    suffix=st.sampled_from([".las", ".laz"]),
    away=st.sampled_from([(3.0, -2.0, 1.0), UTM]),
)
def test_all_attributes_of_las_files(
    tmp_path: Path, forms: list[int], seed: int, suffix: str, away: tuple[float, float, float]
) -> None:
    paths = [tmp_path / f"{k}{suffix}" for k in range(len(forms))]
    extras = [{"range": "f4"}, {"range": "f4", "echo width": "u2"}, {}, {"sigma": "f8"}]
    before = [write_las(*one) for one in zip(paths, forms, range(seed, seed + 4), extras, strict=False)]
    poses = [make_pose(seed + k, away) for k in range(len(forms))]
    out = tmp_path / f"out{suffix}"
    assert merge_files(paths, poses, out) == []
    after = laspy.read(out)
    assert len(after.points) == sum(len(one.points) for one in before)
    first = 0
    for number, (one, pose) in enumerate(zip(before, poses, strict=True), 1):
        check_part(one, after, slice(first, first + len(one.points)), pose, number)
        first += len(one.points)


def test_other_formats_keep_positions_colours_and_intensities(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    points, colors = rng.uniform(0, 9, (50, 3)), rng.integers(0, 256, (50, 3)).astype(np.uint8)
    write_cloud(tmp_path / "a.ply", PointCloud(points, colors=colors))
    write_las(tmp_path / "b.las", 6, 1, {})
    (tmp_path / "c.csv").write_text("x,y,z,intensity,ring\n1,2,3,7,1\n4,5,6,8,2\n")
    paths, poses = [tmp_path / name for name in ("a.ply", "b.las", "c.csv")], [make_pose(k) for k in range(3)]
    assert merge_files(paths, poses, tmp_path / "out.laz") == ["c.csv: ring: not kept"]
    after = laspy.read(tmp_path / "out.laz")
    assert after.header.point_format.id == 7
    np.testing.assert_allclose(after.xyz[:50], apply(poses[0], points), atol=1e-3)
    np.testing.assert_array_equal(np.stack([after.red, after.green, after.blue], axis=1)[:50] // 257, colors)
    np.testing.assert_allclose(after.xyz[-2:], apply(poses[2], np.array([[1, 2, 3], [4, 5, 6.0]])), atol=1e-3)
    assert after.intensity[-2:].tolist() == [7, 8]


def test_a_file_of_one_point_does_not_coarsen_the_grid(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    small = rng.uniform(0, 0.01, (50, 3))
    for name, points in (("small.las", small), ("one.las", np.full((1, 3), 0.5))):
        header = laspy.LasHeader(point_format=6, version="1.4")
        header.scales = np.full(3, 1e-6 if name == "small.las" else 0.01)
        data = laspy.LasData(header)
        data.xyz = points
        data.write(tmp_path / name)
    stored = laspy.read(tmp_path / "small.las").xyz
    paths = [tmp_path / "one.las", tmp_path / "small.las"]
    assert merge_files(paths, [np.eye(4), make_pose(4)], tmp_path / "out.las") == []
    np.testing.assert_allclose(
        laspy.read(tmp_path / "out.las").xyz[1:], apply(make_pose(4), stored), rtol=0, atol=1e-6 * 0.017
    )


def test_what_is_not_kept_is_noted(tmp_path: Path) -> None:
    for name, system in (("a.las", b"one\0"), ("b.las", b"other\0")):
        header = laspy.LasHeader(point_format=6, version="1.4")
        header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "", system))
        header.global_encoding.gps_time_type = laspy.header.GpsTimeType(int(name == "b.las"))
        data = laspy.LasData(header)
        data.xyz = np.ones((3, 3))
        data.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR("cgroup_test", 8, "", b"more")])
        data.write(tmp_path / name)
    notes = merge_files([tmp_path / "a.las", tmp_path / "b.las"], [np.eye(4)] * 2, tmp_path / "out.las")
    assert notes == [
        "a.las: extended VLRs: not kept",
        "b.las: extended VLRs: not kept",
        "b.las: GPS times: counted from another day than those of a.las",
        "b.las: coordinate system: not that of a.las, which is kept",
    ]
    kept = [one for one in laspy.read(tmp_path / "out.las").header.vlrs if one.user_id == "LASF_Projection"]
    assert [one.record_data_bytes() for one in kept] == [b"one\0"]


def test_bad_input_writes_nothing(tmp_path: Path) -> None:
    write_las(tmp_path / "a.las", 6, 1, {"range": "f4"})
    write_las(tmp_path / "b.las", 6, 2, {"range": "u2"})
    (tmp_path / "cut.laz").write_bytes((tmp_path / "a.las").read_bytes()[:500])
    out, a = tmp_path / "out.laz", tmp_path / "a.las"
    with pytest.raises(InputError, match="b.las: .*range is of another type"):
        merge_files([a, tmp_path / "b.las"], [np.eye(4)] * 2, out)
    with pytest.raises(InputError, match="cut.laz: "):
        merge_files([a, tmp_path / "cut.laz"], [np.eye(4)] * 2, out)
    with pytest.raises(InputError, match="paths, poses: got 1 files, 2 poses"):
        merge_files([a], [np.eye(4)] * 2, out)
    with pytest.raises(InputError, match="out: "):
        merge_files([a], [np.eye(4)], tmp_path / "out.ply")
    with pytest.raises(InputError, match="a.las"):
        merge_files([a], [np.eye(4)], a)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.las", "b.las", "cut.laz"]
