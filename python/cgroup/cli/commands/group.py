"""``cgroup group``: group the correspondences of a file."""

import time
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import typer

from cgroup import io
from cgroup._checks.values import as_length
from cgroup.cli import options
from cgroup.cli.command import command, identify_run
from cgroup.cli.documents import Document, fields
from cgroup.cli.files import extent_of, name_frames, name_of_pair, refuse_others, write_pose
from cgroup.cli.options import GROUPING, METHOD_NAMES, argument, flag, option
from cgroup.cli.targets import SIGMA, TARGETS, fit_files, print_targets, refuse_targets, report_files
from cgroup.cli.terminal import print_facts, print_files, print_line, print_pose, show_stages
from cgroup.errors import InputError, NoConsensusError
from cgroup.evaluation import match_errors
from cgroup.group import check_method, group
from cgroup.io.result_folders import Results
from cgroup.registry import METHODS, label_of
from cgroup.types import Correspondences, FloatArray, Grouping

_PARTS = ("mask", "transform", "residuals")


def _read_tolerance(text: str | None) -> float | str | None:
    try:
        return text if text in (None, "auto") else float(text)
    except ValueError:
        raise InputError("--tolerance", text, "give a length, or auto") from None


def _print_group(document: Document) -> None:
    if document["options"]["targets"] is not None:
        print_targets(document["results"])
        print_pose(document["results"]["T_target_source"], document["inputs"][0])
        print_files(document)
        return
    found, method = document["results"], document["options"]["method"]
    matches, pr = document["inputs"][0]["matches"], document["options"]["resolution"]
    label = label_of(method)
    print_line(f"{found['selected']} of {matches} selected by {label} in {1e3 * found['seconds']:.0f} ms")
    if found["T_target_source"] is None:
        print_facts(("no pose", found["why_no_pose"]))
    else:
        print_pose(found["T_target_source"], document["inputs"][0])
        print_facts(
            ("residuals", f"root mean square {_length(found['residual_rms'], pr)}"),
            ("", f"largest {_length(found['residual_max'], pr)}"),
        )
    print_facts(("reliable", _reliability(found, label)))
    if not found["complete"]:
        print_facts(("note", "the search stopped at a limit of the method; a better group may exist"))
    print_files(document)


@command(
    "group",
    "# six columns, x y z of the source and of the target",
    "cgroup group matches.txt",
    "",
    "cgroup group matches.npz --method SC2-PCR --tolerance 0.1 --json --out narrow",
    "# of unknown unit: the tolerance is estimated by lc",
    "cgroup group matches.txt --method ransac --tolerance auto",
    "# surveyed targets: name, x, y, z per line",
    "cgroup group --targets scan.csv site.csv --html",
    show=_print_group,
)
def group_command(
    context: typer.Context,
    correspondences: Path | None = argument(
        "MATCHES",
        "Six columns, x y z x' y' z', of text, CSV or NPY; or NPZ with the fields of Correspondences.",
        None,
    ),
    *,
    method: str = option(
        "NAME",
        f"Grouping method: {METHOD_NAMES}.",
        GROUPING,
        default="lc",
        autocompletion=options.complete_methods,
    ),
    resolution: float | None = option(
        "LENGTH", "Mean point spacing of the clouds, 1 pr, in the file's unit.", GROUPING, "as in the file"
    ),
    tolerance: Any = option(
        "LENGTH|auto",
        "Tolerance of the method, in the file's unit; auto: estimated by lc.",
        GROUPING,
        "the method's",
        parser=str,
        callback=_read_tolerance,
    ),
    targets: tuple[Path, Path] | None = TARGETS,
    sigma: float | None = SIGMA,
    out: Path = options.OUT,
    html: bool = flag("--html", "Write the report of the targets as a page too."),
) -> Document:
    """Group your own matches: the selected ones, their pose, and how reliable it is.

    With --targets in place of MATCHES: the pose of surveyed targets, and the residual of each.

    Writes NAME_METHOD_mask.txt with 1 or 0 per match, the pose, NAME_METHOD_transform.txt, and the residual
    of each match, NAME_METHOD_residuals.txt. Exit status 3 means that the group may be due to chance; the
    files are written all the same.
    """
    if targets is not None and correspondences is None:
        return _fit(context, targets, sigma, out, html=html)
    if targets is not None or correspondences is None:
        message = "group: give either MATCHES, or --targets SOURCE TARGET"
        raise InputError(message)
    method = check_method(method)
    method_options = _method_options(method, tolerance)
    spacing = None if resolution is None else as_length("resolution", resolution)
    given = io.read_correspondences(correspondences)
    if spacing is not None:
        given = replace(given, resolution=spacing)
    elif given.resolution is not None:
        as_length(f"{correspondences}: resolution", given.resolution)
    files = [out / f"{correspondences.stem}_{method}_{part}.txt" for part in _PARTS]
    outputs = Results(out, f"group {correspondences.stem}_{method}")
    outputs.check(files)
    start = time.perf_counter()
    with show_stages() as begin:
        begin(f"grouping by {label_of(method)}")
        grouping = group(given, method, **method_options)
    seconds = time.perf_counter() - start
    results = _results(given, grouping)
    with outputs.writing() as written:
        _write_files(files, given, grouping, results["T_target_source"])
    matches = {
        "role": "matches",
        "file": correspondences,
        "matches": len(given),
        "centroid": given.source.mean(axis=0, dtype=np.float64) if len(given) else None,
        "extent": extent_of(given.source) if len(given) else None,
    }
    chosen = {"method": method, "resolution": given.resolution}
    parts: Document = {"inputs": [matches], "options": chosen, "results": {**results, "seconds": seconds}}
    return {**parts, "files": written, "refusal": _refuse(results)}


def _fit(
    context: typer.Context, files: tuple[Path, Path], sigma: float | None, out: Path, *, html: bool
) -> Document:
    """Fit surveyed targets, and write the pose and the report."""
    inputs, found = fit_files(files, sigma)
    name = name_of_pair(*files)
    report = {out / f"{name}{end}": content for end, content in report_files(found, name, html=html).items()}
    outputs, pose = Results(out, f"group {name}"), out / f"{name}.txt"
    refuse_others([pose], name_frames(*files))
    outputs.check([pose, *report])
    with outputs.writing(identify_run(context)) as written:
        write_pose(pose, found["T_target_source"], name_frames(*files))
        for file, content in report.items():
            io.write_file(file, content)
    return {"inputs": inputs, "results": found, "files": written, "refusal": refuse_targets(found)}


def _write_files(
    files: list[Path], matches: Correspondences, grouping: Grouping, pose: FloatArray | None
) -> None:
    mask, transform, residuals = files
    io.write_mask(mask, grouping.mask)
    if pose is not None:
        io.write_transform(transform, pose)
        lines = (f"{error!r}\n" for error in match_errors(matches.source, matches.target, pose).tolist())
        io.write_file(residuals, "".join(lines).encode())


def _refuse(found: Document) -> str | None:
    """Return the reason why a group is unreliable; None if it is reliable or not judged."""
    chance = f"this group may be due to chance: {_count_by_chance(found['false_alarms'])}"
    return (found["why_no_pose"] or chance) if found["ok"] is False else None


def _method_options(method: str, tolerance: float | str | None) -> dict[str, Any]:
    """Return the given options of the method; raise `InputError` if it lacks one."""
    if tolerance is None:
        return {}
    having = [name for name, function in METHODS.items() if "tolerance" in signature(function).parameters]
    having.remove("gtm")  # its tolerance belongs to an option that the command line lacks
    if method not in having:
        message = f"--tolerance: {method} has none; methods that have one: {', '.join(having)}"
        raise InputError(message)
    return {"tolerance": tolerance}


def _results(matches: Correspondences, grouping: Grouping) -> Document:
    results: Document = {
        "selected": grouping.size,
        **fields(grouping, "indices", "threshold", "complete", "ok", "false_alarms", "noise"),
        **dict.fromkeys(("T_target_source", "residual_rms", "residual_max", "why_no_pose")),
    }
    try:
        pose = grouping.transform()
    except NoConsensusError as error:
        return {**results, "why_no_pose": str(error)}
    residuals = match_errors(matches.source[grouping.mask], matches.target[grouping.mask], pose)
    rms, largest = float(np.sqrt(np.mean(residuals**2))), float(residuals.max())
    return {**results, "T_target_source": pose, "residual_rms": rms, "residual_max": largest}


def _length(value: float, pr: float | None) -> str:
    if pr is None:
        return f"{value:.3g} (in the file's unit)"
    return f"{value:.3g} ({float(f'{value / pr:.2g}'):g} pr)"  # 170, not 1.7e+02


def _reliability(found: Document, label: str) -> str:
    if found["ok"] is None:
        return f"unknown: {label} has no estimate; --method lc has"
    return f"{'yes' if found['ok'] else 'no'}: {_count_by_chance(found['false_alarms'])}"


def _count_by_chance(expected: float | None) -> str:
    """Return the expected number of groups as good by chance; infinite if a mirror image fits better."""
    by_chance = "countless" if expected is None or not np.isfinite(expected) else f"{expected:.2g}"
    return f"{by_chance} groups as good are expected from wrong matches alone"
