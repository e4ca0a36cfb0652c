"""Arguments and options of the commands, each described once, and the words that a shell completes."""

from collections.abc import Callable, Iterator
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_args

import typer

from cgroup.errors import InputError
from cgroup.io.result_folders import check_folder
from cgroup.registration import Descriptor, Detector, Effort, Normals
from cgroup.registry import METHOD_INFO, METHODS

CLOUDS = "Clouds"
SEARCH = "Search"
GROUPING = "Grouping"
KEYPOINTS = "Keypoints and descriptors"
TRUTH = "Truth"
TARGETS = "Surveyed targets"
OUTPUT = "Output"

FORMATS = (
    "PLY, PCD, XYZ, ASC, TXT, CSV, PTS, PTX, E57, OBJ, STL, OFF, VTK, GLTF, GLB, "
    "KITTI's BIN, NPY, NPZ, LAS, LAZ, COLMAP's points3D"
)
METHOD_NAMES = f"{', '.join(METHODS)}; in any case, or as in tables (hough3d, SC2-PCR)"


def complete_methods(incomplete: str) -> Iterator[tuple[str, str]]:
    """Yield matching method names, in upper case if the word is."""
    for name, info in METHOD_INFO.items():
        offered = name.upper() if incomplete.isupper() else name
        if offered.startswith(incomplete):
            yield offered, f"{info.label}, {info.citation}"


def complete_presets(incomplete: str) -> Iterator[str]:
    """Yield matching configurations of the package; the shell completes files."""
    for entry in (resources.files("cgroup.benchmark") / "presets").iterdir():
        name, dot, suffix = entry.name.partition(".")
        if dot and suffix == "toml" and name.startswith(incomplete):
            yield name


def argument(metavar: str, help_text: str, default: Any = ..., **more: Any) -> Any:
    """Describe an argument; it is required unless it has a default."""
    return typer.Argument(default, metavar=metavar, help=help_text, **more)


def option(
    metavar: str, text: str, section: str | None, shown: str | None = None, default: Any = None, **more: Any
) -> Any:
    """Describe an option with a value; `shown` replaces the default in the help text."""
    more |= {"metavar": metavar, "help": text, "rich_help_panel": section, "show_default": shown or True}
    return typer.Option(default, **more)


def choice(default: str, kind: Any, help_text: str, section: str | None) -> Any:
    """Describe an option that takes one of a few words."""
    return option("|".join(get_args(kind)), help_text, section, default=default)


def flag(
    name: str, help_text: str, section: str | None = OUTPUT, *, needs: str = "", extra: str = "scans"
) -> Any:
    """Describe an option without a value; it is refused before the work begins without a needed library."""

    def check(wanted: bool) -> bool:
        if wanted and needs and find_spec(needs) is None:
            message = f"{name}: needs {needs}; pip install 'cgroup[{extra}]'"
            raise InputError(message)
        return wanted

    return typer.Option(False, name, help=help_text, rich_help_panel=section, callback=check)


def folder(
    default: str, help_text: str, section: str | None, check: Callable[[Path], Path] = lambda path: path
) -> Any:
    """Describe the option of an output folder, which is checked before the work begins."""

    def look(name: str) -> Path:
        if not name:  # a Path of it would be the current folder
            raise InputError("--out", "an empty name", "give a folder; . is the current one")
        return check(Path(name))

    return option("FOLDER", help_text, section, default=default, parser=str, callback=look)


def _length(help_text: str, section: str, shown: str | None = None) -> tuple[Any, Any]:
    return float | None, option("LENGTH", help_text, section, shown)


def _box(role: str) -> tuple[Any, Any]:
    text = f"Box of the {role}'s points that are used, in its frame: least x y z, then greatest."
    return tuple[float, float, float, float, float, float] | None, option("X Y Z X Y Z", text, CLOUDS, "all")


def _point(help_text: str, shown: str | None = None) -> tuple[Any, Any]:
    return Point | None, option("X Y Z", help_text, CLOUDS, shown)


Point = tuple[float, float, float]

DRAW_GUESS = "; --html draws the best guess"
GIVE_VIEWPOINT = "; for single scans, give the scanner position: --viewpoint"

SOURCE = argument("SOURCE", f"Cloud to move: {FORMATS}.")
TARGET = argument("TARGET", "Cloud that stays, in the same unit.")
CLOUD = argument("CLOUD", f"Cloud or mesh: {FORMATS}.")

OUT = folder("out", "Folder for the results; created if needed.", OUTPUT, check=check_folder)
JSON = flag("--json", "Print one JSON object instead of text.")
VERBOSE = flag("--verbose", "Print voxel, matches and the time of each stage too.")
WIDE = flag("--wide", "Print all columns, whatever their width.")
HTML = flag("--html", "Write an interactive page for the browser too.", needs="plotly")

# Shared options of the paper's feature extraction.
FRONT = ("detector", "descriptor", "normals", "keypoints", "nms_radius", "resolution")
VIEW = ("viewpoint", "view_direction", "axis")  # shared options about the scanner
SHARED: dict[str, tuple[Any, Any]] = {
    "voxel": _length(
        "Edge length of the voxels, in the files' unit; all radii are multiples of it.",
        CLOUDS,
        "chosen from the clouds",
    ),
    "viewpoint": _point(
        "Scanner position, if each cloud is one single scan; helps most.", "that of the file, if any"
    ),
    "source_viewpoint": _point("Scanner position of the source alone."),
    "target_viewpoint": _point("Scanner position of the target alone."),
    "view_direction": _point("Viewing direction of the scanner, if its position is unknown."),
    "axis": _point("Direction that all clouds share, such as gravity; poses may tilt it by 10 degrees."),
    "free": (
        str | None,
        option(
            "NAMES",
            "Parameters to estimate, of roll,pitch,yaw,x,y,z; others keep --initial's values, or zero.",
            SEARCH,
            "all",
        ),
    ),
    "source_crop": _box("source"),
    "target_crop": _box("target"),
    "effort": (Effort, choice("normal", Effort, "Search effort where a pose is uncertain.", SEARCH)),
    "detector": (Detector, choice("h3d", Detector, "Keypoint detector.", KEYPOINTS)),
    "descriptor": (Descriptor, choice("shot", Descriptor, "Descriptor.", KEYPOINTS)),
    "normals": (
        Normals,
        choice(
            "pca",
            Normals,
            "Normals: fitted planes facing the origin, the mesh's (for whole models), or the file's.",
            KEYPOINTS,
        ),
    ),
    "keypoints": (
        int | None,
        option("COUNT", "Approximate number of keypoints per cloud.", KEYPOINTS, "all", min=3),
    ),
    "nms_radius": (
        float | None,
        option(
            "RADIUS",
            "Radius of the non-maximum suppression, in pr; a larger one leaves fewer keypoints.",
            KEYPOINTS,
            "2.7 for h3d, 1.8 for iss",
        ),
    ),
    "resolution": _length(
        "The unit pr, in the files' unit; the same for clouds that are matched.",
        KEYPOINTS,
        "mean point spacing of the cloud",
    ),
}
"""Types and descriptions of the options that commands take by name and pass to the library; see `command`."""
