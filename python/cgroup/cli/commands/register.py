"""``cgroup register`` and ``assess``: find the pose of one cloud on another, or judge one."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import typer

from cgroup import io
from cgroup._checks.quoting import escape
from cgroup.cli import options
from cgroup.cli.command import command, make_app
from cgroup.cli.inputs import describe_pair, read_both
from cgroup.cli.options import Point, choice, option
from cgroup.cli.show.json import Document
from cgroup.cli.show.terminal import (
    print_clouds,
    print_facts,
    print_files,
    print_pose,
    show_stages,
    shown_name,
    write_figure,
)
from cgroup.cli.streams import write_error
from cgroup.cli.wording import is_given, reword
from cgroup.errors import InputError, NoConsensusError
from cgroup.group import check_method
from cgroup.io._files import check_outputs
from cgroup.io._results import make_folder, remove_files
from cgroup.registration import DenseFront, Effort, PaperFront, Registration, assess, register
from cgroup.registration.prepare import VOXELS
from cgroup.types import PointCloud

Front = Literal["dense", "paper"]

_VOXEL = option(
    None,
    "LENGTH",
    "Edge length of the voxels, in the files' unit; all radii are multiples of it.",
    options.CLOUDS,
    "leaves about 5,000 voxels",
)
_VIEWPOINT = option(
    None,
    "X Y Z",
    "Where the scanner stood in both files, if each is one single scan: tells far more.",
    options.CLOUDS,
)
_SOURCE_VIEWPOINT = option(None, "X Y Z", "The same of the source alone.", options.CLOUDS)
_TARGET_VIEWPOINT = option(None, "X Y Z", "The same of the target alone.", options.CLOUDS)
_VIEW_DIRECTION = option(
    None,
    "X Y Z",
    "Where the scanner looked, in both files, where its place isn't known.",
    options.CLOUDS,
)
_AXIS = option(
    None,
    "X Y Z",
    "Direction that both clouds share, such as gravity; the pose may tilt it by 10 degrees.",
    options.CLOUDS,
)
_EFFORT = choice("normal", Effort, "How long to search where the pose is not sure.", options.SEARCH)

_FILES = ("transform.txt", "aligned.ply", "correspondences.npz", "registration.png")
_PAGE = "registration.html"

app = make_app()


def print_registration(document: Document) -> None:
    """Print a registration from its document."""
    done = document["results"]
    is_chosen = document["options"]["voxel"] is None
    why = f", chosen to leave about {VOXELS} of a cloud" if is_chosen else ""
    print_clouds(document["inputs"])
    print_facts(
        ("voxel", f"{done['voxel']:.4g} (in the files' unit{why})"),
        ("matches", f"{done['matches']}, of which the pose lays {done['selected']} together"),
        ("overlap", f"{100 * done['fitness']:.0f} % of the source lies on the target"),
        ("residual", f"{done['inlier_rmse']:.3g} there (root mean square, in the files' unit)"),
        ("probability", f"{done['probability']:.3f} that the pose is right"),
        *(("note", note) for note in done["notes"]),
        ("time", ", ".join(f"{name} {1e3 * seconds:.0f} ms" for name, seconds in done["seconds"].items())),
    )
    print_pose(done["T_target_source"])
    print_files(document)


@command(
    app,
    "register",
    "cgroup register source.ply target.ply",
    "",
    "# two LiDAR scans, each from its own origin, in metres",
    "cgroup register a.pcd b.pcd --voxel 0.3 --viewpoint 0 0 0 --axis 0 0 1",
    "",
    "# the paper's front end, for a script, and kept to be compared later",
    "cgroup register a.ply b.ply --front paper --method gtm --json --save gtm",
    show=print_registration,
    takes=options.FRONT,
    saves=True,
)
def register_command(
    context: typer.Context,
    source: Path = options.SOURCE,
    target: Path = options.TARGET,
    *,
    voxel: float | None = _VOXEL,
    viewpoint: Point | None = _VIEWPOINT,
    source_viewpoint: Point | None = _SOURCE_VIEWPOINT,
    target_viewpoint: Point | None = _TARGET_VIEWPOINT,
    view_direction: Point | None = _VIEW_DIRECTION,
    axis: Point | None = _AXIS,
    effort: Effort = _EFFORT,
    front: Front = choice(
        "dense",
        Front,
        "Match every voxel by FPFH, or the keypoints of the paper's evaluation.",
        options.SEARCH,
    ),
    method: str | None = option(
        None,
        "NAME",
        f"Grouping method that proposes poses: {options.METHOD_NAMES}.",
        options.SEARCH,
        "lc, or gtm with the paper's front",
        autocompletion=options.complete_methods,
    ),
    support: float = option(
        DenseFront.support, "VOXELS", "Radius that FPFH describes, in voxels.", options.SEARCH
    ),
    out: Path = options.OUT,
    html: bool = options.HTML,
    **front_end: Any,
) -> Document:
    """Place one scan on another, or say that no pose can be trusted (exit status 3).

    Writes the pose, the moved source, the matches and a picture. The options of keypoints and descriptors
    are those of the paper's front.
    """
    if method is not None:
        method = check_method(method)
    _refuse_options_of_the_other_front(context, front)
    clouds = read_both(source, target)
    files = [out / name for name in _FILES]
    check_outputs(files)
    title = f"{source.name} on {target.name}"
    try:
        with show_stages() as begin:
            done = register(
                *clouds,
                voxel=voxel,
                viewpoint=viewpoint,
                source_viewpoint=source_viewpoint,
                target_viewpoint=target_viewpoint,
                view_direction=view_direction,
                axis=axis,
                effort=effort,
                front=PaperFront(**front_end) if front == "paper" else DenseFront(support=support),
                method=method,
                progress=begin,
            )
            begin("figures")
            names = f"{shown_name(source)} on {shown_name(target)}"
            make_folder(out)
            _write_files(files, clouds, done, names)
            if html:
                files.append(_write_page(out, clouds, done, title))
    except NoConsensusError as error:
        remove_files([*files, out / _PAGE])
        if html and error.registration is not None:
            page = _write_page(
                make_folder(out), clouds, error.registration, title, str(reword(error, context))
            )
            write_error(f"cgroup: wrote {page.name} of the guess that is refused to {escape(str(out))}/")
        raise
    return {
        "inputs": describe_pair((source, target), clouds),
        "results": registration_results(done),
        "files": files,
    }


@command(
    app,
    "assess",
    "cgroup assess source.ply target.ply pose.txt",
    "cgroup assess a.pcd b.pcd odometry.txt --viewpoint 0 0 0 --json",
    show=print_registration,
)
def assess_command(
    source: Path = options.SOURCE,
    target: Path = options.TARGET,
    pose: Path = options.argument("POSE", "File of the pose that maps the source into the target's frame."),
    *,
    voxel: float | None = _VOXEL,
    viewpoint: Point | None = _VIEWPOINT,
    source_viewpoint: Point | None = _SOURCE_VIEWPOINT,
    target_viewpoint: Point | None = _TARGET_VIEWPOINT,
    view_direction: Point | None = _VIEW_DIRECTION,
    axis: Point | None = _AXIS,
    effort: Effort = _EFFORT,
) -> Document:
    """Say how likely a pose from elsewhere is right; exit status 3 where it can't be trusted."""
    given = io.read_transform(pose)
    clouds = read_both(source, target)
    with show_stages() as begin:
        done = assess(
            *clouds,
            given,
            voxel=voxel,
            viewpoint=viewpoint,
            source_viewpoint=source_viewpoint,
            target_viewpoint=target_viewpoint,
            view_direction=view_direction,
            axis=axis,
            effort=effort,
            progress=begin,
        )
    if not done.ok:
        error = NoConsensusError(f"the pose can't be trusted: {done.notes[0]}")
        error.registration = done
        raise error
    return {
        "inputs": describe_pair((source, target), clouds),
        "results": registration_results(done),
        "files": [],
    }


def _refuse_options_of_the_other_front(context: typer.Context, front: Front) -> None:
    """Raise `InputError` for an option that would be ignored."""
    other, names = ("dense", ["support"]) if front == "paper" else ("paper", options.FRONT)
    for name in names:
        if is_given(context, name):
            refused = "--" + name.replace("_", "-")
            message = f"{refused}: belongs to --front {other}, but the front is {front!r}"
            raise InputError(message)


def _write_files(
    files: list[Path], clouds: tuple[PointCloud, PointCloud], done: Registration, title: str
) -> None:
    from cgroup.plots import registration_figure  # noqa: PLC0415 - slow to load

    transform, aligned, matches, picture = files
    figure = registration_figure(
        clouds[0].points,
        clouds[1].points,
        done.correspondences,
        mask=done.grouping.mask,
        T_target_source=done.T_target_source,
        title=title,
    )
    io.write_transform(transform, done.T_target_source)
    io.write_cloud(aligned, clouds[0].transformed(done.T_target_source))
    io.write_correspondences(matches, done.correspondences)
    write_figure(picture, figure)


def _write_page(
    folder: Path,
    clouds: tuple[PointCloud, PointCloud],
    done: Registration,
    title: str,
    refusal: str | None = None,
) -> Path:
    from cgroup.pages import registration_page, write_page  # noqa: PLC0415 - slow to load

    file = folder / _PAGE
    write_page(file, registration_page(*clouds, done, title=title, refusal=refusal))
    return file


def registration_results(done: Registration) -> Document:
    """List what a document says of a registration."""
    seconds: dict[str, float] = {}  # by stage, source and target together
    for name, value in done.seconds.items():
        stage = name.removeprefix("source ").removeprefix("target ")
        seconds[stage] = seconds.get(stage, 0.0) + value
    return {
        "ok": done.ok,
        "T_target_source": done.T_target_source,
        "probability": done.probability,
        "fitness": done.fitness,
        "inlier_rmse": done.inlier_rmse,
        "matches": len(done.correspondences),
        "selected": done.grouping.size,
        "voxel": done.voxel,
        "resolution": done.resolution,
        "covariance": done.covariance,
        "open_motion": done.open_motion,
        "alternatives": done.alternatives,
        "notes": done.notes,
        "seconds": seconds,
    }
