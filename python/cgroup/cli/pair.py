"""``cgroup register``: one cloud placed on another; and reading and printing pairs of clouds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from cgroup import io
from cgroup.cli.options import (
    DEFAULT_OUT,
    DescriptorOption,
    DetectorOption,
    KeypointsOption,
    MethodOption,
    NmsRadiusOption,
    NormalsOption,
    OutOption,
    SourceArgument,
    TargetArgument,
    check_method,
)
from cgroup.cli.terminal import (
    make_folder,
    print_cloud,
    print_facts,
    print_pose,
    print_written,
    show_stages,
    write_figure,
)
from cgroup.registration import Registration, register

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cgroup.types import PointCloud

app = typer.Typer()


@app.command("register")
def register_command(
    source: SourceArgument,
    target: TargetArgument,
    *,
    method: MethodOption = "gtm",
    detector: DetectorOption = "h3d",
    descriptor: DescriptorOption = "shot",
    normals: NormalsOption = "pca",
    keypoints: KeypointsOption = None,
    nms_radius: NmsRadiusOption = None,
    out: OutOption = DEFAULT_OUT,
) -> None:
    """Place one scan on another: matches, the group that agrees, and the pose it fixes."""
    check_method(method)
    clouds = read_both(source, target)
    folder = make_folder(out)
    with show_stages() as begin:
        done = register(
            *clouds,
            method=method,
            detector=detector,
            descriptor=descriptor,
            normals=normals,
            keypoints=keypoints,
            nms_radius=nms_radius,
            progress=begin,
        )
        begin("figures")
        figure = _draw_registration(clouds, done, f"{source.name} on {target.name}, {method.upper()}")
        io.write_transform(folder / "transform.txt", done.T_target_source)
        io.write_cloud(folder / "aligned.ply", clouds[0].transformed(done.T_target_source))
        io.write_correspondences(folder / "correspondences.npz", done.correspondences)
        write_figure(folder / "registration.png", figure)
    print_clouds((source, target), clouds)
    _print_registration(done, method)
    print_written(folder, "transform.txt", "aligned.ply", "correspondences.npz", "registration.png")


def _draw_registration(clouds: tuple[PointCloud, PointCloud], done: Registration, title: str) -> Figure:
    from cgroup.plots import registration_figure  # noqa: PLC0415 - slow to load

    return registration_figure(
        clouds[0].points,
        clouds[1].points,
        done.correspondences,
        mask=done.grouping.mask,
        T_target_source=done.T_target_source,
        title=title,
    )


def read_both(source: Path, target: Path) -> tuple[PointCloud, PointCloud]:
    """Read two clouds."""
    with show_stages() as begin:
        begin(f"reading {source.name}")
        first = io.read_cloud(source)
        begin(f"reading {target.name}")
        return first, io.read_cloud(target)


def print_clouds(files: tuple[Path, Path], clouds: tuple[PointCloud, PointCloud]) -> None:
    """Print how many points source and target have."""
    for role, file, cloud in zip(("source", "target"), files, clouds, strict=True):
        print_cloud(role, file, cloud)


def _print_registration(done: Registration, method: str) -> None:
    print_facts(
        ("resolution", f"{done.resolution:.4g} (mean point spacing, in the files' unit)"),
        ("matches", f"{len(done.correspondences)}"),
        ("group", f"{done.grouping.size} by {method.upper()}"),
        ("time", ", ".join(f"{name} {1e3 * seconds:.0f} ms" for name, seconds in done.seconds.items())),
    )
    print_pose(done.T_target_source)
