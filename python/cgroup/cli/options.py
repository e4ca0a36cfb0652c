"""Arguments and options that several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from cgroup.registration import Descriptor, Detector, Effort, Normals
from cgroup.registry import METHODS

_FORMATS = "PLY, PCD, XYZ, TXT, CSV, PTS, OBJ, STL, OFF, KITTI's BIN, NPY, NPZ, LAS, LAZ"

SourceArgument = Annotated[Path, typer.Argument(help=f"Cloud to be moved: {_FORMATS}.")]
TargetArgument = Annotated[Path, typer.Argument(help="Cloud that it is moved to, in the same unit.")]
CloudArgument = Annotated[Path, typer.Argument(help=f"Cloud or mesh: {_FORMATS}.")]
MethodOption = Annotated[str, typer.Option(help=f"Grouping method: {', '.join(METHODS)}.")]
DetectorOption = Annotated[Detector, typer.Option(help="Keypoint detector.")]
DescriptorOption = Annotated[Descriptor, typer.Option(help="Descriptor.")]
NormalsOption = Annotated[
    Normals,
    typer.Option(
        help="Fitted planes that face the origin, those of the mesh (for whole models), or the file's."
    ),
]
KeypointsOption = Annotated[
    int | None,
    typer.Option(min=3, help="How many keypoints to aim at in each cloud.", show_default="all found"),
]
NmsRadiusOption = Annotated[
    float | None,
    typer.Option(
        help="Radius of the non-maximum suppression in pr: the larger, the fewer keypoints.",
        show_default="2.7 for h3d, 1.8 for iss",
    ),
]
MaxRotationOption = Annotated[
    float, typer.Option(min=0, help="Largest rotation error of a registered pair, in degrees.")
]
MaxDisplacementOption = Annotated[
    float,
    typer.Option(min=0, help="Largest mean displacement of the matched points of a registered pair, in pr."),
]
ResolutionOption = Annotated[
    float | None,
    typer.Option(
        help="The unit pr, in the file's unit; clouds to be matched need the same.",
        show_default="mean point spacing of the cloud",
    ),
]
FrontOption = Annotated[
    Literal["dense", "paper"],
    typer.Option(help="Match every voxel by FPFH, or the keypoints of the paper's evaluation."),
]
VoxelOption = Annotated[
    float | None,
    typer.Option(
        help="Edge length of the voxels, in the files' unit; all radii are multiples of it.",
        show_default="leaves about 5,000 voxels",
    ),
]
SupportOption = Annotated[float, typer.Option(help="Radius that FPFH describes, in voxels.")]
ViewpointOption = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        metavar="X Y Z",
        help="Where the scanner stood in both files, if each is one single scan.",
        show_default="not known",
    ),
]
SourceViewpointOption = Annotated[
    tuple[float, float, float] | None,
    typer.Option(metavar="X Y Z", help="The same of the source alone.", show_default="not known"),
]
TargetViewpointOption = Annotated[
    tuple[float, float, float] | None,
    typer.Option(metavar="X Y Z", help="The same of the target alone.", show_default="not known"),
]
AxisOption = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        metavar="X Y Z",
        help="Direction that both clouds share, such as gravity; the pose may tilt it by 10 degrees.",
        show_default="none",
    ),
]
EffortOption = Annotated[Effort, typer.Option(help="How long to search where the pose is not sure.")]
OutOption = Annotated[Path, typer.Option(help="Folder for the results; made if need be.")]

DEFAULT_OUT = Path("out")
