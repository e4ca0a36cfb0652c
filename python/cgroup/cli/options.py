"""Arguments and options that several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import typer

from cgroup.cli.completion import complete_methods
from cgroup.registration import Descriptor, Detector, Effort, Normals
from cgroup.registry import METHODS

_FORMATS = "PLY, PCD, XYZ, TXT, CSV, PTS, OBJ, STL, OFF, KITTI's BIN, NPY, NPZ, LAS, LAZ"

# Sections of the help texts.
CLOUDS = "Clouds"
SEARCH = "Search"
GROUPING = "Grouping"
KEYPOINTS = "Keypoints and descriptors"
LIMITS = "Limits"
OUTPUT = "Output"


def _choices(kind: Any) -> str:  # noqa: ANN401 - a Literal
    return "|".join(get_args(kind))


Front = Literal["dense", "paper"]

SourceArgument = Annotated[
    Path, typer.Argument(metavar="SOURCE", help=f"Cloud to be moved: {_FORMATS}.", show_default=False)
]
TargetArgument = Annotated[
    Path,
    typer.Argument(metavar="TARGET", help="Cloud that it is moved to, in the same unit.", show_default=False),
]
CloudArgument = Annotated[
    Path, typer.Argument(metavar="CLOUD", help=f"Cloud or mesh: {_FORMATS}.", show_default=False)
]
ModelsArgument = Annotated[
    list[Path],
    typer.Argument(
        metavar="MODEL",
        help=f"Whole models, in the scene's unit; meshes are best: {_FORMATS}.",
        show_default=False,
    ),
]
MatchesArgument = Annotated[
    Path,
    typer.Argument(
        metavar="MATCHES",
        help=(
            "Six columns, x y z x' y' z', of text, CSV or NPY; or NPZ with the fields of cgroup's "
            "correspondences."
        ),
        show_default=False,
    ),
]

METHOD_NAMES = f"{', '.join(METHODS)}; in any case, and as tables show them (hough3d, SC2-PCR)"
MethodOption = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help=f"Grouping method: {METHOD_NAMES}.",
        autocompletion=complete_methods,
        rich_help_panel=GROUPING,
    ),
]
ProposingMethodOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help=f"Grouping method that proposes poses: {METHOD_NAMES}.",
        show_default="lc, or gtm with the paper's front",
        autocompletion=complete_methods,
        rich_help_panel=SEARCH,
    ),
]
DetectorOption = Annotated[
    Detector,
    typer.Option(metavar=_choices(Detector), help="Keypoint detector.", rich_help_panel=KEYPOINTS),
]
DescriptorOption = Annotated[
    Descriptor,
    typer.Option(metavar=_choices(Descriptor), help="Descriptor.", rich_help_panel=KEYPOINTS),
]
NormalsOption = Annotated[
    Normals,
    typer.Option(
        metavar=_choices(Normals),
        help="Fitted planes that face the origin, those of the mesh (for whole models), or the file's.",
        rich_help_panel=KEYPOINTS,
    ),
]
KeypointsOption = Annotated[
    int | None,
    typer.Option(
        min=3,
        metavar="COUNT",
        help="How many keypoints to aim at in each cloud.",
        show_default="all found",
        rich_help_panel=KEYPOINTS,
    ),
]
NmsRadiusOption = Annotated[
    float | None,
    typer.Option(
        metavar="RADIUS",
        help="Radius of the non-maximum suppression in pr: the larger, the fewer keypoints.",
        show_default="2.7 for h3d, 1.8 for iss",
        rich_help_panel=KEYPOINTS,
    ),
]
ResolutionOption = Annotated[
    float | None,
    typer.Option(
        metavar="LENGTH",
        help="The unit pr, in the file's unit; clouds to be matched need the same.",
        show_default="mean point spacing of the cloud",
        rich_help_panel=KEYPOINTS,
    ),
]
MaxRotationOption = Annotated[
    float,
    typer.Option(
        min=0,
        metavar="DEGREES",
        help="Largest rotation error of a registered pair.",
        rich_help_panel=LIMITS,
    ),
]
MaxDisplacementOption = Annotated[
    float,
    typer.Option(
        min=0,
        metavar="PR",
        help="Largest mean displacement of the matched points of a registered pair.",
        rich_help_panel=LIMITS,
    ),
]
FrontOption = Annotated[
    Front,
    typer.Option(
        metavar=_choices(Front),
        help="Match every voxel by FPFH, or the keypoints of the paper's evaluation.",
        rich_help_panel=SEARCH,
    ),
]
VoxelOption = Annotated[
    float | None,
    typer.Option(
        metavar="LENGTH",
        help="Edge length of the voxels, in the files' unit; all radii are multiples of it.",
        show_default="leaves about 5,000 voxels",
        rich_help_panel=CLOUDS,
    ),
]
SupportOption = Annotated[
    float,
    typer.Option(metavar="VOXELS", help="Radius that FPFH describes, in voxels.", rich_help_panel=SEARCH),
]
ViewpointOption = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        metavar="X Y Z",
        help="Where the scanner stood in both files, if each is one single scan: tells far more.",
        rich_help_panel=CLOUDS,
    ),
]
SceneViewpointOption = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        metavar="X Y Z",
        help="Where the scanner stood, if the scene is one single scan: tells far more.",
        rich_help_panel=CLOUDS,
    ),
]
SourceViewpointOption = Annotated[
    tuple[float, float, float] | None,
    typer.Option(metavar="X Y Z", help="The same of the source alone.", rich_help_panel=CLOUDS),
]
TargetViewpointOption = Annotated[
    tuple[float, float, float] | None,
    typer.Option(metavar="X Y Z", help="The same of the target alone.", rich_help_panel=CLOUDS),
]
AxisOption = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        metavar="X Y Z",
        help="Direction that both clouds share, such as gravity; the pose may tilt it by 10 degrees.",
        rich_help_panel=CLOUDS,
    ),
]
EffortOption = Annotated[
    Effort,
    typer.Option(
        metavar=_choices(Effort),
        help="How long to search where the pose is not sure.",
        rich_help_panel=SEARCH,
    ),
]
OutOption = Annotated[
    Path,
    typer.Option(metavar="FOLDER", help="Folder for the results; made if need be.", rich_help_panel=OUTPUT),
]
JsonOption = Annotated[
    bool,
    typer.Option("--json", help="Print one JSON object in place of text.", rich_help_panel=OUTPUT),
]
WideOption = Annotated[
    bool,
    typer.Option("--wide", help="Show all columns, however wide.", rich_help_panel=OUTPUT),
]
SaveOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Keep the result for `cgroup results` by this name, or in this file (.json).",
        rich_help_panel=OUTPUT,
    ),
]

DEFAULT_OUT = Path("out")
