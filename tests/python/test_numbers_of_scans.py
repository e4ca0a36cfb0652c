"""One numbering: what ``merge`` and `Scene.write` write scores alike in ``evaluate``, whatever the scans are called."""

import itertools
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_lines import succeed
from test_evaluate import random_pose

from cgroup.cli.documents import as_text, make_document
from cgroup.io import write_file
from cgroup.io.transforms import format_log
from cgroup.pose_graph.files import motion_lines
from cgroup.registration.decoys import count_false_accepts
from cgroup.rigid import invert
from cgroup.scenes import Scene
from cgroup.types import FloatArray

NAMES = {
    "numbered": [f"scan_{row:03d}.ply" for row in range(12)],
    "as the shell sorts": sorted(f"scan_{row}.ply" for row in range(12)),
    "every other": [f"vlp_{8 + 2 * row:02d}.ply" for row in range(12)],
    "times": [f"{1326030975726043 + 200000 * row}.bin" for row in range(12)],
    "words": [f"{letter}.ply" for letter in "lkjihgfedcba"],
    "alike": [f"{letter}_7.ply" for letter in "abcdefghijkl"],
}
FORMS = ("tum", "kitti", "log", "g2o", "json", "merge")
COMPONENTS = [[1, 4, 5, 7, 9, 11], [2, 3]]
TRUE = np.array([random_pose(np.random.default_rng(row)) for row in range(12)])


def write_results(scene: Scene, form: str) -> Path:
    """Write the first component in a format, as the command or the class does."""
    path = Path(f"found.{form}")
    if form != "merge":
        scene.write(path)
        return path
    component = {row: k for k, rows in enumerate(scene.components) for row in rows}
    scans = [
        {
            "name": name,
            "component": component.get(row),
            "T_component_scan": pose if row in component else None,
        }
        for row, (name, pose) in enumerate(zip(scene.names, scene.poses, strict=True))
    ]
    path = Path("found.json")
    write_file(path, as_text(make_document("merge", results={"scans": scans})).encode())
    return path


def write_truth(kind: str, scene: Scene) -> Path:
    """Write all true poses: by row, as tools that know no names do, or with names, or by the numbers in names."""
    if kind == "named":
        replace(scene, poses=TRUE, components=[[*range(12)]]).write("truth.tum")
        return Path("truth.tum")
    if kind == "pairs":
        numbers = [int("".join(filter(str.isdigit, Path(name).stem.split(".")[0]))) for name in scene.names]
        pairs = [*itertools.combinations(range(12), 2)]
        poses = np.array([invert(TRUE[i]) @ TRUE[j] for i, j in pairs])
        text = format_log(np.array([(numbers[i], numbers[j]) for i, j in pairs]), poses)
        Path("hall").mkdir(exist_ok=True)
        write_file("hall/gt.log", text.encode())
        return Path("hall")
    path = Path(f"truth.{kind}")
    lines = {
        "tum": [f"{row} {line}" for row, line in enumerate(motion_lines(TRUE))],
        "kitti": [" ".join(map(repr, row)) for row in TRUE[:, :3].reshape(12, 12).tolist()],
    }[kind]
    write_file(path, "\n".join(lines).encode())
    return path


def placed(components: list[list[int]], names: list[str]) -> Scene:
    """A scene whose poses are right, each component in the frame of its first scan."""
    poses: FloatArray = np.full((12, 4, 4), np.nan)
    for rows in components:
        poses[rows] = invert(TRUE[rows[0]]) @ TRUE[rows]
    nothing = np.zeros((12, 6, 6))
    return Scene(
        poses,
        components,
        [],
        np.ones(12),
        nothing,
        names,
        (None,) * 12,
        1.0,
        0,
        count_false_accepts([], []),
        (),
        {},
    )  # type: ignore[arg-type]


def score(capsys: pytest.CaptureFixture[str], found: Path, truth: Path) -> dict[str, Any]:
    line = ("evaluate", found, "--protocol", "kitti", "--truth", truth, "--json")
    (scored,) = json.loads(succeed(capsys, *line))["results"]["methods"]
    return scored


@pytest.mark.usefixtures("elsewhere")
@pytest.mark.parametrize("called", NAMES)
@pytest.mark.parametrize("kind", ["tum", "kitti", "named", "pairs"])
def test_a_right_scene_scores_right(capsys: pytest.CaptureFixture[str], kind: str, called: str) -> None:
    """Every pair of the component that is written is right, and no other counts as wrong."""
    if kind == "pairs" and called in ("words", "alike"):
        return  # lists of pairs have numbers alone, and these names have none that differ
    scene = placed(COMPONENTS, NAMES[called])
    truth = write_truth(kind, scene)
    for form in FORMS:
        scored = score(capsys, write_results(scene, form), truth)
        right = 16 if form == "merge" else 15
        assert (scored["right"], scored["wrong"]) == (right, 0)
        assert scored["refused"] + scored["missing"] == 66 - right


def test_the_folder_of_a_scene_scores_as_its_poses_do(
    elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = placed(COMPONENTS, NAMES["every other"])
    truth, out = write_truth("tum", scene), elsewhere / "out"
    out.mkdir()
    for number, component in (("", 0), ("_2", 1)):
        scene.write(out / f"poses{number}.tum", component=component)
        scene.write(out / f"graph{number}.g2o", component=component)
    scored = score(capsys, out, truth)
    assert (scored["right"], scored["wrong"]) == (16, 0)


def test_two_merges_of_the_same_scans_are_compared_by_name(
    elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In whatever order they were given."""
    scene = placed([[*range(12)]], NAMES["words"])
    order = np.random.default_rng(0).permutation(12)
    other = replace(scene, poses=scene.poses[order], names=[scene.names[row] for row in order])
    other.write(elsewhere / "other.tum")
    for form in FORMS:
        scored = score(capsys, write_results(scene, form), elsewhere / "other.tum")
        assert (scored["right"], scored["wrong"]) == (66, 0)
