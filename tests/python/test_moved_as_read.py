"""A moved file is read as the moved points, or moving it is refused: in all notations that readers accept."""

import json
import struct
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_lines import run
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cgroup import InputError
from cgroup.io import merge_files, read_cloud, transform_file, write_cloud
from cgroup.rigid import apply
from cgroup.types import PointCloud

POSE = np.array([[0, -1, 0, 10.0], [1, 0, 0, 20], [0, 0, 1, 30], [0, 0, 0, 1]])
PLY = "ply\nformat ascii 1.0\nelement vertex 2\n{}end_header\n".format(
    "".join(f"property float {axis}\n" for axis in "xyz")
)
PCD = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA {}\n"
STL = "SOLID a\nFACET NORMAL 0 0 1\nOUTER LOOP\n{}ENDLOOP\nENDFACET\nENDSOLID\n".format(
    "".join(f"VERTEX {corner}\n" for corner in ("0 0 0", "1 0 0", "0 1 0"))
)
PTX = "2\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 2 3 .5\n\n4 5 6 .5\n\n"


def check_moved(path: Path, pose: np.ndarray = POSE) -> list[str]:
    out = path.with_name(f"moved_{path.name}")
    notes = transform_file(path, pose, out)
    expected = apply(pose, read_cloud(path).points)
    np.testing.assert_allclose(read_cloud(out).points, expected, rtol=1e-12, atol=1e-6)
    return notes


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("tabs.xyz", "0\t0 0\n1\t0 0\n2 0 0\n"),
        ("blanks.xyz", "1.0\t 2.0\t 3.0\n1.0 2.0 3.0\n"),
        ("label.txt", "x y z label\n1 2 3 wall,north\n4 5 6 roof,east\n"),
        ("letters.txt", "name x y z\nà1 1 2 3\n\u04201 4 5 6\n"),
        ("mark.csv", "\ufeffx,y,z\n1,2,3\n"),
        ("count.pts", "2\n1 2 3 100\n4 5 6 50\n"),
        ("blank.ply", f"{PLY}\n0 0 0\n\n1 0 0\n"),
        ("upper.pcd", PCD.format("ASCII") + "\n0 1 2\n# c\n3 4 5\n"),
        ("lower.pcd", PCD.format("ascii").replace("FIELDS", "fields") + "0 1 2\n3 4 5\n"),
        ("upper.stl", STL),
        ("blank.ptx", PTX),
    ],
)
def test_notations_that_readers_accept(name: str, content: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content, encoding="utf-8")
    check_moved(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("mixed.txt", "1 2 3\n4,5,6\n", "separated as in the first line"),
        ("words.xyz", "a b c\nd e f\n", "numbers with decimal points"),
        ("commas.xyz", "1,5 2,5 3,5\n", "numbers with decimal points"),
        ("short.ply", f"{PLY}0 0 0\n", "the end of the file, 1 records before"),
        ("other.pcd", PCD.format("text") + "0 1 2\n3 4 5\n", "its DATA is 'text'"),
        ("points3D.txt", "1 0.5 0.25 0.125 90 90 90 1\n", "COLMAP model"),
        ("points3D.bin", "0123456789abcdef", "COLMAP model"),
    ],
)
def test_others_are_refused(name: str, content: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=reason):
        transform_file(tmp_path / name, POSE, tmp_path / f"moved_{name}")
    assert [path.name for path in tmp_path.iterdir()] == [name]


CELLS = st.integers(-1000, 1000).map(lambda number: repr(number / 8))
LABELS = st.sampled_from(["wall", "7", "a,b", '"a b"', '"1,2,3"', "ä", "5;6", "é\u00a0x"])


@given(data=st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_text_that_is_read_is_moved_or_refused(data: st.DataObject, tmp_path: Path) -> None:
    separator = data.draw(st.sampled_from([" ", ",", ";", "\t", "  ", " ,", ", ", "\t "]))
    rows = data.draw(st.lists(st.lists(CELLS, min_size=3, max_size=3), min_size=1, max_size=6))
    labels = data.draw(st.lists(LABELS, max_size=2))
    lines = []
    for row in rows:
        own = data.draw(st.sampled_from([separator, separator, separator, " ", ","]))
        lines += data.draw(st.lists(st.sampled_from(["", "# 1 2 3", "//"]), max_size=1))
        lines += [own.join([*row, *labels])]
    names = ["x", "y", "z", "a", "b"][: 3 + len(labels)]
    head = data.draw(st.sampled_from(["", separator.join(names), "# " + separator.join(names)]))
    end = data.draw(st.sampled_from(["\n", "\r\n"]))
    text = end.join([*([head] if head else []), *lines, ""])
    path = tmp_path / f"some{data.draw(st.sampled_from(['.xyz', '.csv', '.txt']))}"
    path.write_bytes(data.draw(st.sampled_from([b"", b"\xef\xbb\xbf"])) + text.encode())
    try:
        read_cloud(path)
    except InputError:
        return  # moving it may be refused or not
    with suppress(InputError):
        check_moved(path)


def test_quoted_commas_are_one_cell(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text('name,x,y,z\n"a,1,2,3,b",5,6,7\n')
    transform_file(path, POSE, tmp_path / "b.csv")
    assert (tmp_path / "b.csv").read_text() == 'name,x,y,z\n"a,1,2,3,b",4.0,25.0,37.0\n'


def test_a_ply_that_needs_doubles_has_no_rest_of_its_first_header(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(PLY.replace("float", "float32").replace("\n", "\r\n").encode() + b"1 2 3\r\n4 5 6\r\n")
    pose = np.eye(4)
    pose[:3, 3] = 4.5e6, 5e6, 300
    assert "written in double precision" in " ".join(check_moved(path, pose))
    content = (tmp_path / "moved_a.ply").read_bytes()
    assert content.endswith(b"\r\n4500001.0 5000002.0 303.0\r\n4500004.0 5000005.0 306.0\r\n")
    assert content.count(b"\n") == content.count(b"\r\n")


def test_files_beside_gltf_are_named_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    parts = {
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    for name, size in (("one", 1.0), ("two", 2.0)):
        Path(name).mkdir()
        Path(name, "scene.bin").write_bytes(struct.pack("<9f", 0, 0, 0, size, 0, 0, 0, size, 0))
        document = {"asset": {"version": "2.0"}, "buffers": [{"uri": "scene.bin", "byteLength": 36}], **parts}
        Path(name, "scene.gltf").write_text(json.dumps(document))
    np.savetxt("pose.txt", POSE)
    status, *_ = run(capsys, "apply", "pose.txt", "one/scene.gltf", "two/scene.gltf", "--out", "moved")
    assert status == 0
    for name in ("one", "two"):
        expected = apply(POSE, read_cloud(f"{name}/scene.gltf").points)
        np.testing.assert_allclose(read_cloud(f"moved/{name}_scene.gltf").points, expected, atol=1e-5)


def test_the_next_apply_keeps_other_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    np.savetxt("pose.txt", POSE)
    for name in ("a.xyz", "b.xyz", "a.xyz"):
        Path(name).write_text("1 2 3\n")
        assert run(capsys, "apply", "pose.txt", name, "--out", "moved")[0] == 0
    assert sorted(path.name for path in Path("moved").glob("[!.]*")) == ["a.xyz", "b.xyz"]


def make_las(path: Path) -> bytes:
    laspy = pytest.importorskip("laspy", reason="LAS is moved by laspy: pip install 'cgroup[las]'")
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.add_extra_dim(laspy.ExtraBytesParams("height", "f4"))
    header.scales = [0.001] * 3
    points = laspy.LasData(header)
    points.x = points.y = points.z = [1.0, 2.0, 3.0]
    points.write(path)
    return path.read_bytes()


@pytest.mark.parametrize("most", [1e12, 1.7e308, np.nan, np.inf, -5.0])
def test_las_with_a_wrong_box_is_refused(most: float, tmp_path: Path) -> None:
    content = bytearray(make_las(tmp_path / "a.las"))
    struct.pack_into("<6d", content, 179, *[most, -most] * 3)
    (tmp_path / "b.las").write_bytes(content)
    with pytest.raises(InputError, match="repair the header"):
        transform_file(tmp_path / "b.las", POSE, tmp_path / "c.las")
    with pytest.raises(InputError, match=r"b\.las: its box, .* repair the header"):
        merge_files([tmp_path / "a.las", tmp_path / "b.las"], [POSE] * 2, tmp_path / "c.laz")


@pytest.mark.parametrize("scale", [0.0, -0.001, np.nan, np.inf])
def test_las_with_a_wrong_scale_is_refused(scale: float, tmp_path: Path) -> None:
    content = bytearray(make_las(tmp_path / "a.las"))
    struct.pack_into("<3d", content, 131, 0.001, 0.001, scale)
    (tmp_path / "b.las").write_bytes(content)
    with pytest.raises(InputError, match="repair the header"):
        transform_file(tmp_path / "b.las", POSE, tmp_path / "c.las")
    with pytest.raises(InputError, match="repair the header"):
        merge_files([tmp_path / "b.las"], [POSE], tmp_path / "c.laz")


def test_merged_files_name_all_that_is_lost(tmp_path: Path) -> None:
    make_las(tmp_path / "a.las")
    assert "a.las: height: not kept" in merge_files([tmp_path / "a.las"], [POSE], tmp_path / "a.e57")
    write_cloud(tmp_path / "b.ply", PointCloud(np.eye(3), normals=np.eye(3), faces=np.array([[0, 1, 2]])))
    lost = merge_files([tmp_path / "b.ply"], [POSE], tmp_path / "b.laz")
    assert lost == ["b.ply: normals: not kept", "b.ply: faces: not kept"]


def test_errors_of_writing_are_not_those_of_an_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_las(tmp_path / "a.las")
    laspy = pytest.importorskip("laspy")

    def refuse(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(laspy.LasWriter, "write_points", refuse)
    with pytest.raises(InputError, match=r"full\.las: can't be written \(No space left"):
        merge_files([tmp_path / "a.las"], [POSE], tmp_path / "full.las")


def test_a_far_viewpoint_moves_no_point(tmp_path: Path) -> None:
    points = np.array([[0.1, 0.2, 0.3], [1, 2, 3]])
    write_cloud(tmp_path / "a.e57", PointCloud(points, viewpoint=np.array([1e16, 0, 0])))
    assert np.array_equal(read_cloud(tmp_path / "a.e57").points, points)


def test_targets_with_grouped_digits_are_refused(tmp_path: Path) -> None:
    from cgroup.io import read_targets  # noqa: PLC0415

    (tmp_path / "a.csv").write_text("A;1 234,5;2 345,5;12,1\nB;1 234,5;2 345,5;12,1\n")
    with pytest.raises(InputError, match="without groups of digits"):
        read_targets(tmp_path / "a.csv")
