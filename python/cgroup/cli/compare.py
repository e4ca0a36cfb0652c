"""``cgroup compare`` and ``cgroup demo``: all methods on one pair whose pose is known."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from cgroup import io
from cgroup._checks.values import refusal
from cgroup.cli.comparison_output import comparison_results, count_correct, print_comparison
from cgroup.cli.help import Command, examples, make_app
from cgroup.cli.inputs import describe_pair, read_both
from cgroup.cli.json_output import Document, make_document
from cgroup.cli.options import (
    DEFAULT_OUT,
    DescriptorOption,
    DetectorOption,
    JsonOption,
    KeypointsOption,
    MaxDisplacementOption,
    MaxRotationOption,
    NmsRadiusOption,
    NormalsOption,
    OutOption,
    SaveOption,
    SourceArgument,
    TargetArgument,
    WideOption,
)
from cgroup.cli.output import Ending, files_in, options_of
from cgroup.cli.pages import COMPARISON_PAGE, HtmlOption, write_comparison_page
from cgroup.cli.terminal import show_stages, shown_name, write_figure
from cgroup.comparison import MAX_DISPLACEMENT, MAX_ROTATION, compare, find_correct, write_table
from cgroup.io._results import check_folder, make_folder
from cgroup.registration import correspond
from cgroup.registry import label_of
from cgroup.rigid import invert

if TYPE_CHECKING:
    from cgroup.comparison import MethodResult
    from cgroup.types import BoolArray, Correspondences, FloatArray, PointCloud

_FILES = ("comparison.csv", "comparison.png", "precision_recall.png", "correspondences.npz")
_SCANS = ("source.ply", "target.ply", "truth.txt")
_COMPARE_EXAMPLES = examples(
    "cgroup compare source.ply target.ply --truth pose.txt",
    "",
    "# other descriptors, and what became of it beside a run that was saved before",
    "cgroup compare a.ply b.ply --truth pose.txt --descriptor rcs --save rcs",
    "cgroup results compare shot rcs",
)
_DEMO_EXAMPLES = examples(
    "cgroup demo",
    "cgroup demo --seed 3 --out third --wide",
    "cgroup compare out/source.ply out/target.ply --truth out/truth.txt",
)

app = make_app()


@app.command("compare", cls=Command, epilog=_COMPARE_EXAMPLES)
def compare_command(
    context: typer.Context,
    source: SourceArgument,
    target: TargetArgument,
    *,
    truth: Annotated[
        Path,
        typer.Option(
            metavar="POSE",
            help="File of the true pose of the source in the target's frame.",
            rich_help_panel="Truth",
        ),
    ],
    max_rotation: MaxRotationOption = MAX_ROTATION,
    max_displacement: MaxDisplacementOption = MAX_DISPLACEMENT,
    detector: DetectorOption = "h3d",
    descriptor: DescriptorOption = "shot",
    normals: NormalsOption = "pca",
    keypoints: KeypointsOption = None,
    nms_radius: NmsRadiusOption = None,
    out: OutOption = DEFAULT_OUT,
    html: HtmlOption = False,
    save: SaveOption = None,
    as_json: JsonOption = False,
    wide: WideOption = False,
) -> None:
    """Run all methods on a pair whose pose is known, and judge what each selects.

    Writes the table, the matches and pictures.
    """
    for name, limit in (("max_rotation", max_rotation), ("max_displacement", max_displacement)):
        if not np.isfinite(limit):
            raise refusal(name, limit, "give a finite number")
    folder, true_pose = check_folder(out), io.read_transform(truth)
    ending = Ending(as_json=as_json, save=save)
    clouds = read_both(source, target)
    compared = _compare_methods(
        clouds,
        true_pose,
        title=f"{shown_name(source)} to {shown_name(target)}",
        folder=folder,
        html=html,
        max_rotation=max_rotation,
        max_displacement=max_displacement,
        detector=detector,
        descriptor=descriptor,
        normals=normals,
        keypoints=keypoints,
        nms_radius=nms_radius,
    )
    document = _make_document(
        context, (source, target), clouds, compared, files_in(folder, _files(html=html))
    )
    ending.finish(document, lambda document: print_comparison(document, wide=wide))


@app.command("demo", cls=Command, epilog=_DEMO_EXAMPLES)
def demo_command(
    context: typer.Context,
    *,
    seed: Annotated[
        int,
        typer.Option(min=0, metavar="NUMBER", help="Another seed, another shape.", rich_help_panel="Shape"),
    ] = 0,
    out: OutOption = DEFAULT_OUT,
    html: HtmlOption = False,
    save: SaveOption = None,
    as_json: JsonOption = False,
    wide: WideOption = False,
) -> None:
    """Run all methods on a generated pair: two views of a closed shape rich in detail.

    Writes the two scans and their true pose, and all that `cgroup compare` writes.
    """
    from cgroup.datasets import standin_pair  # noqa: PLC0415 - slow to load

    check_folder(out)
    ending = Ending(as_json=as_json, save=save)
    with show_stages() as begin:
        begin("generating two scans")
        pair = standin_pair(seed=seed)
    folder = make_folder(out)
    files = (folder / "source.ply", folder / "target.ply")
    clouds = (pair.source, pair.target)
    for file, cloud in zip(files, clouds, strict=True):
        io.write_cloud(file, cloud)
    io.write_transform(folder / "truth.txt", pair.T_target_source)
    compared = _compare_methods(
        clouds, pair.T_target_source, title="Generated pair", folder=folder, html=html
    )
    document = _make_document(
        context, files, clouds, compared, files_in(folder, (*_SCANS, *_files(html=html)))
    )
    ending.finish(document, lambda document: print_comparison(document, wide=wide))


def _files(*, html: bool) -> tuple[str, ...]:
    return (*_FILES, COMPARISON_PAGE) if html else _FILES


def _make_document(
    context: typer.Context,
    files: tuple[Path, Path],
    clouds: tuple[PointCloud, PointCloud],
    compared: _Comparison,
    written: list[str],
) -> Document:
    results = comparison_results(
        compared.matches,
        compared.correct,
        compared.results,
        T_target_source=compared.true_pose,
        inverse_correct=_count_under_inverse(compared),
    )
    results["limits"] = {
        "max_rotation_deg": compared.max_rotation,
        "max_displacement_pr": compared.max_displacement,
    }
    return make_document(
        str(context.info_name),
        inputs=describe_pair(files, clouds),
        options=options_of(context),
        results=results,
        files=written,
    )


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
    html: bool,
    max_rotation: float = MAX_ROTATION,
    max_displacement: float = MAX_DISPLACEMENT,
    **front: Any,  # noqa: ANN401 - options of `correspond`
) -> _Comparison:
    """Match, group by every method, and write the files."""
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
        _draw_comparison(clouds, compared, f"{title}: {count_correct(correct)}", folder)
        if html:
            write_comparison_page(folder, clouds, matches, compared.results, true_pose, correct, title)
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


def _count_under_inverse(compared: _Comparison) -> int | None:
    """Count what would be correct under the inverse of the truth, where that is suspiciously much."""
    suspicious = 10 * max(int(compared.correct.sum()), 1)
    if len(compared.matches) <= suspicious:
        return None
    count = int(find_correct(compared.matches, invert(compared.true_pose)).sum())
    return count if count > suspicious else None
