"""Arguments and options that several commands take, and the words that a shell completes them by."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_args

import typer

from cgroup.cli.saved_runs import check_run, names_of_runs
from cgroup.errors import InputError
from cgroup.io._results import check_folder
from cgroup.registration import Descriptor, Detector, Normals
from cgroup.registry import METHOD_INFO, METHODS

# Sections of the help texts.
CLOUDS = "Clouds"
SEARCH = "Search"
GROUPING = "Grouping"
KEYPOINTS = "Keypoints and descriptors"
OUTPUT = "Output"

FORMATS = (
    "PLY, PCD, XYZ, ASC, TXT, CSV, PTS, PTX, E57, OBJ, STL, OFF, VTK, GLTF, GLB, "
    "KITTI's BIN, NPY, NPZ, LAS, LAZ"
)
METHOD_NAMES = f"{', '.join(METHODS)}; in any case, and as tables show them (hough3d, SC2-PCR)"


def complete_methods(incomplete: str) -> Iterator[tuple[str, str]]:
    """Offer the names of methods, in the case that was begun with."""
    for name, info in METHOD_INFO.items():
        offered = name.upper() if incomplete.isupper() else name
        if offered.startswith(incomplete):
            yield offered, f"{info.label}, {info.citation}"


def complete_presets(incomplete: str) -> Iterator[str]:
    """Offer the configurations that come with the package; files are the shell's own."""
    for entry in (resources.files("cgroup.benchmark") / "presets").iterdir():
        name, dot, suffix = entry.name.partition(".")
        if dot and suffix == "toml" and name.startswith(incomplete):
            yield name


def _complete_runs(incomplete: str) -> Iterator[str]:
    return (name for name in names_of_runs() if name.startswith(incomplete))


def argument(metavar: str, help_text: str, default: Any = ..., **more: Any) -> Any:
    """Describe an argument; it is required unless it has a default."""
    return typer.Argument(default, metavar=metavar, help=help_text, **more)


def option(
    default: Any, metavar: str, help_text: str, section: str | None, shown: str | None = None, **more: Any
) -> Any:
    """Describe an option that takes a value; `shown` words a default that is no fixed value."""
    show_default = shown or True
    return typer.Option(
        default, metavar=metavar, help=help_text, rich_help_panel=section, show_default=show_default, **more
    )


def choice(default: str, kind: Any, help_text: str, section: str | None) -> Any:
    """Describe an option that takes one of a few words."""
    return option(default, "|".join(get_args(kind)), help_text, section)


def flag(name: str, help_text: str, section: str | None = OUTPUT, **more: Any) -> Any:
    """Describe an option without a value."""
    return typer.Option(False, name, help=help_text, rich_help_panel=section, **more)


def _need_plotly(wanted: bool) -> bool:
    """Refuse before there is any work."""
    if wanted and find_spec("plotly") is None:
        message = "--html: needs plotly; pip install 'cgroup[scans]'"
        raise InputError(message)
    return wanted


def folder(
    default: str, help_text: str, section: str | None, check: Callable[[Path], Path] = lambda path: path
) -> Any:
    """Describe the option of a folder for results, which is checked before there is any work."""

    def look(name: str) -> Path:
        if not name:  # a Path of it would be the current folder
            raise InputError("--out", "an empty name", "give a folder; . is the current one")
        return check(Path(name))

    return option(default, "FOLDER", help_text, section, parser=str, callback=look)


Point = tuple[float, float, float]

SOURCE = argument("SOURCE", f"Cloud to be moved: {FORMATS}.")
TARGET = argument("TARGET", "Cloud that it is moved to, in the same unit.")
CLOUD = argument("CLOUD", f"Cloud or mesh: {FORMATS}.")
RUN = argument("NAME", "Name of a saved run, or a file.", autocompletion=_complete_runs)
RUNS = argument("NAME", "Names of saved runs, or files.", autocompletion=_complete_runs)

OUT = folder("out", "Folder for the results; made if need be.", OUTPUT, check=check_folder)
SAVE = option(
    None,
    "NAME",
    "Keep the result for `cgroup results` by this name, or in this file (.json).",
    OUTPUT,
    callback=check_run,
)
JSON = flag("--json", "Print one JSON object in place of text.")
VERBOSE = flag("--verbose", "Show the voxel, the matches and the time of each stage too.")
WIDE = flag("--wide", "Show all columns, however wide.")
HTML = flag("--html", "Write a page for the browser too: the clouds to turn around.", callback=_need_plotly)

FRONT = {
    "detector": (Detector, choice("h3d", Detector, "Keypoint detector.", KEYPOINTS)),
    "descriptor": (Descriptor, choice("shot", Descriptor, "Descriptor.", KEYPOINTS)),
    "normals": (
        Normals,
        choice(
            "pca",
            Normals,
            "Fitted planes that face the origin, those of the mesh (for whole models), or the file's.",
            KEYPOINTS,
        ),
    ),
    "keypoints": (
        int | None,
        option(None, "COUNT", "How many keypoints to aim at in each cloud.", KEYPOINTS, "all found", min=3),
    ),
    "nms_radius": (
        float | None,
        option(
            None,
            "RADIUS",
            "Radius of the non-maximum suppression in pr: the larger, the fewer keypoints.",
            KEYPOINTS,
            "2.7 for h3d, 1.8 for iss",
        ),
    ),
    "resolution": (
        float | None,
        option(
            None,
            "LENGTH",
            "The unit pr, in the file's unit; clouds to be matched need the same.",
            KEYPOINTS,
            "mean point spacing of the cloud",
        ),
    ),
}
"""Type and description of each option of the paper's front end; `command` adds them."""
