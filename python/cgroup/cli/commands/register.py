"""``cgroup register`` and ``assess``: estimate the pose of one cloud on another, or judge a given one."""

from pathlib import Path
from typing import Any, Literal

import typer

from cgroup import io
from cgroup._checks.quoting import escape
from cgroup.cli import options
from cgroup.cli.command import command, identify_run
from cgroup.cli.documents import Document
from cgroup.cli.errors import RefusedPoseError, is_given, reword
from cgroup.cli.files import PairFiles, crop_clouds, describe_pair, name_of_pair, print_contents, read_both
from cgroup.cli.options import FRONT, METHOD_NAMES, OUTPUT, SEARCH, TRUTH, argument, choice, flag, option
from cgroup.cli.process import write_error
from cgroup.cli.registration_facts import describe_truth, placement_facts, registration_results
from cgroup.cli.targets import SIGMA, TARGETS, fit_files, print_targets, refuse_targets, report_files
from cgroup.cli.terminal import print_clouds, print_facts, print_pose, show_stages
from cgroup.errors import InputError, NoConsensusError
from cgroup.group import check_method
from cgroup.io.result_folders import Results, check_folder
from cgroup.registration import DenseFront, PaperFront, assess, register

Front = Literal["dense", "paper"]

# Options of both commands.
_PAIR = ("voxel", "viewpoint", "source_viewpoint", "target_viewpoint", "view_direction", "axis", "effort")
# Options of the search, which targets replace.
_SEARCH = ("matches", "initial", "radius", "angle", "scale", "method", "front", "support", "free")
_CROPS = ("source_crop", "target_crop")


def _print_registration(document: Document, *, verbose: bool) -> None:
    done = document["results"]
    print_clouds(document["inputs"][:2])
    if "targets" in done:
        print_targets(done["targets"])
    print_facts(*placement_facts(done, document["inputs"][0]["centroid"]))
    if verbose:
        times = (f"{name} {1e3 * seconds:.0f} ms" for name, seconds in done["seconds"].items())
        print_facts(
            ("voxel", f"{done['voxel']:.4g}"),
            ("matches", f"{done['selected']} of {done['matches']} agree with the pose"),
            ("time", ", ".join(times)),
        )
    print_pose(done["T_target_source"], document["inputs"][0])
    print_contents(document)


@command(
    "register",
    "cgroup register source.ply target.ply",
    "# two LiDAR scans, each from its own origin, in metres",
    "cgroup register a.pcd b.pcd --voxel 0.3 --viewpoint 0 0 0 --axis 0 0 1",
    "# near a roughly known pose: within 5 m and 10 degrees",
    "cgroup register a.pcd b.pcd --initial odometry.txt --radius 5 --angle 10",
    "# levelled scans, a box of the source only",
    "cgroup register a.ply b.ply --free yaw,x,y,z --source-crop -5 -5 0 5 5 2",
    "# the source's unit is 0.5 to 2 of the target's",
    "cgroup register a.ply b.ply --scale 0.5 2",
    "# the pose of surveyed targets, judged on the clouds",
    "cgroup register a.ply b.ply --targets scan.csv site.csv",
    "# errors against a known pose",
    "cgroup register a.ply b.ply --truth pose.txt",
    "# the paper's feature extraction, for a script",
    "cgroup register a.ply b.ply --front paper --method gtm --json",
    show=_print_registration,
    takes=(*_PAIR, "free", *_CROPS, *FRONT),
)
def register_command(
    context: typer.Context,
    source: Path = options.SOURCE,
    target: Path = options.TARGET,
    others: list[Path] = argument("CLOUD", "More than two are refused.", None, hidden=True),
    *,
    front: Front = choice("dense", Front, "Match all voxels by FPFH, or the paper's keypoints.", SEARCH),
    method: str | None = option(
        "NAME",
        f"Grouping method that proposes poses: {METHOD_NAMES}.",
        SEARCH,
        "lc, or gtm with the paper's front",
        autocompletion=options.complete_methods,
    ),
    support: float = option("VOXELS", "Radius of FPFH, in voxels.", SEARCH, default=DenseFront.support),
    matches: Path | None = option(
        "FILE", "Your own matches, such as a network's, in place of FPFH's: x y z x' y' z', or NPZ.", SEARCH
    ),
    initial: Path | None = option(
        "POSE", "File of a rough pose, such as odometry's; the search stays near it.", SEARCH
    ),
    radius: float | None = option(
        "LENGTH",
        "Largest error of --initial at the source's middle.",
        SEARCH,
        "a fifth of the source's diagonal",
    ),
    angle: float | None = option("DEGREES", "Largest rotation error of --initial, up to 60.", SEARCH, "15"),
    scale: tuple[float, float] | None = option(
        "LOW HIGH",
        "Estimate the scale too, within this range: the source's unit in the target's.",
        SEARCH,
        "the same unit",
    ),
    targets: tuple[Path, Path] | None = TARGETS,
    sigma: float | None = SIGMA,
    truth: Path | None = option("POSE", "File of the true pose; errors against it are printed.", TRUTH),
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
    if targets is not None:
        return _assess_targets(context, (source, target), targets, sigma, shared)
    method = None if method is None else check_method(method)
    true_pose, rough = (None if file is None else io.read_transform(file) for file in (truth, initial))
    own = None if matches is None else io.read_correspondences(matches)
    clouds = read_both(source, target)
    writer = PairFiles(out, source, target, identify_run(context), html=html, merged=merged)
    try:
        with show_stages() as begin:
            done = register(
                *crop_clouds(clouds, shared),
                **{name: shared[name] for name in (*_PAIR, "free")},
                front=_front(context, front, support, {name: shared[name] for name in FRONT}),
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
        reason = reason if html else f"{reason}{options.DRAW_GUESS}"
        results = registration_results(guess, clouds, true_pose)
        if true_pose is not None and not as_json:
            print_facts(("truth", f"the refused guess is {describe_truth(results)}"))
        raise RefusedPoseError(reason, results) from error
    return {
        "inputs": describe_pair((source, target), clouds),
        "results": registration_results(done, clouds, true_pose),
        "files": files,
    }


def _assess_targets(
    context: typer.Context,
    files: tuple[Path, Path],
    targets: tuple[Path, Path],
    sigma: float | None,
    shared: dict[str, Any],
) -> Document:
    """Judge the pose of surveyed targets on the clouds, and write it with the report of the targets."""
    given = context.params
    true_pose = None if given["truth"] is None else io.read_transform(given["truth"])
    inputs, found = fit_files(targets, sigma)
    report = report_files(found, name_of_pair(*files), html=given["html"])
    clouds, written = read_both(*files), {name: given[name] for name in ("html", "merged")}
    writer = PairFiles(given["out"], *files, identify_run(context), **written, report=report)
    with show_stages() as begin:
        pair = {name: shared[name] for name in _PAIR}
        done = assess(*clouds, found["T_target_source"], **pair, progress=begin)
        begin("figures")
        names = writer.write(clouds, done, true_pose)
    doubt = None if done.ok else f"the clouds do not confirm the pose of the targets: {done.notes[0]}"
    return {
        "inputs": [*describe_pair(files, clouds), *inputs],
        "results": {**registration_results(done, clouds, true_pose), "targets": found},
        "files": names,
        "refusal": refuse_targets(found) or doubt,
    }


@command(
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
    out: Path = options.folder("out", "Folder for the page; created if needed.", OUTPUT),
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
    other, names = ("dense", ["support"]) if front == "paper" else ("paper", FRONT)
    for name in names:
        if is_given(context, name):
            refused = "--" + name.replace("_", "-")
            message = f"{refused}: belongs to --front {other}, but the front is {front!r}"
            raise InputError(message)
    if is_given(context, "targets"):
        for name in (*_SEARCH, *_CROPS, *FRONT):
            if is_given(context, name):
                raise InputError(name, remedy="has no use with --targets, which give the pose; leave it out")
    if is_given(context, "truth") and is_given(context, "scale"):
        raise InputError("truth", remedy="files of poses have no scale; leave out --truth, or --scale")
