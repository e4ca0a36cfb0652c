"""``cgroup compare``: run all methods on a pair whose pose is known."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from cgroup import io
from cgroup._checks.values import refusal
from cgroup.cli import options
from cgroup.cli.help import command, make_app
from cgroup.cli.inputs import describe_pair, read_both
from cgroup.cli.output import Ending, files_in, options_of
from cgroup.cli.show.comparison import comparison_results, print_comparison, say_correct
from cgroup.cli.show.json import Document, make_document
from cgroup.cli.show.pages import COMPARISON_PAGE
from cgroup.cli.show.terminal import show_stages, shown_name, write_figure
from cgroup.comparison import MAX_DISPLACEMENT, MAX_ROTATION, compare, find_correct, write_table
from cgroup.io._results import check_folder, make_folder
from cgroup.registration import correspond
from cgroup.registry import label_of
from cgroup.rigid import invert

if TYPE_CHECKING:
    from cgroup.comparison import MethodResult
    from cgroup.types import BoolArray, Correspondences, FloatArray, PointCloud

_FILES = ("comparison.csv", "comparison.png", "precision_recall.png", "correspondences.npz")

app = make_app()


@command(
    app,
    "compare",
    "cgroup compare source.ply target.ply --truth pose.txt",
    "",
    "# other descriptors, and what became of it beside a run that was saved before",
    "cgroup compare a.ply b.ply --truth pose.txt --descriptor rcs --save rcs",
    "cgroup results compare shot rcs",
)
def compare_command(
    context: typer.Context,
    source: options.SourceArgument,
    target: options.TargetArgument,
    *,
    truth: Annotated[
        Path, options.option("POSE", "File of the true pose of the source in the target's frame.", "Truth")
    ],
    max_rotation: options.MaxRotationOption = MAX_ROTATION,
    max_displacement: options.MaxDisplacementOption = MAX_DISPLACEMENT,
    detector: options.DetectorOption = "h3d",
    descriptor: options.DescriptorOption = "shot",
    normals: options.NormalsOption = "pca",
    keypoints: options.KeypointsOption = None,
    nms_radius: options.NmsRadiusOption = None,
    out: options.OutOption = options.DEFAULT_OUT,
    html: options.HtmlOption = False,
    save: options.SaveOption = None,
    as_json: options.JsonOption = False,
    wide: options.WideOption = False,
) -> None:
    """Run all methods on a pair whose pose is known, and judge what each selects.

    Writes the table, the matches and pictures.
    """
    for name, limit in (("max_rotation", max_rotation), ("max_displacement", max_displacement)):
        if not np.isfinite(limit):
            raise refusal(name, limit, "give a finite number")
    folder, true_pose = check_folder(out), io.read_transform(truth)
    ending = Ending(as_json=as_json, save=save)
    document = compare_methods(
        context,
        (source, target),
        read_both(source, target),
        true_pose,
        title=f"{shown_name(source)} to {shown_name(target)}",
        folder=folder,
        html=html,
        limits=(max_rotation, max_displacement),
        detector=detector,
        descriptor=descriptor,
        normals=normals,
        keypoints=keypoints,
        nms_radius=nms_radius,
    )
    ending.finish(document, partial(print_comparison, wide=wide))


def compare_methods(
    context: typer.Context,
    files: tuple[Path, Path],
    clouds: tuple[PointCloud, PointCloud],
    true_pose: FloatArray,
    *,
    title: str,
    folder: Path,
    html: bool,
    limits: tuple[float, float] = (MAX_ROTATION, MAX_DISPLACEMENT),
    written: tuple[str, ...] = (),
    **front: Any,  # noqa: ANN401 - options of `correspond`
) -> Document:
    """Match, group by every method, and write the files; `limits` are in degrees and pr."""
    with show_stages() as begin:
        matches = correspond(*clouds, progress=begin, **front)
        correct = find_correct(matches, true_pose)
        results = list(
            compare(
                matches,
                true_pose,
                correct=correct,
                max_rotation=limits[0],
                max_displacement=limits[1] * (matches.resolution or np.nan),
                progress=lambda method: begin(f"grouping by {label_of(method)}"),
            )
        )
        begin("figures")
        make_folder(folder)
        _draw_comparison(folder, clouds, matches, results, true_pose, correct, title)
        if html:
            from cgroup.pages import comparison_page, write_page  # noqa: PLC0415 - slow to load

            page = comparison_page(*clouds, matches, results, true_pose, correct=correct, title=title)
            write_page(folder / COMPARISON_PAGE, page)
        write_table(folder / "comparison.csv", results)
        io.write_correspondences(folder / "correspondences.npz", matches)
    return make_document(
        str(context.info_name),
        inputs=describe_pair(files, clouds),
        options=options_of(context),
        results=comparison_results(
            matches,
            correct,
            results,
            T_target_source=true_pose,
            inverse_correct=_count_under_inverse(matches, correct, true_pose),
            limits=limits,
        ),
        files=files_in(folder, (*written, *_FILES, COMPARISON_PAGE) if html else (*written, *_FILES)),
    )


def _draw_comparison(
    folder: Path,
    clouds: tuple[PointCloud, PointCloud],
    matches: Correspondences,
    results: list[MethodResult],
    true_pose: FloatArray,
    correct: BoolArray,
    title: str,
) -> None:
    from cgroup.plots import comparison_figure, precision_recall_figure  # noqa: PLC0415 - slow to load

    title = f"{title}: {say_correct(len(correct), int(correct.sum()))}"
    panels = comparison_figure(
        clouds[0].points,
        clouds[1].points,
        matches,
        correct=correct,
        masks={result.method: result.grouping.mask for result in results},
        T_target_source=true_pose,
        title=title,
    )
    write_figure(folder / "comparison.png", panels)
    scores = {result.method: result.score for result in results}
    write_figure(folder / "precision_recall.png", precision_recall_figure(scores, title=title))


def _count_under_inverse(matches: Correspondences, correct: BoolArray, true_pose: FloatArray) -> int | None:
    """Count what would be correct under the inverse of the truth, where that is suspiciously much."""
    suspicious = 10 * max(int(correct.sum()), 1)
    if len(matches) <= suspicious:
        return None
    count = int(find_correct(matches, invert(true_pose)).sum())
    return count if count > suspicious else None
