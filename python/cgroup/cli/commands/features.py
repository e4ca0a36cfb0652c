"""``cgroup detect`` and ``describe``: keypoints of a cloud, with frames and descriptors."""

from pathlib import Path
from typing import Any

from cgroup import io
from cgroup.cli import options
from cgroup.cli.command import command
from cgroup.cli.documents import Document
from cgroup.cli.files import describe_cloud, read_cloud
from cgroup.cli.terminal import print_clouds, print_facts, print_files, show_stages, shown_name, write_figure
from cgroup.io.result_folders import Results
from cgroup.registration import Detector, describe, detect
from cgroup.types import IndexArray, PointCloud

_DETECTORS: dict[Detector, str] = {"h3d": "Harris 3D", "iss": "ISS"}
_PICTURES = ("keypoints.ply", "keypoints.png")


def _print_features(document: Document) -> None:
    found, chosen = document["results"], document["options"]
    print_clouds(document["inputs"])
    facts = [("keypoints", f"{found['keypoints']} by {_DETECTORS[chosen['detector']]}")]
    if "descriptor" in chosen:
        length = f"{found['resolution']:.4g} (1 pr, in the file's unit)"
        descriptors = f"{chosen['descriptor'].upper()}, {found['descriptor_length']} numbers each"
        facts = [("resolution", length), *facts, ("descriptors", descriptors)]
    print_facts(*facts)
    print_files(document)


@command(
    "detect",
    "cgroup detect scan.ply",
    "cgroup detect scan.ply --detector iss --keypoints 500 --out keypoints",
    show=_print_features,
    takes=("detector", "keypoints", "nms_radius", "resolution"),
)
def detect_command(cloud: Path = options.CLOUD, *, out: Path = options.OUT, **front_end: Any) -> Document:
    """Find the keypoints of one cloud.

    Writes them as arrays, as a coloured cloud and as a picture.
    """
    results = Results(out, "detect")
    with show_stages() as begin:
        points = read_cloud(cloud, begin)
        results.check(out / name for name in ("keypoints.npz", *_PICTURES))
        begin("keypoints")
        found = detect(points, **front_end)
        begin("figure")
        with results.writing() as files:
            io.write_keypoints(out / "keypoints.npz", points, found)
            _write_pictures(out, cloud, points, found, front_end["detector"])
    return {
        "inputs": [describe_cloud("cloud", cloud, points)],
        "results": {"keypoints": len(found)},
        "files": files,
    }


@command(
    "describe",
    "cgroup describe scan.ply --descriptor rcs",
    "# a whole model: normals by its faces",
    "cgroup describe model.ply --normals mesh --resolution 0.5 --out model",
    show=_print_features,
    takes=options.FRONT,
)
def describe_command(cloud: Path = options.CLOUD, *, out: Path = options.OUT, **front_end: Any) -> Document:
    """Find the keypoints of one cloud, and give each a frame and a descriptor.

    Writes all as arrays, and the keypoints as a coloured cloud and as a picture.
    """
    results = Results(out, "describe")
    with show_stages() as begin:
        points = read_cloud(cloud, begin)
        results.check(out / name for name in ("descriptors.npz", *_PICTURES))
        described = describe(points, **front_end, progress=begin)
        begin("figure")
        with results.writing() as files:
            io.write_descriptors(out / "descriptors.npz", described)
            _write_pictures(out, cloud, points, described.indices, front_end["detector"])
    return {
        "inputs": [describe_cloud("cloud", cloud, points)],
        "results": {
            "resolution": described.resolution,
            "keypoints": len(described),
            "descriptor_length": described.descriptors.shape[1],
        },
        "files": files,
    }


def _write_pictures(
    folder: Path, file: Path, cloud: PointCloud, found: IndexArray, detector: Detector
) -> None:
    from cgroup.plots import keypoints_figure  # noqa: PLC0415 - slow to load

    title = f"{shown_name(file)}, {_DETECTORS[detector]}"
    colored, picture = (folder / name for name in _PICTURES)
    io.write_keypoints(colored, cloud, found)
    write_figure(picture, keypoints_figure(cloud.points, {"Keypoints": found}, title=title))
