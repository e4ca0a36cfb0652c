"""``cgroup detect`` and ``cgroup describe``: keypoints and descriptors of one cloud."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from cgroup import io
from cgroup.cli.options import (
    DEFAULT_OUT,
    CloudArgument,
    DescriptorOption,
    DetectorOption,
    KeypointsOption,
    NmsRadiusOption,
    NormalsOption,
    OutOption,
    ResolutionOption,
)
from cgroup.cli.terminal import print_cloud, print_facts, print_written, show_stages, shown_name, write_figure
from cgroup.io._results import check_folder, make_folder
from cgroup.registration import Detector, describe, detect

if TYPE_CHECKING:
    from cgroup.types import IndexArray, PointCloud

_DETECTOR_NAMES: dict[Detector, str] = {"h3d": "Harris 3D", "iss": "ISS"}
_PICTURES = ("keypoints.ply", "keypoints.png")

app = typer.Typer()


@app.command("detect")
def detect_command(
    cloud: CloudArgument,
    *,
    detector: DetectorOption = "h3d",
    keypoints: KeypointsOption = None,
    nms_radius: NmsRadiusOption = None,
    resolution: ResolutionOption = None,
    out: OutOption = DEFAULT_OUT,
) -> None:
    """Find the keypoints of one cloud."""
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
    print_cloud("cloud", cloud, points)
    print_facts(("keypoints", f"{len(found)} by {name}"))
    print_written(folder, "keypoints.npz", *_PICTURES)


@app.command("describe")
def describe_command(
    cloud: CloudArgument,
    *,
    detector: DetectorOption = "h3d",
    descriptor: DescriptorOption = "shot",
    normals: NormalsOption = "pca",
    keypoints: KeypointsOption = None,
    nms_radius: NmsRadiusOption = None,
    resolution: ResolutionOption = None,
    out: OutOption = DEFAULT_OUT,
) -> None:
    """Find the keypoints of one cloud, and give each a frame and a descriptor."""
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
    print_cloud("cloud", cloud, points)
    print_facts(
        ("resolution", f"{described.resolution:.4g} (1 pr, in the file's unit)"),
        ("keypoints", f"{len(described)} by {name}"),
        ("descriptors", f"{descriptor.upper()}, {described.descriptors.shape[1]} numbers each"),
    )
    print_written(folder, "descriptors.npz", *_PICTURES)


def _write_pictures(folder: Path, cloud: PointCloud, found: IndexArray, title: str) -> None:
    """Write `_PICTURES`."""
    from cgroup.plots import keypoints_figure  # noqa: PLC0415 - slow to load

    io.write_keypoints(folder / "keypoints.ply", cloud, found)
    write_figure(folder / "keypoints.png", keypoints_figure(cloud.points, {"Keypoints": found}, title=title))
