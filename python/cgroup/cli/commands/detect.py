"""``cgroup detect``: find the keypoints of a cloud."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from cgroup import io
from cgroup.cli import options
from cgroup.cli.help import command, make_app
from cgroup.cli.inputs import describe_cloud, read_cloud
from cgroup.cli.output import Ending, files_in, options_of
from cgroup.cli.show.json import Document, make_document
from cgroup.cli.show.terminal import (
    print_clouds,
    print_facts,
    print_files,
    show_stages,
    shown_name,
    write_figure,
)
from cgroup.io._results import check_folder, make_folder
from cgroup.registration import Detector, detect

if TYPE_CHECKING:
    from cgroup.types import IndexArray, PointCloud

DETECTOR_NAMES: dict[Detector, str] = {"h3d": "Harris 3D", "iss": "ISS"}
PICTURES = ("keypoints.ply", "keypoints.png")

app = make_app()


@command(
    app,
    "detect",
    "cgroup detect scan.ply",
    "cgroup detect scan.ply --detector iss --keypoints 500 --out keypoints",
)
def detect_command(
    context: typer.Context,
    cloud: options.CloudArgument,
    *,
    detector: options.DetectorOption = "h3d",
    keypoints: options.KeypointsOption = None,
    nms_radius: options.NmsRadiusOption = None,
    resolution: options.ResolutionOption = None,
    out: options.OutOption = options.DEFAULT_OUT,
    as_json: options.JsonOption = False,
) -> None:
    """Find the keypoints of one cloud.

    Writes them as arrays, as a coloured cloud and as a picture.
    """
    folder = check_folder(out)
    with show_stages() as begin:
        points = read_cloud(cloud, begin)
        begin("keypoints")
        found = detect(
            points, detector=detector, keypoints=keypoints, nms_radius=nms_radius, resolution=resolution
        )
        begin("figure")
        io.write_keypoints(make_folder(folder) / "keypoints.npz", points, found)
        write_pictures(folder, points, found, f"{shown_name(cloud)}, {DETECTOR_NAMES[detector]}")
    document = make_document(
        "detect",
        inputs=[describe_cloud("cloud", cloud, points)],
        options=options_of(context),
        results={"keypoints": len(found)},
        files=files_in(folder, ("keypoints.npz", *PICTURES)),
    )
    Ending(as_json=as_json).finish(document, _print_keypoints)


def _print_keypoints(document: Document) -> None:
    print_clouds(document["inputs"])
    print_facts(count_keypoints(document))
    print_files(document)


def count_keypoints(document: Document) -> tuple[str, str]:
    """Return how many keypoints were found, as a fact."""
    detector = DETECTOR_NAMES[document["options"]["detector"]]
    return "keypoints", f"{document['results']['keypoints']} by {detector}"


def write_pictures(folder: Path, cloud: PointCloud, found: IndexArray, title: str) -> None:
    """Write `PICTURES`: the keypoints as a coloured cloud, and as a picture."""
    from cgroup.plots import keypoints_figure  # noqa: PLC0415 - slow to load

    io.write_keypoints(folder / "keypoints.ply", cloud, found)
    write_figure(folder / "keypoints.png", keypoints_figure(cloud.points, {"Keypoints": found}, title=title))
