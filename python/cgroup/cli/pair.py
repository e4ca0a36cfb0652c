"""``cgroup register``: one cloud placed on another; and reading and printing pairs of clouds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cgroup import io
from cgroup.cli.options import (
    DEFAULT_OUT,
    AxisOption,
    DescriptorOption,
    DetectorOption,
    EffortOption,
    FrontOption,
    KeypointsOption,
    NmsRadiusOption,
    NormalsOption,
    OutOption,
    ResolutionOption,
    SourceArgument,
    SourceViewpointOption,
    SupportOption,
    TargetArgument,
    TargetViewpointOption,
    ViewpointOption,
    VoxelOption,
)
from cgroup.cli.terminal import (
    print_cloud,
    print_facts,
    print_pose,
    print_written,
    show_stages,
    shown_name,
    write_figure,
)
from cgroup.errors import InputError
from cgroup.group import check_method
from cgroup.io._results import check_folder, make_folder
from cgroup.registration import DenseFront, PaperFront, Registration, register
from cgroup.registration.prepared import VOXELS
from cgroup.registry import METHODS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cgroup.types import PointCloud

_PAPER_OPTIONS = ("detector", "descriptor", "normals", "keypoints", "nms_radius", "resolution")
_DENSE_OPTIONS = ("support",)

app = typer.Typer()


@app.command("register")
def register_command(
    context: typer.Context,
    source: SourceArgument,
    target: TargetArgument,
    *,
    voxel: VoxelOption = None,
    viewpoint: ViewpointOption = None,
    source_viewpoint: SourceViewpointOption = None,
    target_viewpoint: TargetViewpointOption = None,
    axis: AxisOption = None,
    effort: EffortOption = "normal",
    front: FrontOption = "dense",
    method: Annotated[
        str | None,
        typer.Option(
            help=f"Grouping method that proposes poses: {', '.join(METHODS)}.",
            show_default="lc, or gtm with the paper's front",
        ),
    ] = None,
    support: SupportOption = DenseFront.support,
    detector: DetectorOption = "h3d",
    descriptor: DescriptorOption = "shot",
    normals: NormalsOption = "pca",
    keypoints: KeypointsOption = None,
    nms_radius: NmsRadiusOption = None,
    resolution: ResolutionOption = None,
    out: OutOption = DEFAULT_OUT,
) -> None:
    """Place one scan on another, or say that no pose can be trusted (exit status 3).

    The last options, from --detector on, are those of the paper's front.
    """
    if method is not None:
        method = check_method(method)
    _refuse_options_of_the_other_front(context, front)
    check_folder(out)
    clouds = read_both(source, target)
    paper = PaperFront(detector, descriptor, keypoints, nms_radius, normals, resolution)
    with show_stages() as begin:
        done = register(
            *clouds,
            voxel=voxel,
            source_viewpoint=source_viewpoint or viewpoint,
            target_viewpoint=target_viewpoint or viewpoint,
            axis=axis,
            effort=effort,
            front=paper if front == "paper" else DenseFront(support=support),
            method=method,
            progress=begin,
        )
        begin("figures")
        folder = make_folder(out)
        figure = _draw_registration(clouds, done, f"{shown_name(source)} on {shown_name(target)}")
        io.write_transform(folder / "transform.txt", done.T_target_source)
        io.write_cloud(folder / "aligned.ply", clouds[0].transformed(done.T_target_source))
        io.write_correspondences(folder / "correspondences.npz", done.correspondences)
        write_figure(folder / "registration.png", figure)
    print_clouds((source, target), clouds)
    _print_registration(done, is_chosen=voxel is None)
    print_written(folder, "transform.txt", "aligned.ply", "correspondences.npz", "registration.png")


def _refuse_options_of_the_other_front(context: typer.Context, front: str) -> None:
    """Raise `InputError` for an option that would be ignored."""
    others = _DENSE_OPTIONS if front == "paper" else _PAPER_OPTIONS
    for name in others:
        given = context.get_parameter_source(name)
        if given is not None and given.name == "COMMANDLINE":
            option = "--" + name.replace("_", "-")
            other = "dense" if front == "paper" else "paper"
            message = f"{option}: belongs to --front {other}, but the front is {front!r}"
            raise InputError(message)


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


def _print_registration(done: Registration, *, is_chosen: bool) -> None:
    why = f", the smallest step of 2^(1/4) that leaves {VOXELS} of a cloud at most" if is_chosen else ""
    print_facts(
        ("voxel", f"{done.voxel:.4g} (in the files' unit{why})"),
        ("matches", f"{len(done.correspondences)}, of which the pose lays {done.grouping.size} together"),
        ("overlap", f"{100 * done.fitness:.0f} % of the source lies on the target"),
        ("residual", f"{done.inlier_rmse:.3g} there (root mean square, in the files' unit)"),
        ("probability", f"{done.probability:.3f} that the pose is right"),
        *(("note", note) for note in done.notes),
        ("time", ", ".join(f"{name} {1e3 * seconds:.0f} ms" for name, seconds in _by_stage(done).items())),
    )
    print_pose(done.T_target_source)


def _by_stage(done: Registration) -> dict[str, float]:
    """Add up the times of source and target."""
    totals: dict[str, float] = {}
    for name, seconds in done.seconds.items():
        stage = name.removeprefix("source ").removeprefix("target ")
        totals[stage] = totals.get(stage, 0.0) + seconds
    return totals
