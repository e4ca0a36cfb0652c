"""Arguments and options that several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cgroup.errors import InputError
from cgroup.registration import Descriptor, Detector, Normals
from cgroup.registry import METHODS

_FORMATS = "PLY, PCD, XYZ, OBJ, STL, OFF"

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
OutOption = Annotated[Path, typer.Option(help="Folder for the results; made if need be.")]

DEFAULT_OUT = Path("out")


def check_method(method: str) -> None:
    """Raise `InputError` for a method that doesn't exist."""
    if method not in METHODS:
        message = f"method: got {method!r}; choose one of {', '.join(METHODS)}"
        raise InputError(message)
