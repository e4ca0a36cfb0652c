"""Reading and writing: every format, and every way in which a file can be wrong."""

from pathlib import Path

import numpy as np
import pytest
from cloud_files import CLOUDS, FACES, TETRAHEDRON, pcd, ply_ascii, ply_binary
from shared_data import shared_file

from cgroup.errors import InputError
from cgroup.io import (
    PointCloud,
    check_rigid,
    read_cloud,
    read_correspondences,
    read_descriptors,
    read_transform,
    write_cloud,
    write_correspondences,
    write_descriptors,
    write_mask,
    write_transform,
)
from cgroup.registration import DescribedCloud
from cgroup.types import Correspondences

TURN = np.array([[0.0, -1, 0, 5], [1, 0, 0, -6], [0, 0, 1, 7], [0, 0, 0, 1]])


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.mark.parametrize("name", CLOUDS)
def test_reads_every_format(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(CLOUDS[name])
    cloud = read_cloud(tmp_path / name)
    assert cloud.points.dtype == np.float64
    if name.endswith("stl"):  # the order of the points is that of the triangles
        assert sorted(map(tuple, cloud.points)) == sorted(map(tuple, TETRAHEDRON))
    else:
        np.testing.assert_array_equal(cloud.points, TETRAHEDRON)
    if cloud.faces is not None:
        corners = {frozenset(map(tuple, cloud.points[face])) for face in cloud.faces}
        assert corners == {frozenset(map(tuple, TETRAHEDRON[face])) for face in FACES}
    assert (cloud.faces is not None) == (name.split(".")[1] in {"ply", "obj", "off", "stl"}) or (
        name == "points.obj"
    )
    assert cloud.dropped == 0


def test_reads_normals_and_colors(tmp_path: Path) -> None:
    (tmp_path / "little.ply").write_bytes(ply_binary("<"))
    colors = read_cloud(tmp_path / "little.ply").colors
    np.testing.assert_array_equal(colors, np.tile([1, 2, 3], (4, 1)))

    header = (
        b"VERSION 0.7\nFIELDS x y z rgb normal_x normal_y normal_z\nSIZE 4 4 4 4 4 4 4\n"
        b"TYPE F F F U F F F\nWIDTH 2\nDATA ascii\n"
    )
    rows = b"1 2 3 16711935 0 0 1\n  4 5 6 256  0 1 0 \n"
    (tmp_path / "a.pcd").write_bytes(header + rows)
    cloud = read_cloud(tmp_path / "a.pcd")
    np.testing.assert_array_equal(cloud.points, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(cloud.normals, [[0, 0, 1], [0, 1, 0]])
    np.testing.assert_array_equal(cloud.colors, [[255, 0, 255], [0, 1, 0]])


def test_leaves_out_points_that_are_not_finite(tmp_path: Path) -> None:
    rows = [b"0 0 0", b"nan nan nan", b"0 2 0", b"0.25 0.5 inf"]
    (tmp_path / "a.pcd").write_bytes(pcd("ascii", body=b"\n".join(rows)))
    cloud = read_cloud(tmp_path / "a.pcd")
    np.testing.assert_array_equal(cloud.points, TETRAHEDRON[[0, 2]])
    assert cloud.dropped == 2


def test_faces_follow_when_points_are_left_out(tmp_path: Path) -> None:
    broken = np.vstack([np.full((1, 3), np.nan), TETRAHEDRON])
    cloud = PointCloud(broken, faces=np.vstack([FACES + 1, [[0, 1, 2]]]))
    write_cloud(tmp_path / "a.ply", cloud)
    read = read_cloud(tmp_path / "a.ply")
    np.testing.assert_array_equal(read.points, TETRAHEDRON)
    np.testing.assert_array_equal(read.faces, FACES)
    assert read.dropped == 1


@pytest.mark.parametrize("name", CLOUDS)
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_cut_off_file_is_an_error_or_shorter_text(name: str, share: float, tmp_path: Path) -> None:
    content = CLOUDS[name]
    path = tmp_path / name
    path.write_bytes(content[: int(share * len(content))])
    # Nothing in OBJ and plain text says how much there should be.
    try:
        cloud = read_cloud(path)
    except InputError as error:
        assert "\n" not in str(error)  # noqa: PT017 - both outcomes are looked at
    else:
        assert name.endswith(("obj", "xyz", "XYZ", "txt", "csv", "off"))
        assert len(cloud) <= 4
        assert len(cloud) == 4 or not name.endswith("off")  # OFF counts its points


@pytest.mark.parametrize(
    "suffix", ["ply", "pcd", "obj", "off", "stl", "xyz", "csv", "pts", "npy", "npz", "laz"]
)
@pytest.mark.parametrize(
    "content",
    [b"", b"\n", b"hello, world\nhow are you\n", bytes(range(256)) * 8, b"\x00" * 400],
    ids=["empty", "blank", "prose", "bytes", "zeros"],
)
def test_garbage_is_one_line(suffix: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"garbage.{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match="garbage") as caught:
        read_cloud(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (ply_ascii().replace(b"vertex 4", b"vertex 0").replace(b"face 4", b"face 0"), "no points"),
        (ply_ascii().replace(b"element vertex 4", b"element vertex 40"), "cut off"),
        (ply_ascii().replace(b"3 0 2 1", b"3 0 2 9"), "a face names point 9"),
        (ply_ascii().replace(b"0 2 0\n", b"0 oh 0\n"), "cut off"),
        (ply_ascii().replace(b"property float z\n", b""), "cut off"),
    ],
)
def test_broken_ply_says_why(content: bytes, says: str, tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(InputError, match=says):
        read_cloud(tmp_path / "a.ply")


def test_all_nan_is_an_error(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.full((5, 3), np.nan))
    with pytest.raises(InputError, match="none of its 5 points is finite"):
        read_cloud(tmp_path / "a.npy")


def test_bad_paths(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_cloud(tmp_path / "missing.ply")
    with pytest.raises(InputError, match=r"unknown point cloud format '\.docx'; known are \.bin \.csv"):
        read_cloud(tmp_path / "letter.docx")
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(InputError, match="is a directory"):
        read_cloud(tmp_path / "folder.ply")
    with pytest.raises(InputError, match="can't be written"):
        write_cloud(tmp_path / "nowhere" / "a.ply", PointCloud(TETRAHEDRON))
    with pytest.raises(InputError, match=r"ends in \.ply"):
        write_cloud(tmp_path / "a.obj", PointCloud(TETRAHEDRON))


def test_cloud_round_trip_is_exact(tmp_path: Path, rng: np.random.Generator) -> None:
    points = rng.normal(size=(50, 3)) * 1e3 + 4.5e6  # coordinates as large as in surveying
    normals = rng.normal(size=(50, 3)).astype(np.float32).astype(np.float64)
    colors = rng.integers(0, 256, size=(50, 3)).astype(np.uint8)
    faces = rng.integers(0, 50, size=(20, 3))
    write_cloud(tmp_path / "a.ply", PointCloud(points, normals, faces, colors))
    read = read_cloud(tmp_path / "a.ply")
    np.testing.assert_array_equal(read.points, points)
    np.testing.assert_array_equal(read.normals, normals)
    np.testing.assert_array_equal(read.faces, faces)
    np.testing.assert_array_equal(read.colors, colors)


def test_transformed_moves_points_and_turns_normals() -> None:
    cloud = PointCloud(TETRAHEDRON, normals=np.eye(4)[:, :3]).transformed(TURN)
    np.testing.assert_array_equal(cloud.points[1], [5, -5, 7])
    np.testing.assert_array_equal(cloud.normals[0], [0, 1, 0])


# --- transforms ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["T.txt", "T.xf", "T.npy", "T"])
def test_transform_round_trip_is_exact(name: str, tmp_path: Path, rng: np.random.Generator) -> None:
    transform = np.eye(4)
    transform[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    transform[:3, :3] *= np.linalg.det(transform[:3, :3])
    transform[:3, 3] = rng.normal(size=3) * 1e3
    write_transform(tmp_path / name, transform)
    np.testing.assert_array_equal(read_transform(tmp_path / name), transform)


@pytest.mark.parametrize(
    ("matrix", "says"),
    [
        (np.eye(3), r"got (shape \(3, 3\)|3 rows of 3 numbers)"),
        (np.full((4, 4), np.nan), "isn't finite"),
        (TURN.T, "last row is .* transpose it"),
        (np.diag([2.0, 2, 2, 1]), "scaled or sheared"),
        (np.diag([1.0, 1, -1, 1]), "a reflection"),
        (np.zeros((4, 4)), "last row"),
    ],
)
def test_only_rigid_transforms(matrix: np.ndarray, says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=says):
        check_rigid(matrix)
    np.savetxt(tmp_path / "T.txt", matrix)
    with pytest.raises(InputError, match=r"T\.txt: .*" + says):
        read_transform(tmp_path / "T.txt")


@pytest.mark.parametrize("content", [b"", b"no numbers", b"1 2 3\n4 5\n", b"# only a comment\n"])
def test_unreadable_transform(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "T.txt").write_bytes(content)
    with pytest.raises(InputError, match=r"T\.txt"):
        read_transform(tmp_path / "T.txt")


# --- correspondences -------------------------------------------------------------------------


def test_correspondences_round_trip(tmp_path: Path, rng: np.random.Generator) -> None:
    frames = np.tile(np.eye(3), (6, 1, 1))
    frames[2] = np.nan
    written = Correspondences(
        rng.normal(size=(6, 3)),
        rng.normal(size=(6, 3)),
        ratio=rng.uniform(size=6),
        source_lrf=frames,
        target_lrf=frames,
        resolution=0.5,
    )
    write_correspondences(tmp_path / "c.npz", written)
    read = read_correspondences(tmp_path / "c.npz")
    for name in ("source", "target", "ratio", "source_lrf", "target_lrf", "resolution"):
        np.testing.assert_array_equal(getattr(read, name), getattr(written, name))
    assert read.similarity is None
    assert read.source_centroid is None


def test_correspondences_from_text(tmp_path: Path) -> None:
    (tmp_path / "c.txt").write_text("1 2 3 4 5 6\n7 8 9 10 11 12\n")
    read = read_correspondences(tmp_path / "c.txt")
    np.testing.assert_array_equal(read.source, [[1, 2, 3], [7, 8, 9]])
    np.testing.assert_array_equal(read.target, [[4, 5, 6], [10, 11, 12]])


@pytest.mark.parametrize(
    ("arrays", "says"),
    [
        ({"src": np.zeros((2, 3))}, "has no array 'source'; it holds src"),
        ({}, "holds nothing"),
        ({"source": np.zeros((2, 3)), "target": np.zeros((2, 4))}, r"c\.npz: target"),
        ({"source": np.zeros((2, 3)), "target": np.zeros((2, 3)), "resolution": np.ones(2)}, "single number"),
    ],
)
def test_wrong_npz(arrays: dict[str, np.ndarray], says: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "c.npz", **arrays)
    with pytest.raises(InputError, match=says):
        read_correspondences(tmp_path / "c.npz")


@pytest.mark.parametrize(
    "names",
    ["", "x,y,z,u,v,w\n", '\ufeff"sx", "sy", "sz", "tx", "ty", "tz"\r\n', "nan_x,b,c,d,e,f\n", "# x\n"],
)
def test_correspondences_from_csv(names: str, tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text(f"{names}1,2,3,4,5,6\n7,8,9,10,11,12\n", encoding="utf-8")
    read = read_correspondences(tmp_path / "c.csv")
    np.testing.assert_array_equal(read.source, [[1, 2, 3], [7, 8, 9]])
    np.testing.assert_array_equal(read.target, [[4, 5, 6], [10, 11, 12]])


@pytest.mark.parametrize("row", ["nan,2,3,4,5,6", "inf,2,3,4,5,6"])
def test_no_row_of_numbers_is_taken_for_names(row: str, tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text(f"{row}\n7,8,9,10,11,12\n")
    assert len(read_correspondences(tmp_path / "c.csv")) == 2


def test_correspondences_from_npy(tmp_path: Path) -> None:
    table = np.arange(12.0).reshape(2, 6)
    np.save(tmp_path / "c.npy", table)
    read = read_correspondences(tmp_path / "c.npy")
    np.testing.assert_array_equal(np.hstack([read.source, read.target]), table)
    np.save(tmp_path / "c.npy", np.zeros((2, 3, 2)))
    with pytest.raises(InputError, match=r"has an array of shape \(2, 3, 2\); correspondences have six"):
        read_correspondences(tmp_path / "c.npy")


def test_a_folder_is_no_cloud(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a directory, not a file"):
        read_cloud(tmp_path)


def test_wrong_correspondence_files(tmp_path: Path) -> None:
    (tmp_path / "c.txt").write_text("1 2 3\n4 5 6\n")
    with pytest.raises(InputError, match="has 3 columns; correspondences have six"):
        read_correspondences(tmp_path / "c.txt")
    (tmp_path / "c.npz").write_bytes(b"PK not really")
    with pytest.raises(InputError, match="not a readable NPZ file"):
        read_correspondences(tmp_path / "c.npz")
    with pytest.raises(InputError, match=r"ends in \.npz"):
        write_correspondences(tmp_path / "c.csv", Correspondences(np.zeros((1, 3)), np.zeros((1, 3))))


def test_descriptors_are_checked(tmp_path: Path) -> None:
    described = DescribedCloud(
        np.arange(2), np.zeros((2, 3)), np.zeros((2, 3, 3)), np.ones((2, 5), np.float32), 0.5, np.zeros(3)
    )
    write_descriptors(tmp_path / "d.npz", described)
    read = read_descriptors(tmp_path / "d.npz")
    assert read.descriptors.dtype == np.float32
    assert (len(read), read.resolution, repr(read)) == (2, 0.5, "DescribedCloud(m=2, dimensions=5)")
    arrays = dict(np.load(tmp_path / "d.npz"))
    np.savez(tmp_path / "short.npz", **{**arrays, "points": np.zeros((1, 3))})
    np.savez(tmp_path / "without.npz", **{name: arrays[name] for name in ("indices", "points")})
    for name, says in (
        ("short", "differ in length"),
        ("without", "has no array 'lrf'; it holds indices, points"),
    ):
        with pytest.raises(InputError, match=says):
            read_descriptors(tmp_path / f"{name}.npz")
    with pytest.raises(InputError, match="ends in .npz"):
        write_descriptors(tmp_path / "d.txt", described)


def test_write_mask(tmp_path: Path) -> None:
    mask = np.array([True, False, True])
    write_mask(tmp_path / "mask.npy", mask)
    np.testing.assert_array_equal(np.load(tmp_path / "mask.npy"), mask)
    write_mask(tmp_path / "mask.txt", mask)
    assert (tmp_path / "mask.txt").read_text() == "1\n0\n1\n"


# --- real files ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "count", "has_faces"),
    [
        ("b3r/models/bunny.ply", 34834, True),
        ("stanford_views/bunny/bun045.ply", 40097, False),
        ("u3or/models/chicken3.ply", 13550, True),
        ("u3or/models/cheff_small.ply", 12509, False),
        ("u3or/pcl/rs1.pcd", 289541, False),
        ("pcl/bun4.pcd", 361, False),
        ("threedmatch/7-scenes-redkitchen/cloud_bin_7.pcd", 246311, False),
        ("lidar/small_gicp_source.ply", 69792, False),
    ],
)
def test_reads_published_clouds(name: str, count: int, has_faces: bool) -> None:
    cloud = read_cloud(shared_file(f"data/{name}"))
    assert len(cloud) == count
    assert (cloud.faces is not None) == has_faces


def test_reads_published_poses_and_correspondences() -> None:
    for name in ("b3r/gt/Scene0-rs0.xf", "u3or/gt/chef-rs1.xf", "corr/turboreg_kitti/000_trans.txt"):
        assert read_transform(shared_file(f"data/{name}")).shape == (4, 4)
    corr = read_correspondences(shared_file("data/corr/mac_py_redkitchen_24_59/corr.txt"))
    assert len(corr) == 5678
