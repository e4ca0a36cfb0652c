"""Poses are read in every notation that people have them in; what could be misread is refused."""

import json
from pathlib import Path

import numpy as np
import pytest

from cgroup.errors import InputError
from cgroup.io import read_transform, read_transforms
from cgroup.rigid import apply, check_rigid, rotation_error
from strategies import rigid

HALF = np.deg2rad(35) / 2
AXIS = np.array([2.0, -1.0, 2.0]) / 3
QUATERNION = [*(np.sin(HALF) * AXIS), np.cos(HALF)]
TRANSLATION = [0.5, -12.25, 3e-3]


POSE = rigid(AXIS, 35, TRANSLATION)
OTHER = np.eye(4)
OTHER[:3, 3] = 1, 2, 3
WORDS = [[repr(float(number)) for number in row] for row in POSE]
SEVEN = " ".join(repr(float(number)) for number in [*TRANSLATION, *QUATERNION])


def rows(matrix: list[list[str]], separator: str = " ") -> str:
    return "\n".join(separator.join(row) for row in matrix)


TEXTS = {
    "4x4": rows(WORDS),
    "3x4": rows(WORDS[:3]),
    "16 numbers": " ".join([word for row in WORDS for word in row]),
    "12 numbers, as KITTI has them": " ".join([word for row in WORDS[:3] for word in row]) + "\n",
    "12 lines": "\n".join([word for row in WORDS[:3] for word in row]),
    "7 numbers": SEVEN,
    "7 lines": SEVEN.replace(" ", "\n"),
    "TUM": "# timestamp tx ty tz qx qy qz qw\n1305031102.1758 " + SEVEN,
    "semicolons": rows(WORDS, ";"),
    "as NumPy prints": np.array2string(POSE, floatmode="unique"),
    "nested lists": json.dumps(POSE.tolist()),
    "a list": json.dumps(POSE[:3].ravel().tolist(), indent=1),
    "an object": json.dumps({"name": "a on b", "T_target_source": POSE.tolist()}),
    "round brackets": f"({SEVEN.replace(' ', ', ')})",
    "a mark and comments": "\ufeff// from a to b\n" + rows(WORDS) + "\n# end\n",
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS.keys())
def test_all_notations_mean_the_same(text: str, tmp_path: Path) -> None:
    (tmp_path / "pose.txt").write_text(text, encoding="utf-8")
    np.testing.assert_allclose(read_transform(tmp_path / "pose.txt"), POSE, rtol=0, atol=1e-15)


def test_arrays_of_all_shapes(tmp_path: Path) -> None:
    for array in (POSE, POSE.ravel(), POSE[None], POSE[:3], POSE[:3].reshape(1, 12)):
        np.save(tmp_path / "pose.npy", array)
        (tmp_path / "pose.json").write_text(json.dumps(array.tolist()))
        for suffix in ("npy", "json"):
            np.testing.assert_array_equal(read_transform(tmp_path / f"pose.{suffix}"), POSE)


def test_few_digits_of_a_quaternion_are_made_one(tmp_path: Path) -> None:
    (tmp_path / "pose.txt").write_text("0 0 0 " + " ".join(f"{number:.4f}" for number in QUATERNION))
    found = read_transform(tmp_path / "pose.txt")
    np.testing.assert_allclose(found[:3, :3].T @ found[:3, :3], np.eye(3), atol=1e-15)
    assert rotation_error(found, rigid(AXIS, 35)) < 0.01


TRAJECTORIES = {
    "KITTI": [" ".join(map(repr, pose[:3].ravel().tolist())) for pose in (POSE, OTHER)],
    "TUM": ["0.1 " + SEVEN, "0.2 1 2 3 0 0 0 1"],
    "7 numbers": [SEVEN, "1 2 3 0 0 0 -1"],
    "16 numbers": [" ".join(map(repr, pose.ravel().tolist())) for pose in (POSE, OTHER)],
    "below each other": [rows([[repr(x) for x in row] for row in pose.tolist()]) for pose in (POSE, OTHER)],
    "nested 3x4": [json.dumps([POSE[:3].tolist(), OTHER[:3].tolist()])],
}


@pytest.mark.parametrize("lines", TRAJECTORIES.values(), ids=TRAJECTORIES.keys())
def test_trajectories_hold_all_poses_in_order(lines: list[str], tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    path.write_text("\n".join(lines))
    np.testing.assert_allclose(read_transforms(path), [POSE, OTHER], rtol=0, atol=1e-15)
    with pytest.raises(InputError, match=r"poses\.txt: holds 2 poses; give a file with one of them"):
        read_transform(path)


COLUMNS_FIRST = POSE.T.ravel().tolist()


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (rows([list(each) for each in zip(*WORDS, strict=True)]), r"last row is .*, not 0 0 0 1; transpose it"),
        (" ".join(map(str, COLUMNS_FIRST)), "its 16 numbers are a pose column by column; transpose it"),
        (" ".join(map(str, POSE[:3].T.ravel())), "its 12 numbers are a pose column by column; transpose it"),
        (rows([row[:3] for row in WORDS]), "got 4 rows of 3 numbers; transpose them"),
        (rows([row[:3] for row in WORDS[:3]]), "got 3 rows of 3 numbers; a pose is 4 rows of 4 numbers, or 3"),
        ("0.1 0.2 0.3 1 2 3", "got 1 row of 6 numbers; a pose is"),
        ("", "the file is empty"),
        ("0 0 0 0 0 0 1.01", "its quaternion is of length 1.01, not 1"),
        ("0.5 0.5 0.5 0.5 10 20 30", "the first four numbers are one: write tx ty tz qx qy qz qw"),
        ("nan 0 0 0 0 0 1", "isn't finite"),
        ("1e300 0 0 0 0 0 1e300", "its quaternion is of length (1e|inf)"),
        ("0 0 0 0 0 0 1\n0 0 0 0 0 0 2\n", r"pose 2 of 2: its quaternion is of length 2, not 1"),
        ("1 0 0 0 0 1 0 0 0 0 1 0\n" * 2 + "2 0 0 0 0 1 0 0 0 0 1 0\n", "pose 3 of 3: .* scaled or sheared"),
        ("1 2 3 4\n5 6 7\n", "line 2: got 3 columns; the first row has 4"),
        ("T = 1 0 0", 'line 1: got "T"'),
        ('{"R": [1], "t": [2]}', "2 of its entries are lists"),
        ("[[1, 2], [3]]", "its lists are of unequal lengths"),
        ("[" * 100_000, "not a readable TXT file"),
    ],
)  # fmt: skip
def test_what_could_be_misread_is_refused(content: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / "pose.txt").write_text(content)
    for read in (read_transform, read_transforms):
        with pytest.raises(InputError, match=reason) as caught:
            read(tmp_path / "pose.txt")
        assert "pose.txt" in str(caught.value)
        assert len(str(caught.value)) - len(str(tmp_path)) < 400


def test_arguments_may_leave_out_the_last_row() -> None:
    np.testing.assert_array_equal(check_rigid(POSE[:3]), POSE)
    np.testing.assert_array_equal(check_rigid(POSE[:3].astype(np.float32))[3], [0, 0, 0, 1])
    assert rotation_error(POSE[:3], POSE) == 0
    np.testing.assert_array_equal(apply(POSE[:3], np.eye(3)), apply(POSE, np.eye(3)))
    for shape in ((4, 3), (16,), (3, 3)):
        with pytest.raises(InputError, match="a rigid transform is a 4x4 matrix, or its first 3 rows"):
            check_rigid(np.zeros(shape))
