"""``cgroup compare`` and ``demo``: run all methods on a pair of known pose."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import typer

from cgroup import comparison, io
from cgroup.cli import options, terminal
from cgroup.cli.command import command, identify_run
from cgroup.cli.documents import Document
from cgroup.cli.files import PairFiles, describe_pair, name_of_pair, read_both
from cgroup.cli.options import FRONT, TRUTH, option
from cgroup.cli.registration_facts import placement_facts, registration_results
from cgroup.comparison import MethodResult, compare, find_correct, table, write_table
from cgroup.evaluation.ground_truth import CORRECT_WITHIN
from cgroup.io.result_folders import Results
from cgroup.registration import correspond, register
from cgroup.registry import label_of
from cgroup.rigid import invert
from cgroup.types import BoolArray, Correspondences, FloatArray, PointCloud

_HEAD = (
    *("method", "selected", "precision", "recall", "F", "P > 0.1", "registered", "rot deg", "off pr", "ms"),
)


def _print_comparison(document: Document, *, wide: bool) -> None:
    results = document["results"]
    limits = results["limits"]
    terminal.print_clouds(document["inputs"])
    counted = _count_correct(results["matches"], results["correct"])
    pr = terminal.show_value(results["resolution"], ".4g")
    terminal.print_facts(
        ("resolution", f"{pr} (mean point spacing, in the files' unit; 1 pr)"),
        ("matching", f"{counted}: within {CORRECT_WITHIN:g} pr of the true place"),
    )
    rows = sorted(results["methods"], key=lambda row: (-row["f_score"], row["milliseconds"]))
    terminal.print_table(_HEAD, map(_cells, rows), drop=(5, 7, 1), wide=wide)
    terminal.print_prose(
        f"Registered: the errors of the group's pose are at most {limits['max_rotation_deg']:g} degrees and "
        f"{limits['max_displacement_pr']:g} pr, the latter as mean displacement of the matched points. "
        "P > 0.1: the paper's criterion, which needs no pose."
    )
    if results["correct_under_inverse"]:
        terminal.print_prose(
            f"Note: {results['correct_under_inverse']} matches would be correct under the inverse of this "
            "truth; the truth must map the source into the target's frame."
        )
    if "registration" in results:
        terminal.print_line("")
        terminal.print_line("Result of cgroup register, which verifies poses on the surfaces:")
        terminal.print_facts(*placement_facts(results["registration"], document["inputs"][0]["centroid"]))
    terminal.print_files(document)


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    posed, duration = row["T_target_source"] is not None, row["milliseconds"]
    return (
        label_of(row["method"]),
        str(row["selected"]),
        *(f"{row[name]:.3f}" for name in ("precision", "recall", "f_score")),
        *(terminal.show_value(row[name]) for name in ("precision_above_0.1", "registered")),
        *(f"{row[name]:.2f}" if posed else "no pose" for name in ("rotation_error_deg", "displacement_pr")),
        f"{duration:.1f}" if duration < 100 else f"{duration:.0f}",
    )


def _count_correct(matches: int, correct: int) -> str:
    return f"{matches} matches, {correct} correct ({100 * correct / max(matches, 1):.1f} %)"


@command(
    "compare",
    "cgroup compare source.ply target.ply --truth pose.txt",
    "# other descriptors",
    "cgroup compare a.ply b.ply --truth pose.txt --descriptor rcs --out rcs",
    show=_print_comparison,
    takes=[name for name in FRONT if name != "resolution"],
)
def compare_command(
    context: typer.Context,
    source: Path = options.SOURCE,
    target: Path = options.TARGET,
    *,
    truth: Path = option("POSE", "File of the true pose of the source in the target.", TRUTH, default=...),
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
        title=f"{terminal.shown_name(source)} to {terminal.shown_name(target)}",
        folder=out,
        run=identify_run(context),
        html=html,
        **front_end,
    )


@command(
    "demo",
    "cgroup demo",
    "cgroup demo --seed 3 --out third --wide",
    "cgroup compare out/source.ply out/target.ply --truth out/truth.txt",
    show=_print_comparison,
)
def demo_command(
    context: typer.Context,
    *,
    seed: int = option("NUMBER", "Seed of the shape.", "Shape", default=0, min=0),
    out: Path = options.OUT,
    html: bool = options.HTML,
) -> Document:
    """Run all methods on a generated pair, and register it.

    Writes the two scans, their true pose, and the files of `cgroup compare` and `cgroup register`.
    """
    from cgroup.datasets import standin_pair  # noqa: PLC0415 - slow to load

    with terminal.show_stages() as begin:
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
    with terminal.show_stages() as begin:
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
    name, endings = name_of_pair(*files), ("csv", "png", "npz", *(["html"] if html else []))
    rows, panels_file, matches_file, *pages = (folder / f"{name}_comparison.{end}" for end in endings)
    outputs = Results(folder, f"compare {name}")
    outputs.check([rows, panels_file, matches_file, *pages])
    with terminal.show_stages() as begin:
        matches = correspond(*clouds, progress=begin, **front_end)
        correct = find_correct(matches, true_pose)

        def report(method: str) -> None:
            begin(f"grouping by {label_of(method)}")

        results = [*compare(matches, true_pose, correct=correct, progress=report)]
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
            terminal.write_figure(panels_file, panels)
            io.write_correspondences(matches_file, matches)
            for file in pages:
                from cgroup.pages import comparison_page, write_page  # noqa: PLC0415 - slow to load

                page = comparison_page(*clouds, matches, results, true_pose, correct=correct, title=title)
                write_page(file, page)
    described = _describe(matches, correct, true_pose, results)
    described["limits"] = {
        "max_rotation_deg": comparison.MAX_ROTATION,
        "max_displacement_pr": comparison.MAX_DISPLACEMENT,
    }
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
