"""``cgroup register``, ``compare`` and ``demo``: two clouds, placed on each other or compared by methods."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich.table import Table

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
    print_line,
    print_table,
    print_written,
    show_stages,
    write_figure,
)
from cgroup.comparison import compare, find_correct, write_table
from cgroup.evaluation.ground_truth import CORRECT_WITHIN
from cgroup.registration import Registration, correspond, register

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cgroup.comparison import MethodResult
    from cgroup.io import PointCloud
    from cgroup.types import BoolArray, Correspondences, FloatArray

_COMPARISON_FILES = ("comparison.csv", "comparison.png", "precision_recall.png", "correspondences.npz")

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
    clouds = _read_both(source, target)
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
    _print_clouds((source, target), clouds)
    _print_registration(done, method)
    print_written(folder, "transform.txt", "aligned.ply", "correspondences.npz", "registration.png")


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
    out: OutOption = DEFAULT_OUT,
) -> None:
    """Run all methods on a pair whose pose is known, and judge what each selects."""
    true_pose = io.read_transform(truth)
    clouds = _read_both(source, target)
    compared = _compare(
        clouds,
        true_pose,
        title=f"{source.name} to {target.name}",
        folder=make_folder(out),
        detector=detector,
        descriptor=descriptor,
        normals=normals,
        keypoints=keypoints,
        nms_radius=nms_radius,
    )
    _print_clouds((source, target), clouds)
    _print_comparison(compared)
    print_written(out, *_COMPARISON_FILES)


@app.command("demo")
def demo_command(
    seed: Annotated[int, typer.Option(min=0, help="Another seed, another shape.")] = 0,
    out: OutOption = DEFAULT_OUT,
) -> None:
    """Run all methods on a generated pair: two views of a closed shape rich in detail."""
    from cgroup.datasets import standin_pair  # noqa: PLC0415 - slow to load

    with show_stages() as begin:
        begin("generating two scans")
        pair = standin_pair(seed=seed)
    folder = make_folder(out)
    for name, cloud in (("source", pair.source), ("target", pair.target)):
        io.write_cloud(folder / f"{name}.ply", cloud)
    io.write_transform(folder / "truth.txt", pair.T_target_source)
    clouds = (pair.source, pair.target)
    compared = _compare(clouds, pair.T_target_source, title="Generated pair", folder=folder)
    _print_clouds((folder / "source.ply", folder / "target.ply"), clouds)
    _print_comparison(compared)
    print_written(out, "source.ply", "target.ply", "truth.txt", *_COMPARISON_FILES)


@dataclass(frozen=True, eq=False)
class _Comparison:
    """All methods on one pair."""

    matches: Correspondences
    true_pose: FloatArray
    correct: BoolArray  # of the matches, under the true pose
    results: list[MethodResult]


def _compare(
    clouds: tuple[PointCloud, PointCloud],
    true_pose: FloatArray,
    *,
    title: str,
    folder: Path,
    **front: Any,  # noqa: ANN401 - options of `correspond`
) -> _Comparison:
    """Match, group by every method, and write `_COMPARISON_FILES`."""
    with show_stages() as begin:
        matches = correspond(*clouds, progress=begin, **front)
        correct = find_correct(matches, true_pose)

        def begin_method(method: str) -> None:
            begin(f"grouping by {method.upper()}")

        results = list(compare(matches, true_pose, correct=correct, progress=begin_method))
        compared = _Comparison(matches, true_pose, correct, results)
        begin("figures")
        _draw_comparison(clouds, compared, f"{title}: {_count_correct(correct)}", folder)
        write_table(folder / "comparison.csv", results)
        io.write_correspondences(folder / "correspondences.npz", matches)
    return compared


def _draw_comparison(
    clouds: tuple[PointCloud, PointCloud], compared: _Comparison, title: str, folder: Path
) -> None:
    from cgroup.plots import comparison_figure, precision_recall_figure  # noqa: PLC0415 - slow to load

    panels = comparison_figure(
        clouds[0].points,
        clouds[1].points,
        compared.matches,
        correct=compared.correct,
        masks={result.method: result.grouping.mask for result in compared.results},
        T_target_source=compared.true_pose,
        title=title,
    )
    write_figure(folder / "comparison.png", panels)
    scores = {result.method: result.score for result in compared.results}
    write_figure(folder / "precision_recall.png", precision_recall_figure(scores, title=title))


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


def _read_both(source: Path, target: Path) -> tuple[PointCloud, PointCloud]:
    with show_stages() as begin:
        begin(f"reading {source.name}")
        first = io.read_cloud(source)
        begin(f"reading {target.name}")
        return first, io.read_cloud(target)


def _print_clouds(files: tuple[Path, Path], clouds: tuple[PointCloud, PointCloud]) -> None:
    for role, file, cloud in zip(("source", "target"), files, clouds, strict=True):
        print_cloud(role, file, cloud)


def _print_registration(done: Registration, method: str) -> None:
    print_facts(
        ("resolution", f"{done.resolution:.4g} (mean point spacing, in the files' unit)"),
        ("matches", f"{len(done.correspondences)}"),
        ("group", f"{done.grouping.size} by {method.upper()}"),
        ("time", ", ".join(f"{name} {1e3 * seconds:.0f} ms" for name, seconds in done.seconds.items())),
    )
    print_line("pose of the source in the target's frame")
    for row in done.T_target_source:
        print_line("  " + " ".join(f"{number:12.6g}" for number in row))


def _print_comparison(compared: _Comparison) -> None:
    pr = compared.matches.resolution or np.nan
    correct = _count_correct(compared.correct)
    print_facts(
        ("resolution", f"{pr:.4g} (mean point spacing, in the files' unit; 1 pr)"),
        ("matching", f"{correct}, that is within {CORRECT_WITHIN:g} pr of the true place"),
    )
    print_table(_results_table(compared.results, pr))
    print_line(
        "Registered: precision above 0.1. Errors are those of the least-squares pose of the whole group."
    )
    _warn_of_inverse(compared)


def _count_correct(correct: BoolArray) -> str:
    count = int(np.count_nonzero(correct))
    return f"{len(correct)} matches, {count} correct ({100 * count / max(len(correct), 1):.1f} %)"


def _results_table(results: list[MethodResult], pr: float) -> Table:
    table = Table()
    for header in ("method", "selected", "precision", "recall", "F", "registered"):
        table.add_column(header, justify="left" if header == "method" else "right")
    for header in ("rotation error", "translation error", "time"):
        table.add_column(header, justify="right")
    for result in results:
        table.add_row(*_result_cells(result, pr))
    return table


def _result_cells(result: MethodResult, pr: float) -> tuple[str, ...]:
    score, posed = result.score, result.T_target_source is not None
    return (
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


def _warn_of_inverse(compared: _Comparison) -> None:
    """Say so where the truth is written the other way round, the usual reason for no correct match."""
    suspicious = 10 * max(int(compared.correct.sum()), 1)
    if len(compared.matches) <= suspicious:
        return
    inverse = np.linalg.inv(compared.true_pose).astype(np.float64)
    count = int(find_correct(compared.matches, inverse).sum())
    if count > suspicious:
        print_line(
            f"Note: {count} matches would be correct under the inverse of this truth; "
            "it has to map the source into the target's frame."
        )
