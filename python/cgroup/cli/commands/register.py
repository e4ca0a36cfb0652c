"""``cgroup register`` and ``assess``: estimate the pose of one cloud on another, or judge a given one."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import typer

from cgroup import io
from cgroup._checks.quoting import escape
from cgroup.cli import options
from cgroup.cli.command import command, identify_run, make_app
from cgroup.cli.documents import Document
from cgroup.cli.errors import RefusedPoseError, is_given, reword
from cgroup.cli.files import PairFiles, describe_pair, name_of_pair, print_pair_files, read_both
from cgroup.cli.options import argument, choice, flag, option
from cgroup.cli.process import write_error
from cgroup.cli.registration_facts import describe_truth, placement_facts, registration_results
from cgroup.cli.terminal import print_clouds, print_facts, print_pose, show_stages
from cgroup.errors import InputError, NoConsensusError
from cgroup.group import check_method
from cgroup.io.result_folders import Results, check_folder
from cgroup.registration import DenseFront, PaperFront, assess, register

Front = Literal["dense", "paper"]

# Options of both commands.
_PAIR = ("voxel", "viewpoint", "source_viewpoint", "target_viewpoint", "view_direction", "axis", "effort")
app = make_app()


def _print_registration(document: Document, *, verbose: bool) -> None:
    done, files = document["results"], [Path(file) for file in document["files"]]
    print_clouds(document["inputs"])
    print_facts(*placement_facts(done, document["inputs"][0]["centroid"]))
    if verbose:
        times = (f"{name} {1e3 * seconds:.0f} ms" for name, seconds in done["seconds"].items())
        print_facts(
            ("voxel", f"{done['voxel']:.4g}"),
            ("matches", f"{done['selected']} of {done['matches']} agree with the pose"),
            ("time", ", ".join(times)),
        )
    print_pose(done["T_target_source"], document["inputs"][0])
    print_pair_files(files)


@command(
    app,
    "register",
    "cgroup register source.ply target.ply",
    "",
    "# two LiDAR scans, each from its own origin, in metres",
    "cgroup register a.pcd b.pcd --voxel 0.3 --viewpoint 0 0 0 --axis 0 0 1",
    "",
    "# near a roughly known pose: within 5 m and 10 degrees",
    "cgroup register a.pcd b.pcd --initial odometry.txt --radius 5 --angle 10",
    "",
    "# the source's unit is 0.5 to 2 of the target's",
    "cgroup register a.ply b.ply --scale 0.5 2",
    "",
    "# errors against a known pose",
    "cgroup register a.ply b.ply --truth pose.txt",
    "",
    "# the paper's feature extraction, for a script",
    "cgroup register a.ply b.ply --front paper --method gtm --json",
    show=_print_registration,
    takes=(*_PAIR, *options.FRONT),
)
def register_command(
    context: typer.Context,
    source: Path = options.SOURCE,
    target: Path = options.TARGET,
    others: list[Path] = argument("CLOUD", "More than two are refused.", None, hidden=True),
    *,
    front: Front = choice(
        "dense", Front, "Match all voxels by FPFH, or the paper's keypoints.", options.SEARCH
    ),
    method: str | None = option(
        None,
        "NAME",
        f"Grouping method that proposes poses: {options.METHOD_NAMES}.",
        options.SEARCH,
        "lc, or gtm with the paper's front",
        autocompletion=options.complete_methods,
    ),
    support: float = option(DenseFront.support, "VOXELS", "Radius of FPFH, in voxels.", options.SEARCH),
    matches: Path | None = option(
        None,
        "FILE",
        "Your own matches, such as a network's, in place of FPFH's: x y z x' y' z', or NPZ.",
        options.SEARCH,
    ),
    initial: Path | None = option(
        None, "POSE", "File of a rough pose, such as odometry's; the search stays near it.", options.SEARCH
    ),
    radius: float | None = option(
        None,
        "LENGTH",
        "Largest error of --initial at the source's middle.",
        options.SEARCH,
        "a fifth of the source's diagonal",
    ),
    angle: float | None = option(
        None, "DEGREES", "Largest rotation error of --initial, up to 60.", options.SEARCH, "15"
    ),
    scale: tuple[float, float] | None = option(
        None,
        "LOW HIGH",
        "Estimate the scale too, within this range: the source's unit in the target's.",
        options.SEARCH,
        "the same unit",
    ),
    truth: Path | None = option(
        None, "POSE", "File of the true pose; errors against it are printed.", options.TRUTH
    ),
    out: Path = options.OUT,
    html: bool = options.HTML,
    merged: bool = flag("--merged", "Write both clouds as one too: downsampled, coloured."),
    as_json: bool = options.JSON,
    **shared: Any,
) -> Document:
    """Estimate the pose between two clouds; exit status 3 if none is reliable.

    Writes the pose, the aligned source, the matches and a picture: SOURCE_on_TARGET.txt and so on. --initial
    needs no matches. The options of keypoints and descriptors are those of --front paper.
    """
    _check_options(context, 2 + len(others or ()), front)
    if method is not None:
        method = check_method(method)
    true_pose, rough = (None if file is None else io.read_transform(file) for file in (truth, initial))
    own = None if matches is None else io.read_correspondences(matches)
    clouds = read_both(source, target)
    writer = PairFiles(out, source, target, identify_run(context), html=html, merged=merged)
    try:
        with show_stages() as begin:
            done = register(
                *clouds,
                **{name: shared[name] for name in _PAIR},
                front=_front(context, front, support, {name: shared[name] for name in options.FRONT}),
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
            write_error(f"cgroup: wrote {page.name} of the refused guess to {escape(str(out))}/")
        if guess is None:
            raise
        if not html:
            reason = f"{reason}{options.DRAW_GUESS}"
        results = registration_results(guess, clouds, true_pose)
        if true_pose is not None and not as_json:
            print_facts(("truth", f"the refused guess is {describe_truth(results)}"))
        raise RefusedPoseError(reason, results) from error
    return {
        "inputs": describe_pair((source, target), clouds),
        "results": registration_results(done, clouds, true_pose),
        "files": files,
    }


@command(
    app,
    "assess",
    "cgroup assess source.ply target.ply pose.txt",
    "cgroup assess a.pcd b.pcd odometry.txt --viewpoint 0 0 0 --html --json",
    show=_print_registration,
    takes=_PAIR,
)
def assess_command(
    context: typer.Context,
    source: Path = options.SOURCE,
    target: Path = options.TARGET,
    pose: Path = argument("POSE", "File of the pose that maps the source into the target's frame."),
    *,
    out: Path = options.folder("out", "Folder for the page; created if needed.", options.OUTPUT),
    html: bool = options.HTML,
    **shared: Any,
) -> Document:
    """Estimate how likely a given pose is correct; exit status 3 if it is unreliable.

    With --html, writes the clouds under the pose as a page, SOURCE_on_TARGET_assessed.html.
    """
    given = io.read_transform(pose)
    clouds = read_both(source, target)
    page = out / f"{name_of_pair(source, target)}_assessed.html"
    results, written = Results(out, f"assess {page.stem}"), list[Path]()
    if html:
        check_folder(out)
        results.check([page], [source, target, pose])
    with show_stages() as begin:
        done = assess(*clouds, given, **shared, progress=begin)
    message = None if done.ok else f"the pose is unreliable: {done.notes[0]}"
    if html:
        from cgroup.pages import registration_page, write_page  # noqa: PLC0415 - slow to load

        title = f"{source.name} on {target.name}, given pose"
        with results.writing(identify_run(context)) as written:
            write_page(page, registration_page(*clouds, done, title=title, refusal=message))
    if message is not None:
        if html:
            write_error(f"cgroup: wrote {page.name} of the refused pose to {escape(str(out))}/")
        advice = "to register from it: cgroup register SOURCE TARGET --initial POSE --html"
        raise RefusedPoseError(f"{message}; {advice}", registration_results(done))
    return {
        "inputs": describe_pair((source, target), clouds),
        "results": registration_results(done),
        "files": written,
    }


def _front(
    context: typer.Context, front: Front, support: float, front_end: dict[str, Any]
) -> Literal["dense"] | DenseFront | PaperFront:
    """Return the feature extraction; arguments that exclude it allow only "dense"."""
    if front == "paper":
        return PaperFront(**front_end)
    return DenseFront(support=support) if is_given(context, "support") else "dense"


def _check_options(context: typer.Context, clouds: int, front: Front) -> None:
    """Raise `InputError` for more than two clouds, and for options that exclude each other."""
    if clouds > 2:
        advice = "cgroup merge registers many into one scene"
        message = f"register: got {clouds} clouds, and registers two; {advice}"
        raise InputError(message)
    other, names = ("dense", ["support"]) if front == "paper" else ("paper", options.FRONT)
    for name in names:
        if is_given(context, name):
            refused = "--" + name.replace("_", "-")
            message = f"{refused}: belongs to --front {other}, but the front is {front!r}"
            raise InputError(message)
    if is_given(context, "truth") and is_given(context, "scale"):
        raise InputError("truth", remedy="files of poses have no scale; leave out --truth, or --scale")
