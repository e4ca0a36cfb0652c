"""``cgroup detect`` and ``cgroup describe``: keypoints and descriptors of one cloud."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from cgroup import io
from cgroup.cli.help import Command, examples, make_app
from cgroup.cli.inputs import describe_cloud, print_clouds
from cgroup.cli.json_output import Document, make_document
from cgroup.cli.options import (
    DEFAULT_OUT,
    CloudArgument,
    DescriptorOption,
    DetectorOption,
    JsonOption,
    KeypointsOption,
    NmsRadiusOption,
    NormalsOption,
    OutOption,
    ResolutionOption,
)
from cgroup.cli.output import Ending, files_in, options_of, print_files
from cgroup.cli.terminal import print_facts, show_stages, shown_name, write_figure
from cgroup.io._results import check_folder, make_folder
from cgroup.registration import Detector, describe, detect

if TYPE_CHECKING:
    from cgroup.types import IndexArray, PointCloud

_DETECTOR_NAMES: dict[Detector, str] = {"h3d": "Harris 3D", "iss": "ISS"}
_PICTURES = ("keypoints.ply", "keypoints.png")
_DETECT_EXAMPLES = examples(
    "cgroup detect scan.ply",
    "cgroup detect scan.ply --detector iss --keypoints 500 --out keypoints",
)
_DESCRIBE_EXAMPLES = examples(
    "cgroup describe scan.ply --descriptor rcs",
    "",
    "# a whole model, whose faces tell the outside",
    "cgroup describe model.ply --normals mesh --resolution 0.5 --out model",
)

app = make_app()


@app.command("detect", cls=Command, epilog=_DETECT_EXAMPLES)
def detect_command(
    context: typer.Context,
    cloud: CloudArgument,
    *,
    detector: DetectorOption = "h3d",
    keypoints: KeypointsOption = None,
    nms_radius: NmsRadiusOption = None,
    resolution: ResolutionOption = None,
    out: OutOption = DEFAULT_OUT,
    as_json: JsonOption = False,
) -> None:
    """Find the keypoints of one cloud.

    Writes them as arrays, as a coloured cloud and as a picture.
    """
    name, folder = _DETECTOR_NAMES[detector], check_folder(out)
    with show_stages() as begin:
        begin(f"reading {cloud.name}")
        points = io.read_cloud(cloud)
        begin("keypoints")
        found = detect(
            points, detector=detector, keypoints=keypoints, nms_radius=nms_radius, resolution=resolution
        )
        begin("figure")
        make_folder(folder)
        io.write_keypoints(folder / "keypoints.npz", points, found)
        _write_pictures(folder, points, found, f"{shown_name(cloud)}, {name}")
    document = make_document(
        "detect",
        inputs=[describe_cloud("cloud", cloud, points)],
        options=options_of(context),
        results={"keypoints": len(found)},
        files=files_in(folder, ("keypoints.npz", *_PICTURES)),
    )
    Ending(as_json=as_json).finish(document, _print_cloud)


@app.command("describe", cls=Command, epilog=_DESCRIBE_EXAMPLES)
def describe_command(
    context: typer.Context,
    cloud: CloudArgument,
    *,
    detector: DetectorOption = "h3d",
    descriptor: DescriptorOption = "shot",
    normals: NormalsOption = "pca",
    keypoints: KeypointsOption = None,
    nms_radius: NmsRadiusOption = None,
    resolution: ResolutionOption = None,
    out: OutOption = DEFAULT_OUT,
    as_json: JsonOption = False,
) -> None:
    """Find the keypoints of one cloud, and give each a frame and a descriptor.

    Writes all as arrays, and the keypoints as a coloured cloud and as a picture.
    """
    name, folder = _DETECTOR_NAMES[detector], check_folder(out)
    with show_stages() as begin:
        begin(f"reading {cloud.name}")
        points = io.read_cloud(cloud)
        described = describe(
            points,
            detector=detector,
            descriptor=descriptor,
            normals=normals,
            keypoints=keypoints,
            nms_radius=nms_radius,
            resolution=resolution,
            progress=begin,
        )
        begin("figure")
        make_folder(folder)
        io.write_descriptors(folder / "descriptors.npz", described)
        _write_pictures(folder, points, described.indices, f"{shown_name(cloud)}, {name}")
    document = make_document(
        "describe",
        inputs=[describe_cloud("cloud", cloud, points)],
        options=options_of(context),
        results={
            "resolution": described.resolution,
            "keypoints": len(described),
            "descriptor_length": described.descriptors.shape[1],
        },
        files=files_in(folder, ("descriptors.npz", *_PICTURES)),
    )
    Ending(as_json=as_json).finish(document, _print_cloud)


def _print_cloud(document: Document) -> None:
    """Print what was found in a cloud, from the document."""
    found, options = document["results"], document["options"]
    print_clouds(document["inputs"])
    if "resolution" in found:
        print_facts(("resolution", f"{found['resolution']:.4g} (1 pr, in the file's unit)"))
    print_facts(("keypoints", f"{found['keypoints']} by {_DETECTOR_NAMES[options['detector']]}"))
    if "descriptor_length" in found:
        length = found["descriptor_length"]
        print_facts(("descriptors", f"{options['descriptor'].upper()}, {length} numbers each"))
    print_files(document)


def _write_pictures(folder: Path, cloud: PointCloud, found: IndexArray, title: str) -> None:
    """Write `_PICTURES`."""
    from cgroup.plots import keypoints_figure  # noqa: PLC0415 - slow to load

    io.write_keypoints(folder / "keypoints.ply", cloud, found)
    write_figure(folder / "keypoints.png", keypoints_figure(cloud.points, {"Keypoints": found}, title=title))
