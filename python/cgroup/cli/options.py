"""Arguments and options that several commands take, and the words that a shell completes them by."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import typer

from cgroup.cli.saved_runs import check_run, names_of_runs
from cgroup.errors import InputError
from cgroup.io._results import check_folder
from cgroup.registration import Descriptor, Detector, Effort, Normals
from cgroup.registry import METHOD_INFO, METHODS

# Sections of the help texts.
CLOUDS = "Clouds"
SEARCH = "Search"
GROUPING = "Grouping"
KEYPOINTS = "Keypoints and descriptors"
LIMITS = "Limits"
OUTPUT = "Output"

DEFAULT_OUT = Path("out")

_FORMATS = "PLY, PCD, XYZ, TXT, CSV, PTS, OBJ, STL, OFF, KITTI's BIN, NPY, NPZ, LAS, LAZ"
_METHOD_NAMES = f"{', '.join(METHODS)}; in any case, and as tables show them (hough3d, SC2-PCR)"

Front = Literal["dense", "paper"]


def _complete_methods(incomplete: str) -> Iterator[tuple[str, str]]:
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


def argument(metavar: str, help_text: str, **more: Any) -> Any:
    """Describe an argument."""
    return typer.Argument(metavar=metavar, help=help_text, **more)


def option(metavar: str, help_text: str, section: str | None, default: str | None = None, **more: Any) -> Any:
    """Describe an option that takes a value; `default` words a default that is no fixed value."""
    shown = True if default is None else default
    return typer.Option(metavar=metavar, help=help_text, rich_help_panel=section, show_default=shown, **more)


def choice(kind: Any, help_text: str, section: str | None) -> Any:
    """Describe an option that takes one of a few words."""
    return option("|".join(get_args(kind)), help_text, section)


def flag(name: str, help_text: str, section: str | None = OUTPUT, **more: Any) -> Any:
    """Describe an option without a value."""
    return typer.Option(name, help=help_text, rich_help_panel=section, **more)


def _need_plotly(wanted: bool) -> bool:
    """Refuse before there is any work."""
    if wanted and find_spec("plotly") is None:
        message = "--html: needs plotly; pip install 'cgroup[scans]'"
        raise InputError(message)
    return wanted


def _check_folder(out: Path) -> Path:
    return check_folder(out)


_Point = tuple[float, float, float]

SourceArgument = Annotated[Path, argument("SOURCE", f"Cloud to be moved: {_FORMATS}.")]
TargetArgument = Annotated[Path, argument("TARGET", "Cloud that it is moved to, in the same unit.")]
CloudArgument = Annotated[Path, argument("CLOUD", f"Cloud or mesh: {_FORMATS}.")]
ModelsArgument = Annotated[
    list[Path],
    argument("MODEL", f"Whole models, in the scene's unit; meshes are best: {_FORMATS}."),
]
MatchesArgument = Annotated[
    Path,
    argument(
        "MATCHES",
        (
            "Six columns, x y z x' y' z', of text, CSV or NPY; or NPZ with the fields of cgroup's "
            "correspondences."
        ),
    ),
]
RunArgument = Annotated[
    str, argument("NAME", "Name of a saved run, or a file.", autocompletion=_complete_runs)
]
RunsArgument = Annotated[
    list[str], argument("NAME", "Names of saved runs, or files.", autocompletion=_complete_runs)
]

VoxelOption = Annotated[
    float | None,
    option(
        "LENGTH",
        "Edge length of the voxels, in the files' unit; all radii are multiples of it.",
        CLOUDS,
        "leaves about 5,000 voxels",
    ),
]
ViewpointOption = Annotated[
    _Point | None,
    option(
        "X Y Z", "Where the scanner stood in both files, if each is one single scan: tells far more.", CLOUDS
    ),
]
SourceViewpointOption = Annotated[_Point | None, option("X Y Z", "The same of the source alone.", CLOUDS)]
TargetViewpointOption = Annotated[_Point | None, option("X Y Z", "The same of the target alone.", CLOUDS)]
AxisOption = Annotated[
    _Point | None,
    option(
        "X Y Z",
        "Direction that both clouds share, such as gravity; the pose may tilt it by 10 degrees.",
        CLOUDS,
    ),
]
MethodOption = Annotated[
    str, option("NAME", f"Grouping method: {_METHOD_NAMES}.", GROUPING, autocompletion=_complete_methods)
]
ProposingMethodOption = Annotated[
    str | None,
    option(
        "NAME",
        f"Grouping method that proposes poses: {_METHOD_NAMES}.",
        SEARCH,
        "lc, or gtm with the paper's front",
        autocompletion=_complete_methods,
    ),
]
FrontOption = Annotated[
    Front, choice(Front, "Match every voxel by FPFH, or the keypoints of the paper's evaluation.", SEARCH)
]
SupportOption = Annotated[float, option("VOXELS", "Radius that FPFH describes, in voxels.", SEARCH)]
EffortOption = Annotated[Effort, choice(Effort, "How long to search where the pose is not sure.", SEARCH)]
MaxRotationOption = Annotated[
    float, option("DEGREES", "Largest rotation error of a registered pair.", LIMITS, min=0)
]
MaxDisplacementOption = Annotated[
    float,
    option("PR", "Largest mean displacement of the matched points of a registered pair.", LIMITS, min=0),
]
OutOption = Annotated[
    Path, option("FOLDER", "Folder for the results; made if need be.", OUTPUT, callback=_check_folder)
]
SaveOption = Annotated[
    str | None,
    option(
        "NAME",
        "Keep the result for `cgroup results` by this name, or in this file (.json).",
        OUTPUT,
        callback=check_run,
    ),
]
JsonOption = Annotated[bool, flag("--json", "Print one JSON object in place of text.")]
WideOption = Annotated[bool, flag("--wide", "Show all columns, however wide.")]
HtmlOption = Annotated[
    bool,
    flag("--html", "Write a page for the browser too: the clouds to turn around.", callback=_need_plotly),
]

FRONT = {
    "detector": (Detector, "h3d", choice(Detector, "Keypoint detector.", KEYPOINTS)),
    "descriptor": (Descriptor, "shot", choice(Descriptor, "Descriptor.", KEYPOINTS)),
    "normals": (
        Normals,
        "pca",
        choice(
            Normals,
            "Fitted planes that face the origin, those of the mesh (for whole models), or the file's.",
            KEYPOINTS,
        ),
    ),
    "keypoints": (
        int | None,
        None,
        option("COUNT", "How many keypoints to aim at in each cloud.", KEYPOINTS, "all found", min=3),
    ),
    "nms_radius": (
        float | None,
        None,
        option(
            "RADIUS",
            "Radius of the non-maximum suppression in pr: the larger, the fewer keypoints.",
            KEYPOINTS,
            "2.7 for h3d, 1.8 for iss",
        ),
    ),
    "resolution": (
        float | None,
        None,
        option(
            "LENGTH",
            "The unit pr, in the file's unit; clouds to be matched need the same.",
            KEYPOINTS,
            "mean point spacing of the cloud",
        ),
    ),
}
"""Type, default and description of each option of the paper's front end; `command` adds them."""
