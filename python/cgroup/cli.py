"""The command line: reads, calls the library, prints, writes. Nothing is computed here."""

from __future__ import annotations

import sys
import time
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import numpy as np

try:
    import typer
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
    from rich.table import Table
except ModuleNotFoundError as missing:
    sys.stderr.write(f"cgroup: the command line needs {missing.name}; pip install 'cgroup[scans]'\n")
    raise SystemExit(2) from None

from cgroup import __version__, io
from cgroup.benchmark import compare, write_table
from cgroup.cli_benchmark import benchmark_app
from cgroup.errors import CgroupError, InputError
from cgroup.evaluation import correct_matches
from cgroup.evaluation.ground_truth import CORRECT_WITHIN
from cgroup.group import group
from cgroup.registration import (
    Descriptor,
    Detector,
    Normals,
    Registration,
    correspond,
    describe,
    detect,
    register,
)
from cgroup.registry import METHODS
from cgroup.types import OPTIONAL_FIELDS, Correspondences

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence

    from matplotlib.figure import Figure

    from cgroup.benchmark import MethodResult
    from cgroup.types import BoolArray, FloatArray, IndexArray, PointCloud

INPUT_ERROR = 2
INTERRUPTED = 130

_COMPARISON_FILES = ("comparison.csv", "comparison.png", "precision_recall.png", "correspondences.npz")
_KEYPOINT_PICTURES = ("keypoints.ply", "keypoints.png")
_DETECTOR_NAMES: dict[Detector, str] = {"h3d": "Harris 3D", "iss": "ISS"}
_PLAIN_WIDTH = 120  # of tables where the output isn't a terminal

app = typer.Typer(
    name="cgroup",
    help="3D correspondence grouping: find the right matches between two scans among mostly wrong ones.",
    add_completion=False,
    pretty_exceptions_enable=False,
)

app.add_typer(benchmark_app, name="benchmark")

SourceArgument = Annotated[Path, typer.Argument(help="Cloud to be moved: PLY, PCD, XYZ, OBJ, STL, OFF.")]
TargetArgument = Annotated[Path, typer.Argument(help="Cloud that it is moved to, in the same unit.")]
MethodOption = Annotated[str, typer.Option(help=f"Grouping method: {', '.join(METHODS)}.")]
DetectorOption = Annotated[Detector, typer.Option(help="Keypoint detector.")]
DescriptorOption = Annotated[Descriptor, typer.Option(help="Descriptor.")]
NormalsOption = Annotated[
    Normals,
    typer.Option(
        help="Fitted planes that face the origin, those of the mesh (for whole models), or the file's."
    ),
]
KeypointsOption = Annotated[
    int | None,
    typer.Option(min=3, help="How many keypoints to aim at in each cloud.", show_default="all found"),
]
NmsRadiusOption = Annotated[
    float | None,
    typer.Option(
        help="Radius of the non-maximum suppression in pr: the larger, the fewer keypoints.",
        show_default="2.7 for h3d, 1.8 for iss",
    ),
]
ResolutionOption = Annotated[
    float | None,
    typer.Option(
        help="The unit pr, in the file's unit; clouds to be matched need the same.",
        show_default="mean point spacing of the cloud",
    ),
]
CloudArgument = Annotated[Path, typer.Argument(help="Cloud or mesh: PLY, PCD, XYZ, OBJ, STL, OFF.")]
OutOption = Annotated[Path, typer.Option(help="Folder for the results; made if need be.")]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit: 0 done, 2 input that can't be worked with, 130 interrupted."""
    try:
        status = app(args=arguments, prog_name="cgroup", standalone_mode=False)
    except (CgroupError, typer.TyperException) as error:
        message = error.format_message() if isinstance(error, typer.TyperException) else str(error)
        _fail(message, INPUT_ERROR)
    except KeyboardInterrupt:
        status = INTERRUPTED
    if status == INTERRUPTED:
        _fail("interrupted", INTERRUPTED)
    raise SystemExit(status or 0)


@app.callback(invoke_without_command=True)
def _without_command(
    context: typer.Context,
    *,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if version:
        _print(f"cgroup {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        sys.stdout.write(context.get_help())


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
    out: OutOption = Path("out"),
) -> None:
    """Place one scan on another: matches, the group that agrees, and the pose it fixes."""
    _check_method(method)
    clouds = _read_both(source, target)
    folder = _folder(out)
    with _progress() as begin:
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
        figure = _registration_figure(clouds, done, f"{source.name} on {target.name}, {method.upper()}")
        io.write_transform(folder / "transform.txt", done.T_target_source)
        io.write_cloud(folder / "aligned.ply", clouds[0].transformed(done.T_target_source))
        io.write_correspondences(folder / "correspondences.npz", done.correspondences)
        _save(figure, folder / "registration.png")
    _print_clouds((source, target), clouds)
    _print_facts(
        ("resolution", f"{done.resolution:.4g} (mean point spacing, in the files' unit)"),
        ("matches", f"{len(done.correspondences)}"),
        ("group", f"{done.grouping.size} by {method.upper()}"),
        ("time", ", ".join(f"{name} {1e3 * seconds:.0f} ms" for name, seconds in done.seconds.items())),
    )
    _print("pose of the source in the target's frame")
    for row in done.T_target_source:
        _print("  " + " ".join(f"{number:12.6g}" for number in row))
    _print_written(folder, "transform.txt", "aligned.ply", "correspondences.npz", "registration.png")


@app.command("compare")
def compare_command(
    source: SourceArgument,
    target: TargetArgument,
    *,
    truth: Annotated[
        Path, typer.Option(help="True pose of the source in the target's frame: 4x4 text or .npy.")
    ],
    detector: DetectorOption = "h3d",
    descriptor: DescriptorOption = "shot",
    normals: NormalsOption = "pca",
    keypoints: KeypointsOption = None,
    nms_radius: NmsRadiusOption = None,
    out: OutOption = Path("out"),
) -> None:
    """Run all nine methods on a pair whose pose is known, and judge what each selects."""
    true_pose = io.read_transform(truth)
    clouds = _read_both(source, target)
    title = f"{source.name} to {target.name}"
    matches, results = _compare(
        clouds,
        true_pose,
        title=title,
        folder=_folder(out),
        detector=detector,
        descriptor=descriptor,
        normals=normals,
        keypoints=keypoints,
        nms_radius=nms_radius,
    )
    _print_clouds((source, target), clouds)
    _print_comparison(matches, results, true_pose)
    _print_written(out, *_COMPARISON_FILES)


@app.command("demo")
def demo_command(
    seed: Annotated[int, typer.Option(min=0, help="Another seed, another shape.")] = 0,
    out: OutOption = Path("out"),
) -> None:
    """Run all nine methods on a generated pair: two views of a closed shape rich in detail."""
    from cgroup.datasets import standin_pair  # noqa: PLC0415 - slow to load

    with _progress() as begin:
        begin("generating two scans")
        pair = standin_pair(seed=seed)
    folder = _folder(out)
    for name, cloud in (("source", pair.source), ("target", pair.target)):
        io.write_cloud(folder / f"{name}.ply", cloud)
    io.write_transform(folder / "truth.txt", pair.T_target_source)
    clouds = (pair.source, pair.target)
    matches, results = _compare(clouds, pair.T_target_source, title="Generated pair", folder=folder)
    _print_clouds((folder / "source.ply", folder / "target.ply"), clouds)
    _print_comparison(matches, results, pair.T_target_source)
    _print_written(out, "source.ply", "target.ply", "truth.txt", *_COMPARISON_FILES)


@app.command("detect")
def detect_command(
    cloud: CloudArgument,
    *,
    detector: DetectorOption = "h3d",
    keypoints: KeypointsOption = None,
    nms_radius: NmsRadiusOption = None,
    resolution: ResolutionOption = None,
    out: OutOption = Path("out"),
) -> None:
    """Find the keypoints of one cloud."""
    with _progress() as begin:
        begin(f"reading {cloud.name}")
        points = io.read_cloud(cloud)
        begin("keypoints")
        found = detect(
            points, detector=detector, keypoints=keypoints, nms_radius=nms_radius, resolution=resolution
        )
        folder = _folder(out)
        begin("figure")
        io.write_keypoints(folder / "keypoints.npz", points, found)
        _write_keypoint_pictures(folder, points, found, f"{cloud.name}, {_DETECTOR_NAMES[detector]}")
    _print_cloud("cloud", cloud, points)
    _print_facts(("keypoints", f"{len(found)} by {_DETECTOR_NAMES[detector]}"))
    _print_written(folder, "keypoints.npz", *_KEYPOINT_PICTURES)


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
    out: OutOption = Path("out"),
) -> None:
    """Find the keypoints of one cloud, and give each a frame and a descriptor."""
    with _progress() as begin:
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
        folder = _folder(out)
        begin("figure")
        io.write_descriptors(folder / "descriptors.npz", described)
        title = f"{cloud.name}, {_DETECTOR_NAMES[detector]}"
        _write_keypoint_pictures(folder, points, described.indices, title)
    _print_cloud("cloud", cloud, points)
    _print_facts(
        ("resolution", f"{described.resolution:.4g} (1 pr, in the file's unit)"),
        ("keypoints", f"{len(described)} by {_DETECTOR_NAMES[detector]}"),
        ("descriptors", f"{descriptor.upper()}, {described.descriptors.shape[1]} numbers each"),
    )
    _print_written(folder, "descriptors.npz", *_KEYPOINT_PICTURES)


@app.command("group")
def group_command(
    correspondences: Annotated[
        Path, typer.Argument(help="NPZ with the fields of Correspondences, or text: x y z x' y' z' per line.")
    ],
    method: MethodOption = "gtm",
    resolution: Annotated[
        float | None,
        typer.Option(
            help="Mean point spacing of the clouds, in the file's unit.", show_default="as in the file"
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Inlier distance of RANSAC, SI and GC, in the file's unit.", show_default="the paper's"
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Mask to write: .npy, or text with 0 or 1 per line.", show_default="NAME_METHOD.npy"
        ),
    ] = None,
) -> None:
    """Group correspondences of your own, and write which of them are selected."""
    _check_method(method)
    given = io.read_correspondences(correspondences)
    if resolution is not None:
        given = _with_resolution(given, resolution)
    options: dict[str, Any] = {} if tolerance is None else {"tolerance": tolerance}
    start = time.perf_counter()
    with _progress() as begin:
        begin(f"grouping by {method.upper()}")
        grouping = group(given, method, **options)
    seconds = time.perf_counter() - start
    path = Path(f"{correspondences.stem}_{method}.npy") if out is None else out
    io.write_mask(path, grouping.mask)
    _print(f"{grouping.size} of {len(given)} selected by {method.upper()} in {1e3 * seconds:.0f} ms")
    _print(f"wrote {path}")


# --- work shared by the commands -----------------------------------------------------------------


def _compare(
    clouds: tuple[PointCloud, PointCloud],
    true_pose: FloatArray,
    *,
    title: str,
    folder: Path,
    **front: Any,  # noqa: ANN401 - options of `correspond`
) -> tuple[Correspondences, list[MethodResult]]:
    """Match, group by every method, and write `_COMPARISON_FILES`."""
    from cgroup.plots import comparison_figure, precision_recall_figure  # noqa: PLC0415 - slow to load

    with _progress() as begin:
        matches = correspond(*clouds, progress=begin, **front)
        results: list[MethodResult] = []
        for method in METHODS:
            begin(f"grouping by {method.upper()}")
            results.extend(compare(matches, true_pose, methods=[method]))
        begin("figures")
        correct = _correct(matches, true_pose)
        title = f"{title}: {_share(correct)}"
        panels = comparison_figure(
            clouds[0].points,
            clouds[1].points,
            matches,
            correct=correct,
            results=results,
            T_target_source=true_pose,
            title=title,
        )
        _save(panels, folder / "comparison.png")
        _save(precision_recall_figure(results, title=title), folder / "precision_recall.png")
        write_table(folder / "comparison.csv", results)
        io.write_correspondences(folder / "correspondences.npz", matches)
    return matches, results


def _write_keypoint_pictures(folder: Path, cloud: PointCloud, found: IndexArray, title: str) -> None:
    """Write `_KEYPOINT_PICTURES`."""
    from cgroup.plots import keypoints_figure  # noqa: PLC0415 - slow to load

    io.write_keypoints(folder / "keypoints.ply", cloud, found)
    _save(keypoints_figure(cloud.points, {"Keypoints": found}, title=title), folder / "keypoints.png")


def _print_comparison(matches: Correspondences, results: list[MethodResult], true_pose: FloatArray) -> None:
    correct = _correct(matches, true_pose)
    _print_facts(
        ("resolution", f"{matches.resolution:.4g} (mean point spacing, in the files' unit; 1 pr)"),
        ("matching", f"{_share(correct)}, that is within {CORRECT_WITHIN:g} pr of the true place"),
    )
    _print_results(results, matches.resolution or np.nan)
    _warn_of_inverse(matches, correct, true_pose)


def _share(correct: BoolArray) -> str:
    right = int(np.count_nonzero(correct))
    return f"{len(correct)} matches, {right} correct ({100 * right / max(len(correct), 1):.1f} %)"


def _print_results(results: list[MethodResult], pr: float) -> None:
    table = Table()
    for header in ("method", "selected", "precision", "recall", "F", "registered"):
        table.add_column(header, justify="left" if header == "method" else "right")
    for header in ("rotation error", "translation error", "time"):
        table.add_column(header, justify="right")
    for result in results:
        score = result.score
        posed = result.T_target_source is not None
        table.add_row(
            result.method.upper(),
            str(score.selected),
            f"{score.precision:.3f}",
            f"{score.recall:.3f}",
            f"{score.f_score:.3f}",
            "yes" if score.registered else "no",
            f"{result.rotation_error:.2f} deg" if posed else "no pose",
            f"{result.translation_error / pr:.2f} pr" if posed else "no pose",
            f"{1e3 * result.seconds:.1f} ms",
        )
    _console().print(table)
    _print("Registered: precision above 0.1. Errors are those of the least-squares pose of the whole group.")


def _warn_of_inverse(matches: Correspondences, correct: BoolArray, true_pose: FloatArray) -> None:
    """Say so where the truth is written the other way round, the usual reason for no correct match."""
    inverse = _correct(matches, np.linalg.inv(true_pose).astype(np.float64))
    if inverse.sum() > 10 * max(int(correct.sum()), 1):
        _print(
            f"Note: {int(inverse.sum())} matches would be correct under the inverse of this truth; "
            "it has to map the source into the target's frame."
        )


def _correct(matches: Correspondences, pose: FloatArray) -> BoolArray:
    tolerance = CORRECT_WITHIN * (matches.resolution or np.nan)
    return correct_matches(matches.source, matches.target, pose, tolerance=tolerance)


def _registration_figure(clouds: tuple[PointCloud, PointCloud], done: Registration, title: str) -> Figure:
    from cgroup.plots import registration_figure  # noqa: PLC0415 - slow to load

    return registration_figure(
        clouds[0].points,
        clouds[1].points,
        done.correspondences,
        mask=done.grouping.mask,
        T_target_source=done.T_target_source,
        title=title,
    )


def _read_both(source: Path, target: Path) -> tuple[PointCloud, PointCloud]:
    with _progress() as begin:
        begin(f"reading {source.name}")
        first = io.read_cloud(source)
        begin(f"reading {target.name}")
        return first, io.read_cloud(target)


def _check_method(method: str) -> None:
    if method not in METHODS:
        message = f"method: got {method!r}; choose one of {', '.join(METHODS)}"
        raise InputError(message)


def _with_resolution(correspondences: Correspondences, resolution: float) -> Correspondences:
    fields = {name: getattr(correspondences, name) for name in OPTIONAL_FIELDS}
    fields["resolution"] = resolution
    return Correspondences(correspondences.source, correspondences.target, **fields)


def _folder(path: Path) -> Path:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        message = f"{path}: can't be made a folder for the results ({error.strerror or error})"
        raise InputError(message) from error
    return path


def _save(figure: Figure, path: Path) -> None:
    buffer = BytesIO()
    figure.savefig(buffer, format="png")  # pyright: ignore[reportUnknownMemberType]
    io.write_file(path, buffer.getvalue())


# --- the terminal --------------------------------------------------------------------------------


def _console() -> Console:
    console = Console()
    return console if console.is_terminal else Console(width=_PLAIN_WIDTH)


def _print(line: str) -> None:
    sys.stdout.write(line + "\n")


def _print_facts(*facts: tuple[str, str]) -> None:
    for name, text in facts:
        _print(f"{name:<11} {text}")


def _print_clouds(names: tuple[Path, Path], clouds: tuple[PointCloud, PointCloud]) -> None:
    for role, name, cloud in zip(("source", "target"), names, clouds, strict=True):
        _print_cloud(role, name, cloud)


def _print_cloud(role: str, name: Path, cloud: PointCloud) -> None:
    dropped = f", {cloud.dropped} more without finite coordinates left out" if cloud.dropped else ""
    _print_facts((role, f"{name}: {len(cloud)} points{dropped}"))


def _print_written(folder: Path, *names: str) -> None:
    _print(f"wrote {', '.join(names)} to {folder}/")


def _fail(message: str, status: int) -> NoReturn:
    sys.stderr.write(f"cgroup: {' '.join(message.split())}\n")
    raise SystemExit(status)


@contextmanager
def _progress() -> Generator[Callable[[str], None], None, None]:
    """Show what is being done and for how long, on a terminal only; gone when it is over."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield _ignore
        return
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("", total=None)
        yield lambda stage: progress.update(task, description=stage)


def _ignore(_stage: str) -> None:
    """Stand in for progress where nobody watches."""
