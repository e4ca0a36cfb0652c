"""Models of COLMAP: read, moved by similarities, and written, against the format's description and pycolmap."""

import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from colmap_files import Views, make_views, pose_of, write_model
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from test_io_mutations import mutate

from cgroup.datasets.generated import worlds
from cgroup.datasets.generated.worlds import World
from cgroup.errors import InputError
from cgroup.io import read_cloud, read_colmap, write_colmap
from cgroup.io.attributes import unkept_attributes
from cgroup.registration import register
from cgroup.rigid import apply, invert, rotation_error
from cgroup.rigid.transforms import split_scale

KINDS = pytest.mark.parametrize("kind", ["bin", "txt"])
POSE = pose_of(np.array([0.3, -1.0, 2.0]), np.array([10.0, -500.0, 3.0]))
NUMBER = st.floats(-3, 3)
PARTS = ("cameras", "images", "points3D", "rigs", "frames")


@KINDS
@pytest.mark.parametrize("rigs", [True, False])
def test_a_model_is_read(tmp_path: Path, kind: str, rigs: bool) -> None:
    views = make_views()
    folder = write_model(tmp_path / "sparse", views, kind, rigs=rigs)
    (folder / "project.ini").write_text("left alone")
    model = read_colmap(folder)
    np.testing.assert_array_equal(model.points, views.points)
    np.testing.assert_array_equal(model.colors, np.arange(12)[:, None] + np.arange(3))
    np.testing.assert_array_equal(model.errors, np.arange(12) / 8)
    assert model.image_names == tuple(f"{row}.png" for row in range(6))
    np.testing.assert_allclose(model.T_camera_world, views.poses, atol=1e-14)
    cloud = read_cloud(folder / f"points3D.{kind}")
    np.testing.assert_array_equal(cloud.points, model.points)
    np.testing.assert_array_equal(cloud.colors, model.colors)
    assert unkept_attributes(folder / f"points3D.{kind}") == ["reprojection error", "track"]


@KINDS
def test_what_was_read_is_written_to_the_bit(tmp_path: Path, kind: str) -> None:
    folder = write_model(tmp_path / "sparse", make_views(), kind)
    model = pickle.loads(pickle.dumps(read_colmap(folder)))
    write_colmap(tmp_path / "copy", model)
    assert sorted(path.name for path in (tmp_path / "copy").iterdir()) == sorted(
        f"{part}.{kind}" for part in PARTS
    )
    for part in PARTS:
        name = f"{part}.{kind}"
        assert (tmp_path / "copy" / name).read_bytes() == (folder / name).read_bytes()


@KINDS
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    turn=st.tuples(NUMBER, NUMBER, NUMBER),
    shift=st.tuples(NUMBER, NUMBER, NUMBER),
    scale=st.floats(1e-3, 1e3),
)
def test_images_see_the_same_after_a_move(
    tmp_path_factory: pytest.TempPathFactory,
    kind: str,
    turn: tuple[float, ...],
    shift: tuple[float, ...],
    scale: float,
) -> None:
    folder, views = tmp_path_factory.mktemp("colmap"), make_views()
    pose = pose_of(np.array(turn), scale * np.array(shift))
    model = read_colmap(write_model(folder / "sparse", views, kind))
    write_colmap(folder / "moved", model.transformed(pose, scale=scale))
    moved = read_colmap(folder / "moved")
    np.testing.assert_allclose(
        moved.points, apply(pose, scale * views.points), rtol=1e-12, atol=1e-12 * scale
    )
    np.testing.assert_array_equal(moved.colors, model.colors)
    np.testing.assert_array_equal(moved.errors, model.errors)
    assert moved.image_names == model.image_names
    for before, after in zip(model.T_camera_world, moved.T_camera_world, strict=True):
        np.testing.assert_allclose(apply(after, moved.points) / scale, apply(before, model.points), atol=1e-9)
    assert_rigs_agree(folder / "moved", moved.T_camera_world, kind)


def assert_rigs_agree(folder: Path, poses: np.ndarray, kind: str) -> None:
    """Check that the poses of frames and rigs give those of the images."""
    frames = read_poses(folder / f"frames.{kind}", 8, 100, 2)
    if kind == "bin":
        (rig,) = read_poses(folder / f"rigs.{kind}", 8 + 8 + 9, 90, 0)
    else:
        rig = from_numbers((folder / "rigs.txt").read_text().split()[7:14])
    np.testing.assert_allclose(frames, poses[::2], atol=1e-9 * np.abs(poses).max())
    np.testing.assert_allclose(rig @ frames, poses[1::2], atol=1e-9 * np.abs(poses).max())


def read_poses(path: Path, at: int, size: int, word: int) -> np.ndarray:
    if path.suffix == ".txt":
        lines = [line.split() for line in path.read_text().splitlines() if line[:1] != "#"]
        return np.array([from_numbers(words[word : word + 7]) for words in lines])
    content = path.read_bytes()
    count = int.from_bytes(content[:8], "little")
    return np.array(
        [from_numbers(np.frombuffer(content, "<f8", 7, 8 + at + row * size)) for row in range(count)]
    )


def from_numbers(numbers: object) -> np.ndarray:
    w, x, y, z, *shift = np.array(numbers, dtype=float)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_quat([x, y, z, w]).as_matrix(), shift
    return pose


@KINDS
def test_a_move_leaves_the_rest_to_the_bit(tmp_path: Path, kind: str) -> None:
    folder = write_model(tmp_path / "sparse", make_views(), kind)
    write_colmap(tmp_path / "moved", read_colmap(folder).transformed(POSE, 2.5))
    assert (tmp_path / "moved" / f"cameras.{kind}").read_bytes() == (folder / f"cameras.{kind}").read_bytes()
    for part in ("images", "points3D"):
        before, after = ((place / f"{part}.{kind}").read_bytes() for place in (folder, tmp_path / "moved"))
        if kind == "bin":
            width = 56 if part == "images" else 24
            starts = [at + (4 if part == "images" else 8) for at in record_starts(part, before)]
            kept = np.ones(len(before), dtype=bool)
            kept[np.array(starts)[:, None] + np.arange(width)] = False
            assert np.array_equal(np.frombuffer(before, "u1")[kept], np.frombuffer(after, "u1")[kept])
            assert len(before) == len(after)
        else:
            assert [others(part, line) for line in before.split(b"\n")] == [
                others(part, line) for line in after.split(b"\n")
            ]


def record_starts(part: str, content: bytes) -> list[int]:
    """Return where the records begin, whose lengths are known here."""
    size = 64 + 6 + 8 + 12 * 24 if part == "images" else 51 + 6 * 8
    assert (len(content) - 8) % size == 0
    return list(range(8, len(content), size))


def others(part: str, line: bytes) -> list[bytes]:
    words = line.split(b" ")
    is_pose = part == "images" and line.endswith(b".png")
    return words[:1] + words[8:] if is_pose else words[:1] + words[4:] if part == "points3D" else words


def test_line_ends_stay(tmp_path: Path) -> None:
    folder = write_model(tmp_path / "sparse", make_views(), "txt")
    write_colmap(tmp_path / "moved", read_colmap(folder).transformed(POSE, 2.5))
    for part in PARTS:
        path = folder / f"{part}.txt"
        path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    write_colmap(tmp_path / "ends", read_colmap(folder).transformed(POSE, 2.5))
    for part in PARTS:
        expected = (tmp_path / "moved" / f"{part}.txt").read_bytes().replace(b"\n", b"\r\n")
        assert (tmp_path / "ends" / f"{part}.txt").read_bytes() == expected


@KINDS
def test_as_pycolmap_moves_it(tmp_path: Path, kind: str) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig, options.num_points3D = (
        2,
        2,
        3,
        40,
    )
    theirs = pycolmap.synthesize_dataset(options)
    (tmp_path / "sparse").mkdir()
    (theirs.write_binary if kind == "bin" else theirs.write_text)(tmp_path / "sparse")
    write_colmap(tmp_path / "moved", read_colmap(tmp_path / "sparse").transformed(POSE, 2.5))
    ours = pycolmap.Reconstruction(tmp_path / "moved")
    theirs.transform(pycolmap.Sim3d(2.5, pycolmap.Rotation3d(POSE[:3, :3]), POSE[:3, 3]))
    for number, point in theirs.points3D.items():
        np.testing.assert_allclose(ours.points3D[number].xyz, point.xyz, atol=1e-11)
        assert len(ours.points3D[number].track.elements) == len(point.track.elements)
    for number, image in theirs.images.items():
        pose = image.cam_from_world().matrix()
        np.testing.assert_allclose(ours.images[number].cam_from_world().matrix(), pose, atol=1e-11)
    assert ours.compute_mean_reprojection_error() < 1e-8


@pytest.mark.parametrize("seed", range(300))
def test_changed_files_are_read_or_refused(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    kind, part = ("bin", "txt")[seed % 2], PARTS[1 + seed // 2 % 4]
    path = write_model(tmp_path / "sparse", make_views(), kind) / f"{part}.{kind}"
    path.write_bytes(mutate(rng, path.read_bytes()))
    try:
        model = read_colmap(path.parent).transformed(POSE, 2.5)
    except InputError as error:
        message = str(error)
    else:
        message = ""
        write_colmap(tmp_path / "moved", model)
        read_colmap(tmp_path / "moved")
    assert message.isprintable()
    assert not message or re.match(rf"{re.escape(str(tmp_path))}\S+: ", message)


def photographed(rng: np.random.Generator, world: World, place: np.ndarray, span: float) -> np.ndarray:
    """Return points around a place with noise of 0.1 % of the span and 5 % outliers."""
    directions = rng.normal(size=(30_000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    ranges = world.cast(place, directions)
    seen = (place + directions * ranges[:, None])[ranges < 2.5 * span][:20_000]
    seen += 1e-3 * span * rng.normal(size=seen.shape)
    return np.concatenate([seen, rng.uniform(seen.min(axis=0), seen.max(axis=0), (len(seen) // 20, 3))])


@pytest.mark.parametrize("seed", [0, 2])
def test_two_models_are_aligned(tmp_path: Path, seed: int) -> None:
    """The scale to 0.1 %, the rotation to 0.1 degrees."""
    rng = np.random.default_rng(seed)
    world, span, place = worlds._WORLDS["wood"](rng)
    first, second = (photographed(rng, world, pose[:3, 3], span) for pose in place.choose(rng, level=True))
    seen = make_views()._replace(points=apply(POSE, first / 2.5))
    model = read_colmap(write_model(tmp_path / "first", seen, "bin"))
    done = register(model, second, scale=True)
    scale, pose = split_scale(done.T_target_source)
    assert scale == pytest.approx(2.5, rel=1e-3)
    assert rotation_error(pose, invert(POSE)) < 0.1
    rigid = done.T_target_source.copy()
    rigid[:3, :3] /= done.scale
    np.testing.assert_allclose(model.transformed(rigid, done.scale).points, first, atol=2e-3 * np.ptp(first))


def test_refusals(tmp_path: Path) -> None:
    folder = write_model(tmp_path / "sparse", make_views(), "txt")
    model = read_colmap(folder)
    with pytest.raises(InputError, match=r"sparse: exists already; give the name of a new folder"):
        write_colmap(folder, model)
    with pytest.raises(InputError, match="can't be written"):
        write_colmap(tmp_path / "no" / "folder", model)
    with pytest.raises(InputError, match=r"^scale: got 0.0; "):
        model.transformed(POSE, 0)
    with pytest.raises(InputError, match=r"^pose: .*scaled by 2"):
        model.transformed(np.diag([2.0, 2, 2, 1]))
    (folder / "images.txt").write_text("1 1 0 0 0 0 0 4 1\n\n")
    with pytest.raises(InputError, match="an image without a name"):
        read_colmap(folder)
    (folder / "points3D.txt").write_text("1 0 0 0 1 2 256 0.5\n")
    with pytest.raises(InputError, match="points3D.txt: .*a colour that is not from 0 to 255"):
        read_cloud(folder / "points3D.txt")
    (folder / "images.txt").unlink()
    with pytest.raises(InputError, match=r"sparse: no model of COLMAP; it has cameras, images, points3D as"):
        read_colmap(folder)


def test_an_empty_model(tmp_path: Path) -> None:
    folder = write_model(tmp_path / "sparse", Views(np.empty((0, 3)), [], np.eye(4)), "bin")
    assert len(read_colmap(folder).transformed(POSE, 2).points) == 0
    with pytest.raises(InputError, match="holds no points"):
        read_cloud(folder / "points3D.bin")


@pytest.mark.parametrize("number", ["nan", "inf", "1e999"])
def test_poses_that_are_not_finite_are_refused(tmp_path: Path, number: str) -> None:
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 40 30 20 20 20 15\n")
    (tmp_path / "images.txt").write_text(f"1 1 0 0 0 0 {number} 4 1 a.png\n\n")
    (tmp_path / "points3D.txt").write_text("1 1 2 3 90 90 90 0.5 1 0\n")
    with pytest.raises(InputError, match=r"images\.txt: .*a pose that is not finite"):
        read_colmap(tmp_path)
