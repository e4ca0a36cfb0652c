"""``cgroup compare`` and ``demo``: run all methods on a pair of known pose."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import typer

from cgroup import io
from cgroup.cli import options
from cgroup.cli.command import command, identify_run, make_app
from cgroup.cli.documents import Document
from cgroup.cli.files import PairFiles, describe_pair, name_of_pair, read_both
from cgroup.cli.options import option
from cgroup.cli.registration_facts import placement_facts, registration_results
from cgroup.cli.terminal import (
    Column,
    print_clouds,
    print_facts,
    print_files,
    print_line,
    print_prose,
    print_table,
    show_stages,
    show_value,
    shown_name,
    write_figure,
)
from cgroup.comparison import (
    MAX_DISPLACEMENT,
    MAX_ROTATION,
    MethodResult,
    compare,
    find_correct,
    table,
    write_table,
)
from cgroup.evaluation.ground_truth import CORRECT_WITHIN
from cgroup.io.result_folders import Results
from cgroup.registration import correspond, register
from cgroup.registry import label_of
from cgroup.rigid import invert
from cgroup.types import BoolArray, Correspondences, FloatArray, PointCloud

_COLUMNS = (
    Column("method", is_text=True),
    Column("selected", priority=1),
    Column("precision"),
    Column("recall"),
    Column("F"),
    Column("P > 0.1", priority=4),
    Column("registered"),
    Column("rot deg", priority=2),
    Column("off pr"),
    Column("ms"),
)
app = make_app()


def _print_comparison(document: Document, *, wide: bool) -> None:
    results = document["results"]
    limits = results["limits"]
    print_clouds(document["inputs"])
    counted = _count_correct(results["matches"], results["correct"])
    pr = show_value(results["resolution"], ".4g")
    print_facts(
        ("resolution", f"{pr} (mean point spacing, in the files' unit; 1 pr)"),
        ("matching", f"{counted}: within {CORRECT_WITHIN:g} pr of the true place"),
    )
    rows = sorted(results["methods"], key=lambda row: (-row["f_score"], row["milliseconds"]))
    print_table(_COLUMNS, [_cells(row) for row in rows], wide=wide)
    print_prose(
        f"Registered: the errors of the group's pose are at most {limits['max_rotation_deg']:g} degrees and "
        f"{limits['max_displacement_pr']:g} pr, the latter as mean displacement of the matched points. "
        "P > 0.1: the paper's criterion, which needs no pose."
    )
    if results["correct_under_inverse"]:
        print_prose(
            f"Note: {results['correct_under_inverse']} matches would be correct under the inverse of this "
            "truth; the truth must map the source into the target's frame."
        )
    if "registration" in results:
        print_line("")
        print_line("Result of cgroup register, which verifies poses on the surfaces:")
        print_facts(*placement_facts(results["registration"], document["inputs"][0]["centroid"]))
    print_files(document)


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    posed, duration = row["T_target_source"] is not None, row["milliseconds"]
    return (
        label_of(row["method"]),
        str(row["selected"]),
        *(f"{row[name]:.3f}" for name in ("precision", "recall", "f_score")),
        *(show_value(row[name]) for name in ("precision_above_0.1", "registered")),
        *(f"{row[name]:.2f}" if posed else "no pose" for name in ("rotation_error_deg", "displacement_pr")),
        f"{duration:.1f}" if duration < 100 else f"{duration:.0f}",
    )


def _count_correct(matches: int, correct: int) -> str:
    return f"{matches} matches, {correct} correct ({100 * correct / max(matches, 1):.1f} %)"


@command(
    app,
    "compare",
    "cgroup compare source.ply target.ply --truth pose.txt",
    "",
    "# other descriptors",
    "cgroup compare a.ply b.ply --truth pose.txt --descriptor rcs --out rcs",
    show=_print_comparison,
    takes=[name for name in options.FRONT if name != "resolution"],
)
def compare_command(
    context: typer.Context,
    source: Path = options.SOURCE,
    target: Path = options.TARGET,
    *,
    truth: Path = option(..., "POSE", "File of the true pose of the source in the target.", options.TRUTH),
    out: Path = options.OUT,
    html: bool = options.HTML,
    **front_end: Any,
) -> Document:
    """Run all methods on a pair of known pose, and score their groups.

    Writes the table, the matches and a picture.
    """
    true_pose = io.read_transform(truth)
    return _compare_methods(
        (source, target),
        read_both(source, target),
        true_pose,
        title=f"{shown_name(source)} to {shown_name(target)}",
        folder=out,
        run=identify_run(context),
        html=html,
        **front_end,
    )


@command(
    app,
    "demo",
    "cgroup demo",
    "cgroup demo --seed 3 --out third --wide",
    "cgroup compare out/source.ply out/target.ply --truth out/truth.txt",
    show=_print_comparison,
)
def demo_command(
    context: typer.Context,
    *,
    seed: int = option(0, "NUMBER", "Seed of the shape.", "Shape", min=0),
    out: Path = options.OUT,
    html: bool = options.HTML,
) -> Document:
    """Run all methods on a generated pair, and register it.

    Writes the two scans, their true pose, and the files of `cgroup compare` and `cgroup register`.
    """
    from cgroup.datasets import standin_pair  # noqa: PLC0415 - slow to load

    with show_stages() as begin:
        begin("generating two scans")
        pair = standin_pair(seed=seed)
    source, target, truth = (out / name for name in ("source.ply", "target.ply", "truth.txt"))
    clouds, true_pose, run = (pair.source, pair.target), pair.T_target_source, identify_run(context)
    writer = PairFiles(out, source, target, run, html=html)
    results = Results(out, "demo")
    results.check([source, target, truth])
    with results.writing(run):
        io.write_cloud(source, pair.source)
        io.write_cloud(target, pair.target)
        io.write_transform(truth, true_pose)
    parts = _compare_methods(
        (source, target), clouds, true_pose, title="Generated pair", folder=out, run=run, html=html
    )
    with show_stages() as begin:
        done = register(*clouds, progress=begin)
        begin("figures")
        written = writer.write(clouds, done, true_pose)
    parts["results"]["registration"] = registration_results(done, clouds, true_pose)
    return {**parts, "files": [source, target, truth, *parts["files"], *written]}


def _compare_methods(
    files: tuple[Path, Path],
    clouds: tuple[PointCloud, PointCloud],
    true_pose: FloatArray,
    *,
    title: str,
    folder: Path,
    run: str,
    html: bool,
    **front_end: Any,
) -> Document:
    name, pages = name_of_pair(*files), ["comparison.html"] if html else []
    endings = ["comparison.csv", "comparison.png", "comparison.npz"]
    rows, panels_file, matches_file, *pages = (folder / f"{name}_{ending}" for ending in (*endings, *pages))
    outputs = Results(folder, f"compare {name}")
    outputs.check([rows, panels_file, matches_file, *pages])
    with show_stages() as begin:
        matches = correspond(*clouds, progress=begin, **front_end)
        correct = find_correct(matches, true_pose)
        results = list(
            compare(
                matches,
                true_pose,
                correct=correct,
                progress=lambda method: begin(f"grouping by {label_of(method)}"),
            )
        )
        begin("figure")
        from cgroup.plots import comparison_figure  # noqa: PLC0415 - slow to load

        panels = comparison_figure(
            clouds[0].points,
            clouds[1].points,
            matches,
            correct=correct,
            masks={result.method: result.grouping.mask for result in results},
            T_target_source=true_pose,
            title=f"{title}: {_count_correct(len(correct), int(correct.sum()))}",
        )
        with outputs.writing(run) as written:
            write_table(rows, results)
            write_figure(panels_file, panels)
            io.write_correspondences(matches_file, matches)
            for file in pages:
                from cgroup.pages import comparison_page, write_page  # noqa: PLC0415 - slow to load

                page = comparison_page(*clouds, matches, results, true_pose, correct=correct, title=title)
                write_page(file, page)
    described = _describe(matches, correct, true_pose, results)
    described["limits"] = {"max_rotation_deg": MAX_ROTATION, "max_displacement_pr": MAX_DISPLACEMENT}
    return {"inputs": describe_pair(files, clouds), "results": described, "files": written}


def _describe(
    matches: Correspondences, correct: BoolArray, true_pose: FloatArray, results: Sequence[MethodResult]
) -> Document:
    pr = matches.resolution or np.nan
    methods = [
        {**row, "displacement_pr": result.displacement / pr, "T_target_source": result.T_target_source}
        for row, result in zip(table(results), results, strict=True)
    ]
    return {
        "resolution": pr,
        "matches": len(correct),
        "correct": int(np.count_nonzero(correct)),
        "correct_under_inverse": _count_under_inverse(matches, correct, true_pose),
        "T_target_source": true_pose,
        "methods": methods,
    }


def _count_under_inverse(matches: Correspondences, correct: BoolArray, true_pose: FloatArray) -> int | None:
    """Count matches that are correct under the inverse of the truth; None unless suspiciously many."""
    suspicious = 10 * max(int(correct.sum()), 1)
    if len(matches) <= suspicious:
        return None
    count = int(find_correct(matches, invert(true_pose)).sum())
    return count if count > suspicious else None
