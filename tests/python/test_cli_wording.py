"""Errors on the command line speak of its options, never of Python's parameters."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import typer.main
from command_lines import fail, run, write_inputs

from cgroup import METHODS
from cgroup.cli import app
from cgroup.cli.errors import in_options
from cgroup.datasets import standin_pair
from cgroup.errors import CgroupError, InputError, NoConsensusError
from cgroup.io import write_cloud

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.usefixtures("elsewhere")

OPTIONS = {
    "voxel": "--voxel",
    "nms_radius": "--nms-radius",
    "resolution": "--resolution",
    "tolerance": "--tolerance",
    "effort": "--effort",
}

PYTHON = re.compile(
    r"`|\w=['\"\w(]|\bcgroup\.[a-z]\w*|\bfeatures\.|\bNone\b|\bTrue\b|\bPointCloud\b|\bCorrespondences\b"
    r"|^cgroup: (?!source_lrf|target_lrf)[a-z]+_[a-z_]+: "
)
"""What belongs into a program, and not on the command line; files have fields of those two names."""

BASES = {
    "register": "register {source} {target}",
    "compare": "compare {source} {target} --truth {truth}",
    "recognize": "recognize {source} --scene {target}",
    "locate": "locate {source} --map {target}",
    "detect": "detect {source}",
    "describe": "describe {source}",
    "group": "group {matches}",
}
LENGTHS = ("-1", "nan", "1e-300", "1e300")
NUMBERS = {
    **dict.fromkeys(("LENGTH", "RADIUS", "VOXELS", "PR", "DEGREES"), LENGTHS),
    "X Y Z": ("nan 0 0", "1e300 0 0"),
}
"""Wrong values of options, by what stands for the value in the help."""

CLOUDS = ("same", "line", "few", "twice", "huge", "far", "random")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return all files of the command lines by name."""
    path = tmp_path_factory.mktemp("input")
    write_inputs(path)
    rng = np.random.default_rng(0)
    points = rng.uniform(size=(300, 3))
    clouds = {
        "same": np.ones((300, 3)),
        "line": np.outer(np.linspace(0, 1, 300), [1, 0, 0]),
        "few": points[:4],
        "twice": np.repeat(points, 2, axis=0),
        "huge": 1e160 * points,
        "far": np.vstack([points, 3 * [1e9]]),
        "random": points,
    }
    for name, cloud in clouds.items():
        np.save(path / f"{name}.npy", cloud)
    pairs = {"source": points, "target": points + 1}
    frames = {"source_lrf": rng.uniform(size=(300, 3, 3)), "target_lrf": rng.uniform(size=(300, 3, 3))}
    np.savez(path / "ratio.npz", **pairs, ratio=np.full(300, 2.0))
    np.savez(path / "spacing.npz", **pairs, resolution=-1.0)
    np.savez(path / "frames.npz", **pairs, **frames, ratio=np.full(300, 0.5), similarity=np.ones(300))
    np.savez(path / "half.npz", **pairs, source_lrf=frames["source_lrf"])
    np.savez(path / "uneven.npz", source=points, target=points[1:])
    np.savez(path / "large.npz", source=1e200 * points, target=points)
    named = {file.stem: file for file in path.iterdir() if file.suffix != ".npz" or file.stem != "matches"}
    return {**named, "matches": path / "matches.txt", "folder": path}


def list_lines() -> Iterator[str]:
    """List command lines that most likely fail: every number that an option takes, and files of all kinds."""
    commands = typer.main.get_command(app).commands
    for name, base in BASES.items():
        for param in commands[name].params:
            paper = (
                " --front paper" if name == "register" and param.name in {"nms_radius", "resolution"} else ""
            )
            for value in NUMBERS.get(param.metavar, ())[: 2 if name == "compare" else None]:
                yield f"{base} {param.opts[0]} {value}{paper}"
    for cloud in CLOUDS:
        yield f"register {{{cloud}}} {{target}}"
        yield f"register {{source}} {{{cloud}}} --front paper"
        yield f"compare {{{cloud}}} {{target}} --truth {{truth}} --normals mesh"
        yield f"recognize {{{cloud}}} --scene {{target}}"
        yield f"recognize {{source}} --scene {{{cloud}}}"
        yield f"recognize {{{cloud}}} --scene {{target}} --viewpoint 0 0 0"
        yield f"locate {{{cloud}}} --map {{target}}"
        yield f"locate {{source}} --map {{{cloud}}}"
        yield f"detect {{{cloud}}}"
        yield f"describe {{{cloud}}} --normals mesh"
    for method in METHODS:
        for matches in ("matches", "frames", "large"):
            yield f"group {{{matches}}} --method {method}"
        for value in ("0", "nan"):
            yield f"group {{frames}} --method {method} --tolerance {value}"
    for matches in ("ratio", "spacing", "half", "uneven"):
        yield f"group {{{matches}}} --method cv"


LINES = list(dict.fromkeys(list_lines()))
FAILING = 150
"""Of those, at least; a line that works shows nothing."""


def test_no_error_speaks_python(files: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    said: dict[str, str] = {}
    for line in LINES:
        status, _, err = run(capsys, *line.format(**files).split())
        assert status in {0, 2, 3}, (line, err)
        assert err.count("\n") == (status != 0), (line, err)
        if status:
            said[line] = err
    assert len(said) >= FAILING
    assert {
        line: err for line, err in said.items() if PYTHON.search(err.replace(str(files["folder"]), ""))
    } == {}


RESOLUTION = "the mean point spacing of the clouds (cgroup describe prints it)"
REWORDED = [
    (InputError("voxel", 0, "give more"), "--voxel: got 0; give more"),
    (InputError("nms_radius, voxel", "both"), "--nms-radius, --voxel: got both"),
    (
        InputError("source", "4 points", "give a larger `voxel`"),
        "source: got 4 points; give a larger --voxel",
    ),
    (NoConsensusError("no pose; `effort='high'` may help"), "no pose; --effort high may help"),
    (InputError("x", remedy="`similarity` is missing"), "x: similarity is missing"),
    (InputError("give a `PointCloud` with them"), "give a file with them"),
    (InputError("/a/voxel: no such file"), "/a/voxel: no such file"),
    (InputError("/a/quo`ted: no such file"), "/a/quo`ted: no such file"),
    (
        InputError("tolerance", "nothing", "give `resolution` (see cgroup.features.resolution)"),
        f"tolerance: not known; give --resolution, {RESOLUTION}, or --tolerance, both in the file's unit",
    ),
    (
        InputError("deviation", "nothing", "give `resolution` (see cgroup.features.resolution)"),
        f"resolution: not known; give --resolution, {RESOLUTION}, in the file's unit",
    ),
    (
        InputError("max_memory", 5, "the graph takes 7 bytes; allow that many, or give fewer"),
        "not enough memory: the graph takes 7 bytes; give fewer",
    ),
]


@pytest.mark.parametrize(("error", "expected"), REWORDED)
def test_errors_in_terms_of_options(error: CgroupError, expected: str) -> None:
    assert str(in_options(error, OPTIONS)) == expected


def test_the_option_that_was_given_is_named(
    files: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    base = BASES["register"].format(**files)
    for option in ("--viewpoint", "--source-viewpoint", "--target-viewpoint"):
        err = fail(capsys, *base.split(), option, "nan", 0, 0)
        assert err.startswith(f"cgroup: {option}: got ")


ADVISED = {"--viewpoint": (0, 0, 0), "--axis": (0, 0, 1), "--effort": ("high",)}


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        ((), {"--viewpoint", "--view-direction"}),
        (("--viewpoint",), {"--axis"}),
        (("--axis", "--effort"), {"--viewpoint", "--view-direction"}),
        (("--viewpoint", "--axis", "--effort"), set()),
    ],
)
def test_advice_never_names_what_was_given(
    given: tuple[str, ...],
    wanted: set[str],
    files: dict[str, Any],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_cloud(tmp_path / "other.ply", standin_pair(seed=5, pixels=60).target)
    options = [word for name in given for word in (name, *ADVISED[name])]
    err = fail(capsys, "register", files["source"], "other.ply", *options, status=3)
    assert "may share too little" in err
    assert wanted <= set(re.findall(r"--[a-z-]+", err)) - {*given}
    assert not [name for name in given if name in err], err
