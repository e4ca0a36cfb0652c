"""``cgroup register`` and ``assess``: find the pose of one cloud on another, or judge one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import typer

from cgroup import io
from cgroup._checks.quoting import escape
from cgroup.cli import options
from cgroup.cli.command import command, identify_run, make_app
from cgroup.cli.inputs import describe_pair, read_both
from cgroup.cli.options import Point, choice, option
from cgroup.cli.pose_files import name_frames, name_of_pair, refuse_others, write_pose
from cgroup.cli.show.json import Document
from cgroup.cli.show.tables import show_length
from cgroup.cli.show.terminal import (
    print_clouds,
    print_facts,
    print_line,
    print_pose,
    show_stages,
    shown_name,
    write_figure,
)
from cgroup.cli.streams import write_error
from cgroup.cli.wording import is_given, reword
from cgroup.errors import InputError, NoConsensusError
from cgroup.evaluation import PROTOCOLS, alignment_error, rotation_error, translation_error
from cgroup.evaluation.ground_truth import OVERLAP_WITHIN
from cgroup.group import check_method
from cgroup.io._files import check_outputs
from cgroup.io._results import Results
from cgroup.registration import DenseFront, Effort, PaperFront, Registration, assess, register
from cgroup.registration.motions import say_direction
from cgroup.rigid import apply, invert
from cgroup.rigid.transforms import axis_of, split_scale
from cgroup.types import FloatArray, PointCloud

Front = Literal["dense", "paper"]
Clouds = tuple[PointCloud, PointCloud]

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
    "as the files say, if they do",
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

_POSE, _ALIGNED, _MATCHES, _MERGED, _PAGE = ".txt", "_aligned.ply", ".npz", "_merged.ply", ".html"
_FILES = {
    _POSE: "the pose",
    _ALIGNED: "the source, moved onto the target",
    _MERGED: "both as one cloud",
    _MATCHES: "the matches",
    ".png": "a picture",
    _PAGE: "a page for the browser",
}
"""What is written, by what follows the name of the pair."""

_MORE = {
    _PAGE: "--html to turn both around in a browser",
    _MERGED: "--merged to write both as one cloud",
}
"""Options that write more, and what for."""

_RIGHT = PROTOCOLS["5deg+5pr"]
"""Limits of a right pose."""

_LEAST_TURN = 0.005
"""Degrees from which a pose is said to turn."""


class RefusedPoseError(NoConsensusError):
    """No pose that can be trusted, and what a document says of the best guess."""

    guess: Document


app = make_app()


def print_registration(document: Document, *, verbose: bool = False) -> None:
    """Print a registration from its document."""
    done, files = document["results"], [Path(file) for file in document["files"]]
    print_clouds(document["inputs"])
    print_facts(*placement_facts(done, document["inputs"][0]["centroid"]))
    if verbose:
        times = (f"{name} {1e3 * seconds:.0f} ms" for name, seconds in done["seconds"].items())
        print_facts(
            ("voxel", f"{done['voxel']:.4g}"),
            ("matches", f"{done['matches']}, of which the pose lays {done['selected']} together"),
            ("time", ", ".join(times)),
        )
    print_pose(done["T_target_source"], document["inputs"][0])
    if files:
        _print_files(files)


def placement_facts(done: Document, middle: Sequence[float]) -> list[tuple[str, str]]:
    """Say where the source was placed, whose middle is given, and how sure and precise that is."""
    scale, pose = done.get("scale", 1.0), np.array(done["T_target_source"])  # older documents have none
    pose = pose if scale == 1.0 else split_scale(pose)[1]
    center = scale * np.array([middle])
    angle, way = rotation_error(pose, np.eye(4)), float(np.linalg.norm(apply(pose, center) - center))
    turned = f"turned by {angle:.3g} degrees about the axis {say_direction(axis_of(pose))}"
    turned = turned if angle > _LEAST_TURN else "not turned"
    moved = f"its middle moved by {show_length(way)} (in the files' unit, as all lengths)"
    chance = "more than 0.999" if done["probability"] > 0.9995 else f"{done['probability']:.3f}"
    shares = [f"{100 * done[name]:.0f} %" for name in ("fitness", "target_fitness")]
    deviations = f"{done['deviation_deg']:.2g} degrees, and {show_length(done['deviation'], 2)} at the middle"
    known = f", known to {100 * done['scale_deviation']:.1g} %" if "scale_deviation" in done else ""
    caveat = "computed from noise and shape alone, and not calibrated: other errors come on top"
    return [
        ("pose", f"{turned}, {moved}"),
        *([("scale", f"{scale:.5g} (the source's unit in the target's){known}")] if scale != 1.0 else []),
        ("probability", f"{chance} that the pose is right"),
        ("overlap", f"{shares[0]} of the source lies on the target, {shares[1]} of the target on the source"),
        ("residual", f"{show_length(done['inlier_rmse'])} between the surfaces there (root mean square)"),
        ("known to", f"{deviations} ({caveat})"),
        *([("truth", _say_truth(done))] if "truth" in done else []),
        *(("note", note) for note in done["notes"]),
    ]


def _say_truth(done: Document) -> str:
    """Say how far a pose is from the true one, and whether it counts as right."""
    truth, limits = done["truth"], done["truth"]["limits"]
    turn, shift = truth["rotation_error_deg"], truth["translation_error"]
    voxels = f"{show_length(shift / done['voxel'], 2)} voxels"
    off = f"{turn:.3g} degrees and {show_length(shift)} ({voxels}) from the true pose"
    inverse = "; it is right under the inverse of this truth" if truth["right_if_inverted"] else ""
    if truth["right"] is None:
        return f"{off}, under which no point of the source lies on the target{inverse}"
    return (
        f"{'right' if truth['right'] else 'wrong'}: {off}, points of the overlap "
        f"{show_length(truth['displacement'])} from their true places on average (right is up to "
        f"{limits['max_rotation_deg']:g} degrees and {show_length(limits['max_displacement'])}){inverse}"
    )


def _print_files(files: Sequence[Path]) -> None:
    """Print which files were written, what each holds, and what more there could be."""
    width = max(len(escape(file.name)) for file in files)
    print_line(f"wrote to {files[0].parent}/")
    for file in files:
        what = next(what for ending, what in _FILES.items() if file.name.endswith(ending))
        print_line(f"  {escape(file.name):<{width}}  {what}")
    more = [how for ending, how in _MORE.items() if not any(file.name.endswith(ending) for file in files)]
    if more:
        print_facts(("next", ", ".join(more)))


@command(
    app,
    "register",
    "cgroup register source.ply target.ply",
    "",
    "# two LiDAR scans, each from its own origin, in metres",
    "cgroup register a.pcd b.pcd --voxel 0.3 --viewpoint 0 0 0 --axis 0 0 1",
    "",
    "# near a pose that is known roughly: to 5 m, and 10 degrees",
    "cgroup register a.pcd b.pcd --initial odometry.txt --radius 5 --angle 10",
    "",
    "# a source whose unit is 0.5 to 2 of the target's",
    "cgroup register a.ply b.ply --scale 0.5 2",
    "",
    "# how far from a pose that is known to be true",
    "cgroup register a.ply b.ply --truth pose.txt",
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
    others: list[Path] = options.argument("CLOUD", "More than two are refused.", None, hidden=True),
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
    matches: Path | None = option(
        None,
        "FILE",
        "Matches of your own, such as a network's, which alone propose poses: x y z x' y' z', or NPZ.",
        options.SEARCH,
    ),
    initial: Path | None = option(
        None,
        "POSE",
        "File of a rough pose, such as odometry's; the right one is sought near it.",
        options.SEARCH,
    ),
    radius: float | None = option(
        None,
        "LENGTH",
        "How far --initial may place the middle of the source from where it belongs.",
        options.SEARCH,
        "a fifth of the source's diagonal",
    ),
    angle: float | None = option(
        None, "DEGREES", "How far --initial may be turned, 60 at most.", options.SEARCH, "15"
    ),
    scale: tuple[float, float] | None = option(
        None,
        "LOW HIGH",
        "Seek the scale too, between these: the source's unit in the target's, where they differ.",
        options.SEARCH,
        "the same unit",
    ),
    truth: Path | None = option(
        None, "POSE", "File of the true pose, to say how far the one found is from it.", "Truth"
    ),
    out: Path = options.OUT,
    html: bool = options.HTML,
    merged: bool = options.flag("--merged", "Write both clouds as one too: thinned, coloured."),
    as_json: bool = options.JSON,
    **front_end: Any,
) -> Document:
    """Place one scan on another, or say that no pose can be trusted (exit status 3).

    Writes the pose, the moved source, the matches and a picture: SOURCE_on_TARGET.txt and so on. Near a pose
    of --initial nothing is matched. The options of keypoints and descriptors are those of the paper's front.
    """
    if others:
        message = (
            f"register: got {2 + len(others)} clouds, and places one on one; cgroup merge places many in one "
            "scene"
        )
        raise InputError(message)
    if method is not None:
        method = check_method(method)
    _refuse_options_of_the_other_front(context, front)
    if truth is not None and scale is not None:
        raise InputError("truth", remedy="files of poses have no scale; leave out --truth, or --scale")
    true_pose, rough = (None if file is None else io.read_transform(file) for file in (truth, initial))
    own = None if matches is None else io.read_correspondences(matches)
    clouds = read_both(source, target)
    writer = PairFiles(out, source, target, identify_run(context), html=html, merged=merged)
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
                front=_front(context, front, support, front_end),
                matches=own,
                initial=rough,
                radius=radius,
                angle=angle,
                scale=scale or False,
                method=method,
                progress=begin,
            )
            begin("figures")
            files = writer.write(clouds, done, true_pose)
    except NoConsensusError as error:
        guess, reason = error.registration, str(reword(error, context))
        for page in writer.write_refusal(clouds, guess, true_pose, reason):
            write_error(f"cgroup: wrote {page.name} of the guess that is refused to {escape(str(out))}/")
        if guess is None:
            raise
        if not html:
            reason = f"{reason}; --html draws the best guess"
        results = registration_results(guess, clouds, true_pose)
        if true_pose is not None and not as_json:
            print_facts(("truth", f"the guess that is refused is {_say_truth(results)}"))
        raise _refused(reason, results) from error
    return {
        "inputs": describe_pair((source, target), clouds),
        "results": registration_results(done, clouds, true_pose),
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
        look = "to see what registration finds from it: cgroup register SOURCE TARGET --initial POSE --html"
        message = f"the pose can't be trusted: {done.notes[0]}; {look}"
        raise _refused(message, registration_results(done))
    return {
        "inputs": describe_pair((source, target), clouds),
        "results": registration_results(done),
        "files": [],
    }


def _refused(message: str, guess: Document) -> RefusedPoseError:
    error = RefusedPoseError(message)
    error.guess = guess
    return error


def _front(
    context: typer.Context, front: Front, support: float, front_end: dict[str, Any]
) -> Literal["dense"] | DenseFront | PaperFront:
    """Return where matches come from; what is given in its place allows for none but "dense"."""
    if front == "paper":
        return PaperFront(**front_end)
    return DenseFront(support=support) if is_given(context, "support") else "dense"


def _refuse_options_of_the_other_front(context: typer.Context, front: Front) -> None:
    """Raise `InputError` for an option that would be ignored."""
    other, names = ("dense", ["support"]) if front == "paper" else ("paper", options.FRONT)
    for name in names:
        if is_given(context, name):
            refused = "--" + name.replace("_", "-")
            message = f"{refused}: belongs to --front {other}, but the front is {front!r}"
            raise InputError(message)


class PairFiles:
    """What is written of one pair, each file named after both clouds: SOURCE_on_TARGET.txt and so on."""

    def __init__(
        self, folder: Path, source: Path, target: Path, run: str, *, html: bool, merged: bool = False
    ) -> None:
        """Refuse to replace an input, what was written of another pair of the same names, or other files."""
        self._folder, self._name, self._run = folder, name_of_pair(source, target), run
        self._frames = name_frames(source, target)
        self._title = f"{shown_name(source)} on {shown_name(target)}"
        self._page_title = f"{source.name} on {target.name}"
        self._is_wanted = {_MATCHES: False, _MERGED: merged, _PAGE: html}
        self._results = Results(folder, f"register {self._name}")
        check_outputs([self._file(ending) for ending in _FILES])
        refuse_others([self._file(_POSE)], self._frames)
        self._results.check(self._wanted)

    @property
    def _wanted(self) -> list[Path]:
        return [self._file(ending) for ending in _FILES if self._is_wanted.get(ending, True)]

    def _file(self, ending: str) -> Path:
        return self._folder / f"{self._name}{ending}"

    def write(self, clouds: Clouds, done: Registration, truth: FloatArray | None) -> list[Path]:
        """Write the pose, the moved source, matches if there are any, and a picture; return the files."""
        from cgroup.plots import registration_figure  # noqa: PLC0415 - slow to load

        pose = done.T_target_source
        figure = registration_figure(
            clouds[0].points,
            clouds[1].points,
            done.correspondences,
            mask=done.grouping.mask,
            T_target_source=pose,
            title=self._title,
        )
        self._is_wanted[_MATCHES] = len(done.correspondences) > 0
        self._results.check(self._wanted)
        with self._results.writing(self._run) as written:
            write_pose(self._file(_POSE), pose, self._frames)
            io.write_cloud(self._file(_ALIGNED), done.place(clouds[0]))
            if self._is_wanted[_MERGED]:
                io.write_cloud(self._file(_MERGED), done.merged(*clouds))
            if self._is_wanted[_MATCHES]:
                io.write_correspondences(self._file(_MATCHES), done.correspondences)
            write_figure(self._file(".png"), figure)
            if self._is_wanted[_PAGE]:
                self._write_page(clouds, done, truth)
        return written

    def write_refusal(
        self, clouds: Clouds, guess: Registration | None, truth: FloatArray | None, refusal: str
    ) -> list[Path]:
        """Write the page of a guess if one is wanted, and nothing else; return the files."""
        with self._results.writing(self._run) as written:
            if guess is not None and self._is_wanted[_PAGE]:
                self._write_page(clouds, guess, truth, refusal)
        return written

    def _write_page(
        self, clouds: Clouds, done: Registration, truth: FloatArray | None, refusal: str | None = None
    ) -> None:
        from cgroup.pages import registration_page, write_page  # noqa: PLC0415 - slow to load

        page = registration_page(*clouds, done, truth=truth, title=self._page_title, refusal=refusal)
        write_page(self._file(_PAGE), page)


def registration_results(
    done: Registration, clouds: Clouds | None = None, true_pose: FloatArray | None = None
) -> Document:
    """List what a document says of a registration; the clouds are needed with a true pose."""
    seconds: dict[str, float] = {}  # by stage, source and target together
    for name, value in done.seconds.items():
        stage = name.removeprefix("source ").removeprefix("target ")
        seconds[stage] = seconds.get(stage, 0.0) + value
    degrees, length = done.deviations
    results: Document = {
        "ok": done.ok,
        "T_target_source": done.T_target_source,
        "scale": done.scale,
        "scale_deviation": done.scale_deviation,
        "probability": done.probability,
        "fitness": done.fitness,
        "target_fitness": done.target_fitness,
        "inlier_rmse": done.inlier_rmse,
        "matches": len(done.correspondences),
        "selected": done.grouping.size,
        "voxel": done.voxel,
        "resolution": done.resolution,
        "covariance": done.covariance,
        "deviation_deg": degrees,
        "deviation": length,
        "open_motion": done.open_motion,
        "alternatives": done.alternatives,
        "notes": done.notes,
        "seconds": seconds,
    }
    if clouds is not None and true_pose is not None:
        results["truth"] = _judge(done, clouds, true_pose)
    return results


def _judge(done: Registration, clouds: Clouds, true_pose: FloatArray) -> Document:
    """Measure how far a pose is from the true one, and say whether it is right."""
    pose, pr = done.T_target_source, done.resolution

    def measure(truth: FloatArray) -> tuple[float, float, float, bool | None]:
        turn, shift = rotation_error(pose, truth), translation_error(pose, truth)
        source, target = (cloud.points for cloud in clouds)
        displacement = alignment_error(source, target, pose, truth, tolerance=OVERLAP_WITHIN * pr)
        return turn, shift, displacement, _RIGHT.judge(math.nan, turn, shift, displacement / pr)

    turn, shift, displacement, right = measure(true_pose)
    assert _RIGHT.max_rmse is not None  # noqa: S101 - of this one
    return {
        "right": right,
        "rotation_error_deg": turn,
        "translation_error": shift,
        "displacement": displacement,
        "right_if_inverted": bool(not right and measure(invert(true_pose))[-1]),
        "limits": {"max_rotation_deg": _RIGHT.max_rotation, "max_displacement": _RIGHT.max_rmse * pr},
    }
