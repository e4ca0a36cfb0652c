"""``cgroup compare`` and ``cgroup demo``: all methods on one pair whose pose is known."""

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
    MaxDisplacementOption,
    MaxRotationOption,
    NmsRadiusOption,
    NormalsOption,
    OutOption,
    SourceArgument,
    TargetArgument,
)
from cgroup.cli.pair import print_clouds, read_both
from cgroup.cli.terminal import (
    print_facts,
    print_line,
    print_table,
    print_written,
    show_stages,
    shown_name,
    write_figure,
)
from cgroup.comparison import MAX_DISPLACEMENT, MAX_ROTATION, compare, find_correct, write_table
from cgroup.evaluation.ground_truth import CORRECT_WITHIN
from cgroup.io._results import check_folder, make_folder
from cgroup.registration import correspond
from cgroup.registry import label_of
from cgroup.rigid import invert

if TYPE_CHECKING:
    from cgroup.comparison import MethodResult
    from cgroup.types import BoolArray, Correspondences, FloatArray, PointCloud

_FILES = ("comparison.csv", "comparison.png", "precision_recall.png", "correspondences.npz")

app = typer.Typer()


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
    max_rotation: MaxRotationOption = MAX_ROTATION,
    max_displacement: MaxDisplacementOption = MAX_DISPLACEMENT,
    out: OutOption = DEFAULT_OUT,
) -> None:
    """Run all methods on a pair whose pose is known, and judge what each selects."""
    folder, true_pose = check_folder(out), io.read_transform(truth)
    clouds = read_both(source, target)
    compared = _compare_methods(
        clouds,
        true_pose,
        title=f"{shown_name(source)} to {shown_name(target)}",
        folder=folder,
        max_rotation=max_rotation,
        max_displacement=max_displacement,
        detector=detector,
        descriptor=descriptor,
        normals=normals,
        keypoints=keypoints,
        nms_radius=nms_radius,
    )
    print_clouds((source, target), clouds)
    _print_comparison(compared)
    print_written(out, *_FILES)


@app.command("demo")
def demo_command(
    seed: Annotated[int, typer.Option(min=0, help="Another seed, another shape.")] = 0,
    out: OutOption = DEFAULT_OUT,
) -> None:
    """Run all methods on a generated pair: two views of a closed shape rich in detail."""
    from cgroup.datasets import standin_pair  # noqa: PLC0415 - slow to load

    check_folder(out)
    with show_stages() as begin:
        begin("generating two scans")
        pair = standin_pair(seed=seed)
    folder = make_folder(out)
    for name, cloud in (("source", pair.source), ("target", pair.target)):
        io.write_cloud(folder / f"{name}.ply", cloud)
    io.write_transform(folder / "truth.txt", pair.T_target_source)
    clouds = (pair.source, pair.target)
    compared = _compare_methods(clouds, pair.T_target_source, title="Generated pair", folder=folder)
    print_clouds((folder / "source.ply", folder / "target.ply"), clouds)
    _print_comparison(compared)
    print_written(out, "source.ply", "target.ply", "truth.txt", *_FILES)


@dataclass(frozen=True, eq=False)
class _Comparison:
    """All methods on one pair."""

    matches: Correspondences
    true_pose: FloatArray
    correct: BoolArray  # of the matches, under the true pose
    results: list[MethodResult]
    max_rotation: float  # of a registered pair, in degrees
    max_displacement: float  # likewise, in pr


def _compare_methods(
    clouds: tuple[PointCloud, PointCloud],
    true_pose: FloatArray,
    *,
    title: str,
    folder: Path,
    max_rotation: float = MAX_ROTATION,
    max_displacement: float = MAX_DISPLACEMENT,
    **front: Any,  # noqa: ANN401 - options of `correspond`
) -> _Comparison:
    """Match, group by every method, and write `_FILES`."""
    with show_stages() as begin:
        matches = correspond(*clouds, progress=begin, **front)
        correct = find_correct(matches, true_pose)

        def begin_method(method: str) -> None:
            begin(f"grouping by {label_of(method)}")

        results = compare(
            matches,
            true_pose,
            correct=correct,
            max_rotation=max_rotation,
            max_displacement=max_displacement * (matches.resolution or np.nan),
            progress=begin_method,
        )
        compared = _Comparison(matches, true_pose, correct, list(results), max_rotation, max_displacement)
        begin("figures")
        make_folder(folder)
        _draw_comparison(clouds, compared, f"{title}: {_count_correct(correct)}", folder)
        write_table(folder / "comparison.csv", compared.results)
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


def _print_comparison(compared: _Comparison) -> None:
    pr = compared.matches.resolution or np.nan
    correct = _count_correct(compared.correct)
    print_facts(
        ("resolution", f"{pr:.4g} (mean point spacing, in the files' unit; 1 pr)"),
        ("matching", f"{correct}, that is within {CORRECT_WITHIN:g} pr of the true place"),
    )
    print_table(_make_table(compared.results, pr))
    print_line(
        f"Registered: the pose that the group fixes is off by at most {compared.max_rotation:g} degrees, and "
        f"by {compared.max_displacement:g} pr on average"
    )
    print_line("over the matched points. P > 0.1: the paper's criterion, which asks for no pose.")
    _warn_of_inverse(compared)


def _count_correct(correct: BoolArray) -> str:
    count = int(np.count_nonzero(correct))
    return f"{len(correct)} matches, {count} correct ({100 * count / max(len(correct), 1):.1f} %)"


def _make_table(results: list[MethodResult], pr: float) -> Table:
    table = Table()
    headers = (
        "selected",
        "precision",
        "recall",
        "F",
        "P > 0.1",
        "registered",
        "rotation",
        "displaced",
        "time",
    )
    table.add_column("method")
    for header in headers:
        table.add_column(header, justify="right")
    for result in results:
        table.add_row(*_make_row(result, pr))
    return table


def _make_row(result: MethodResult, pr: float) -> tuple[str, ...]:
    score, posed = result.score, result.T_target_source is not None
    return (
        label_of(result.method),
        str(score.selected),
        f"{score.precision:.3f}",
        f"{score.recall:.3f}",
        f"{score.f_score:.3f}",
        "yes" if score.registered else "no",
        "yes" if result.registered else "no",
        f"{result.rotation_error:.2f} deg" if posed else "no pose",
        f"{result.displacement / pr:.2f} pr" if posed else "no pose",
        f"{1e3 * result.seconds:.1f} ms",
    )


def _warn_of_inverse(compared: _Comparison) -> None:
    """Say so where the truth is written the other way round, the usual reason for no correct match."""
    suspicious = 10 * max(int(compared.correct.sum()), 1)
    if len(compared.matches) <= suspicious:
        return
    inverse = invert(compared.true_pose)
    count = int(find_correct(compared.matches, inverse).sum())
    if count > suspicious:
        print_line(
            f"Note: {count} matches would be correct under the inverse of this truth; "
            "it has to map the source into the target's frame."
        )
