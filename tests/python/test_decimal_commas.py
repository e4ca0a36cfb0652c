"""Decimal commas in every kind of text: read where it is clear what they are, refused with the line where it isn't."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cgroup import InputError
from cgroup.evaluation.result_files import PairPoses, read_results
from cgroup.io import read_cloud, read_correspondences, read_transform, read_transforms
from cgroup.rigid.transforms import turn

SEPARATORS = [";", "; ", "\t", " ", "  ", " ;\t"]
NUMBERS = st.floats(-1e7, 1e7).map(lambda x: round(x, 4))


def comma(value: float) -> str:
    return repr(float(value)).replace(".", ",")


def lines(rows: np.ndarray, separator: str) -> str:
    return "".join(separator.join(map(comma, row)) + "\n" for row in rows)


@settings(max_examples=60)
@given(
    rows=arrays(float, st.tuples(st.integers(1, 5), st.just(6)), elements=NUMBERS),
    separator=st.sampled_from(SEPARATORS),
    ending=st.sampled_from([".xyz", ".txt", ".csv", ".asc", ".xyzn", ".pts"]),
)
def test_decimal_commas_are_read(
    rows: np.ndarray, separator: str, ending: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("commas")
    cloud, matches = folder / f"cloud{ending}", folder / "matches.csv"
    cloud.write_text(lines(rows, separator))
    np.testing.assert_array_equal(read_cloud(cloud).points, rows[:, :3])
    matches.write_text(f"x;y;z;u;v;w\n{lines(rows, separator)}")
    np.testing.assert_array_equal(read_correspondences(matches).target, rows[:, 3:])
    if ending != ".pts":
        cloud.write_text(f"x;z;y;a;b;c\n{lines(rows, ';')}")
        np.testing.assert_array_equal(read_cloud(cloud).points, rows[:, [0, 2, 1]])


POSE = np.eye(4)
POSE[:3, :3], POSE[:3, 3] = turn(0, 0, 0.6, 0.8), [1.25, -2.5, 300]


@pytest.mark.parametrize("separator", SEPARATORS)
def test_poses_with_decimal_commas_are_read(separator: str, tmp_path: Path) -> None:
    quaternion = np.array([[1.25, -2.5, 300, 0, 0, 0.6, 0.8]])
    for name, rows in {
        "matrix.txt": POSE,
        "kitti.txt": POSE[:3].reshape(1, -1),
        "place.txt": quaternion,
        "poses.tum": np.c_[1.5, quaternion],
    }.items():
        (tmp_path / name).write_text(lines(rows, separator))
        np.testing.assert_allclose(read_transform(tmp_path / name), POSE, atol=1e-15)
    (tmp_path / "drive.tum").write_text(lines(np.c_[[1.5, 2.5], np.repeat(quaternion, 2, axis=0)], separator))
    assert len(read_transforms(tmp_path / "drive.tum")) == 2


@pytest.mark.parametrize("separator", [";", "\t"])
def test_tables_of_results_with_decimal_commas_are_read(separator: str, tmp_path: Path) -> None:
    names = [*(f"t{i}{j}" for i in range(3) for j in range(4))]
    head = separator.join(["scene", "target", "source", *names])
    row = separator.join(["a", "0", "1", *map(comma, POSE[:3].ravel())])
    refused = separator.join(["a", "0", "2", *[""] * 12])
    (tmp_path / "ours.csv").write_text(f"{head}\n{row}\n{refused}\n")
    (found,) = read_results(tmp_path / "ours.csv")
    assert isinstance(found, PairPoses)
    np.testing.assert_array_equal(found.poses[0], POSE)
    assert np.isnan(found.poses[1]).all()
    (tmp_path / "ours.csv").write_text(f"{head}\n{row}\n{row.replace('300,0', '1,300.0')}\n")
    with pytest.raises(InputError, match="ours.csv: line 3 isn't a pair and the numbers"):
        read_results(tmp_path / "ours.csv")


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("1,5, 2,5, 3,5\n", 1),
        ("0 0 0\n1,5 2.5 3\n", 2),
        ("0 0 0\n1, 2,3 4\n", 2),
        ("1,234.5;2,345.6;3,456.7\n", 1),
        ("1.234,5 2.345,6 3.456,7\n", 1),
        ("1,234,567 2,345,678 3\n", 1),
        ("# x y z\n38,0273,53,2165,37,5062\n", 2),
        ("1,2,3\n\n1,5 2,5 3,5\n", 3),
        ("1.5 2 3\n1,5 2 3\n", 2),
        ("1,5 2 3\n1 2 3\n1.5 2 3\n", 3),
        ("1\t2.5 3\n4;5,6\n", 2),
    ],
)
def test_what_could_be_read_in_two_ways_is_refused_with_its_line(
    text: str, line: int, tmp_path: Path
) -> None:
    for read, name in (
        (read_cloud, "a.xyz"),
        (read_cloud, "a.csv"),
        (read_cloud, "a.pts"),
        (read_correspondences, "a.txt"),
        (read_transforms, "a.tum"),
    ):
        (tmp_path / name).write_text(text)
        with pytest.raises(InputError, match=rf"{name}: .*line {line}: got .*write decimal points"):
            read(tmp_path / name)


def test_files_that_have_no_commas_refuse_them(tmp_path: Path) -> None:
    for name, text in {
        "a.ply": "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1,5 2 3\n",
        "a.obj": "v 1,5 2 3\n",
        "a.off": "OFF\n1 0 0\n1,5 2 3\n",
        "a.pcd": "VERSION .5\nFIELDS x y z\nWIDTH 1\nDATA ascii\n1,5 2 3\n",
        "a.vtk": "# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINTS 1 float\n1,5 2 3\n",
    }.items():
        (tmp_path / name).write_text(text)
        with pytest.raises(InputError, match=r'line \d+: got "1,5"; a number belongs there'):
            read_cloud(tmp_path / name)
