"""Reading and writing: every format, and every way in which a file can be wrong."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cloud_files import CLOUDS, FACES, TETRAHEDRON, npy, npz, pcd, ply_ascii, ply_binary

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

DESCRIBED = DescribedCloud(
    np.arange(2), np.zeros((2, 3)), np.zeros((2, 3, 3)), np.ones((2, 5), np.float32), 0.5, np.zeros(3)
)
TURN = np.array([[0.0, -1, 0, 5], [1, 0, 0, -6], [0, 0, 1, 7], [0, 0, 0, 1]])


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.mark.parametrize("name", CLOUDS)
def test_reads_every_format(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(CLOUDS[name])
    cloud = read_cloud(tmp_path / name)
    assert cloud.points.dtype == np.float64
    order = np.lexsort(cloud.points.T) if name.endswith("stl") else slice(None)  # theirs is the triangles'
    expected = TETRAHEDRON[np.lexsort(TETRAHEDRON.T)] if name.endswith("stl") else TETRAHEDRON
    np.testing.assert_array_equal(cloud.points[order], expected)
    if cloud.faces is not None:
        corners = {frozenset(map(tuple, cloud.points[face])) for face in cloud.faces}
        assert corners == {frozenset(map(tuple, TETRAHEDRON[face])) for face in FACES}
    assert (cloud.faces is not None) == (
        name.split(".")[1] in {"ply", "obj", "off", "stl", "vtk", "glb", "gltf"}
    ) or (name == "points.obj")
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
    nowhere = CLOUDS["binary.pcd"].replace(b"VIEWPOINT 0 0 0", b"VIEWPOINT nan 0 0")
    (tmp_path / "a.pcd").write_bytes(nowhere)
    assert read_cloud(tmp_path / "a.pcd").viewpoint is None


def test_splats_that_can_hardly_be_seen_are_left_out(tmp_path: Path) -> None:
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "opacity", "scale_0", "rot_0"]
    opacities = np.array([0.99, 0.11, 0.09, 0.005])
    rows = np.zeros((4, len(names)), "<f4")
    rows[:, :3] = np.arange(12).reshape(4, 3)
    rows[:, names.index("opacity")] = np.log(opacities / (1 - opacities))
    properties = "".join(f"property float {name}\n" for name in names)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex 4\n{properties}end_header\n"
    (tmp_path / "splats.ply").write_bytes(header.encode() + rows.tobytes())
    cloud = read_cloud(tmp_path / "splats.ply")
    np.testing.assert_array_equal(cloud.points, np.arange(6).reshape(2, 3))
    assert cloud.dropped == 2
    assert cloud.normals is None


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
    # Nothing in OBJ and plain text says how much there should be, nor in VTK what follows the points.
    try:
        cloud = read_cloud(path)
    except InputError as error:
        assert "\n" not in str(error)  # noqa: PT017 - both outcomes are looked at
    else:
        assert name.endswith(("obj", "xyz", "XYZ", "txt", "csv", "off", "vtk", "xyzn", "xyzrgb"))
        assert len(cloud) <= 4
        assert len(cloud) == 4 or not name.endswith("off")  # OFF counts its points


SUFFIXES = sorted({name.rpartition(".")[2].lower() for name in CLOUDS} - {"bin", "las", "txt"})


@pytest.mark.parametrize("suffix", SUFFIXES)
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


def test_bad_paths(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="can't be written"):
        write_cloud(tmp_path / "nowhere" / "a.ply", PointCloud(TETRAHEDRON))
    matches = Correspondences(np.zeros((1, 3)), np.zeros((1, 3)))
    for write, content, ending in (
        (write_cloud, PointCloud(TETRAHEDRON), "ply or .pcd"),
        (write_correspondences, matches, "npz"),
        (write_descriptors, DESCRIBED, "npz"),
    ):
        with pytest.raises(InputError, match=rf"ends in \.{ending}"):
            write(tmp_path / "a.obj", content)


def test_transformed_moves_points_and_turns_normals() -> None:
    cloud = PointCloud(TETRAHEDRON, normals=np.eye(4)[:, :3], viewpoint=TETRAHEDRON[1]).transformed(TURN)
    np.testing.assert_array_equal(cloud.points[1], [5, -5, 7])
    np.testing.assert_array_equal(cloud.normals[0], [0, 1, 0])
    np.testing.assert_array_equal(cloud.viewpoint, [5, -5, 7])


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
        (np.diag([2.0, 2, 2, 1]), "scaled by 2, not a rotation; scale the source by that first"),
        (np.diag([2.0, 2, 1, 1]), "scaled or sheared, not a rotation"),
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


TABLE = np.arange(1.0, 13).reshape(2, 6)
ROWS = "1,2,3,4,5,6\n7,8,9,10,11,12\n"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("c.npy", npy(TABLE)),
        ("c.txt", ROWS.replace(",", " ").encode()),
        ("c.csv", ROWS.encode()),
        ("c.csv", f"x,y,z,u,v,w\n{ROWS}".encode()),
        ("c.csv", f'\ufeff"sx", "sy", "sz", "tx", "ty", "tz"\r\n{ROWS}'.encode()),
        ("c.csv", f"nan_x,b,c,d,e,f\n{ROWS}".encode()),
        ("c.csv", f"# x\n{ROWS}".encode()),
        ("c.csv", f"inf,2,3,4,5,6\n{ROWS}".encode()),  # numbers, not names
    ],
)
def test_correspondences_from_tables(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    read = read_correspondences(tmp_path / name)
    np.testing.assert_array_equal(np.hstack([read.source, read.target])[-2:], TABLE)
    assert len(read) == 2 + content.startswith(b"inf")


PLY = ply_ascii()
PAIR = {"source": np.zeros((2, 3)), "target": np.zeros((2, 3))}


@pytest.mark.parametrize(
    ("read", "name", "content", "says"),
    [
        (read_cloud, "a.ply", PLY.replace(b"vertex 4", b"vertex 0").replace(b"face 4", b"face 0"), "no points"),
        (read_cloud, "a.ply", PLY.replace(b"element vertex 4", b"element vertex 40"), "cut off"),
        (read_cloud, "a.ply", PLY.replace(b"3 0 2 1", b"3 0 2 9"), "a face names point 9"),
        (read_cloud, "a.ply", PLY.replace(b"0 2 0\n", b"0 oh 0\n"), "cut off"),
        (read_cloud, "a.ply", PLY.replace(b"property float z\n", b""), "cut off"),
        (read_cloud, "nan.npy", npy(np.full((5, 3), np.nan)), "none of its 5 points is finite"),
        (read_cloud, "a.docx", PLY, r"unknown point cloud format '\.docx'; known are \.asc \.bin \.csv"),
        (read_correspondences, "c.npz", npz(src=np.zeros((2, 3))), "has no array 'source'; it holds src"),
        (read_correspondences, "c.npz", npz(), "holds nothing"),
        (read_correspondences, "c.npz", npz(**{**PAIR, "target": np.zeros((2, 4))}), r"c\.npz: target"),
        (read_correspondences, "c.npz", npz(**PAIR, resolution=np.ones(2)), "single number"),
        (read_correspondences, "c.npz", npz(**{**PAIR, "source": "abc"}), "numbers belong there"),
        (read_correspondences, "c.npz", npz(**PAIR, resolution="abc"), "numbers belong"),
        (read_correspondences, "c.npz", b"PK not really", "not a readable NPZ file"),
        (read_correspondences, "c.npy", npy(np.zeros((2, 3, 2))), r"has an array of shape \(2, 3, 2\); corr"),
        (read_correspondences, "c.txt", b"1 2 3\n4 5 6\n", "has 3 columns; correspondences have six"),
        (read_cloud, "p.npz", npz(a=TABLE, b=TABLE), "has no array named points or xyz, nor x, y and z; it holds a, b"),
        (read_cloud, "p.npz", npz(), "it holds nothing"),
        (read_cloud, "p.npz", npz(points=np.zeros((2, 3), dtype=object)), "numbers belong there"),
    ],
)  # fmt: skip
def test_wrong_files_say_why(
    read: Callable[[Path], object], name: str, content: bytes, says: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=says):
        read(tmp_path / name)


def test_descriptors_are_checked(tmp_path: Path) -> None:
    write_descriptors(tmp_path / "d.npz", DESCRIBED)
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


def test_write_mask(tmp_path: Path) -> None:
    for name in ("mask.npy", "mask.txt"):
        write_mask(tmp_path / name, [True, False, True])
    np.testing.assert_array_equal(np.load(tmp_path / "mask.npy"), [True, False, True])
    assert (tmp_path / "mask.txt").read_text() == "1\n0\n1\n"
