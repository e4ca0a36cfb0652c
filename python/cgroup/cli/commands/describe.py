"""``cgroup describe``: find keypoints of a cloud, with frames and descriptors."""

from __future__ import annotations

import typer

from cgroup import io
from cgroup.cli import options
from cgroup.cli.commands.detect import DETECTOR_NAMES, PICTURES, count_keypoints, write_pictures
from cgroup.cli.help import command, make_app
from cgroup.cli.inputs import describe_cloud, read_cloud
from cgroup.cli.output import Ending, files_in, options_of
from cgroup.cli.show.json import Document, make_document
from cgroup.cli.show.terminal import print_clouds, print_facts, print_files, show_stages, shown_name
from cgroup.io._results import check_folder, make_folder
from cgroup.registration import describe

app = make_app()


@command(
    app,
    "describe",
    "cgroup describe scan.ply --descriptor rcs",
    "",
    "# a whole model, whose faces tell the outside",
    "cgroup describe model.ply --normals mesh --resolution 0.5 --out model",
)
def describe_command(
    context: typer.Context,
    cloud: options.CloudArgument,
    *,
    detector: options.DetectorOption = "h3d",
    descriptor: options.DescriptorOption = "shot",
    normals: options.NormalsOption = "pca",
    keypoints: options.KeypointsOption = None,
    nms_radius: options.NmsRadiusOption = None,
    resolution: options.ResolutionOption = None,
    out: options.OutOption = options.DEFAULT_OUT,
    as_json: options.JsonOption = False,
) -> None:
    """Find the keypoints of one cloud, and give each a frame and a descriptor.

    Writes all as arrays, and the keypoints as a coloured cloud and as a picture.
    """
    folder = check_folder(out)
    with show_stages() as begin:
        points = read_cloud(cloud, begin)
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
        io.write_descriptors(make_folder(folder) / "descriptors.npz", described)
        title = f"{shown_name(cloud)}, {DETECTOR_NAMES[detector]}"
        write_pictures(folder, points, described.indices, title)
    results = {
        "resolution": described.resolution,
        "keypoints": len(described),
        "descriptor_length": described.descriptors.shape[1],
    }
    document = make_document(
        "describe",
        inputs=[describe_cloud("cloud", cloud, points)],
        options=options_of(context),
        results=results,
        files=files_in(folder, ("descriptors.npz", *PICTURES)),
    )
    Ending(as_json=as_json).finish(document, _print_descriptors)


def _print_descriptors(document: Document) -> None:
    found, descriptor = document["results"], document["options"]["descriptor"].upper()
    print_clouds(document["inputs"])
    print_facts(
        ("resolution", f"{found['resolution']:.4g} (1 pr, in the file's unit)"),
        count_keypoints(document),
        ("descriptors", f"{descriptor}, {found['descriptor_length']} numbers each"),
    )
    print_files(document)
