"""``cgroup results``: list, show, compare and remove saved runs."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import typer

from cgroup.cli import options
from cgroup.cli.command import command, examples, make_app
from cgroup.cli.commands.compare import print_comparison
from cgroup.cli.commands.evaluate import print_evaluation
from cgroup.cli.commands.group import print_group
from cgroup.cli.commands.register import print_registration
from cgroup.cli.saved_runs import folder_of_runs, load_run, names_of_runs, remove_runs
from cgroup.cli.show.json import Document
from cgroup.cli.show.tables import UNKNOWN, Column, print_table, show_value
from cgroup.cli.show.terminal import print_facts, print_line, print_prose, print_text
from cgroup.errors import InputError
from cgroup.registry import label_of
from cgroup.rigid import apply, check_rigid, rotation_error

_COLUMNS = (
    Column("name", is_text=True),
    Column("command", is_text=True),
    Column("saved", is_text=True, priority=1),
    Column("inputs", is_text=True, priority=2),
    Column("result", is_text=True),
)
_KINDS = {"register": "registration", "group": "group", "compare": "methods", "demo": "methods"}
"""What each command's results are; only runs of a kind can be compared."""

_QUANTITIES = {
    "registration": ("probability", "fitness", "inlier_rmse", "matches", "selected", "voxel"),
    "group": ("selected", "residual_rms", "residual_max", "false_alarms"),
}
_SCORES = (
    ("F", "f_score", 0, ".3f"),
    ("P", "precision", 1, ".3f"),
    ("R", "recall", 1, ".3f"),
    ("reg.", "registered", 2, ""),
    ("off pr", "displacement_pr", 3, ".2f"),
    ("ms", "milliseconds", 4, ".1f"),
)
"""Title, key, priority of the columns, and form of the numbers."""

_NAMES = {
    "fitness": "overlap",
    "inlier_rmse": "residual",
    "residual_rms": "residual, rms",
    "residual_max": "residual, largest",
    "false_alarms": "false alarms",
    "rotated_deg": "turned from the first, degrees",
    "displaced": "moved from the first",
}

app = make_app(
    help="List, show and compare results that --save has kept.",
    epilog=examples(
        "cgroup register a.ply b.ply --save lc",
        "cgroup register a.ply b.ply --method gtm --save gtm",
        "cgroup results compare lc gtm",
    ),
)


@contextmanager
def _readable(name: str) -> Generator[None, None, None]:
    """Raise `InputError` for a file that is laid out as a saved run, but lacks what belongs into one."""
    try:
        yield
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, InputError):
            raise
        message = f"{name}: not as --save writes it ({type(error).__name__}: {error}); remove it"
        raise InputError(message) from error


# --- list ----------------------------------------------------------------------------------------


def _print_list(document: Document, *, wide: bool) -> None:
    runs, folder = document["results"]["runs"], document["results"]["folder"]
    if not runs:
        print_prose(f"no saved runs in {folder}; keep one: cgroup register SOURCE TARGET --save NAME")
        return
    rows = [
        (
            run["name"],
            run["command"] or UNKNOWN,
            _show_date(run["date"]),
            ", ".join(run["inputs"]) or UNKNOWN,
            run["result"] or f"can't be read: cgroup results show {run['name']}",
        )
        for run in runs
    ]
    print_table(_COLUMNS, rows, wide=wide)


@app.callback(invoke_without_command=True)
def _without_command(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        _print_list(list_command(), wide=False)


@command(app, "list", "cgroup results list", show=_print_list)
def list_command() -> Document:
    """List saved runs: in $CGROUP_RESULTS, or else the folder for data of the user."""
    return {"results": {"folder": folder_of_runs(), "runs": [_summary(name) for name in names_of_runs()]}}


def _summary(name: str) -> Document:
    """List what the table of saved runs shows of one; a file that can't be read is shown as such."""
    try:
        run = load_run(name)
        with _readable(name):
            return {
                "name": name,
                "command": run["command"],
                "date": run["saved"]["date"],
                "inputs": [Path(one["file"]).name for one in run["inputs"]],
                "result": _say_result(run),
                "error": None,
            }
    except InputError as error:
        unknown = {"command": None, "date": None, "inputs": [], "result": None}
        return {"name": name, **unknown, "error": str(error)}


def _say_result(run: Document) -> str:
    found = run["results"]
    if run["command"] == "register":
        return f"probability {found['probability']:.3f}, overlap {100 * found['fitness']:.0f} %"
    if run["command"] == "group":
        return f"{found['selected']} of {run['inputs'][0]['matches']} by {label_of(run['options']['method'])}"
    if run["command"] == "evaluate":
        shares = [(one["recalls"][found["main"]]["recall"], one["name"]) for one in found["methods"]]
        share, name = max(shares)
        return f"{found['protocol']}: {len(shares)} results, best recall {100 * share:.2f} % of {name}"
    best = max(found["methods"], key=lambda row: row["f_score"])
    registered = sum(row["registered"] for row in found["methods"])
    return f"{registered} of {len(found['methods'])} registered, best F {best['f_score']:.3f}"


def _show_date(date: str | None) -> str:
    """Return the day and the minute of a date in ISO's notation."""
    return UNKNOWN if date is None else date[:16].replace("T", " ")


# --- show ----------------------------------------------------------------------------------------


def _print_run(document: Document, *, run: str, wide: bool) -> None:
    with _readable(run):
        saved = document["saved"]
        print_facts(
            ("command", f"cgroup {document['command']}, version {document['cgroup_version']}"),
            ("saved", f"{saved['date']}, {saved['machine']}"),
        )
        if document["command"] == "register":
            print_registration(document)
        elif document["command"] == "group":
            print_group(document)
        elif document["command"] == "evaluate":
            print_evaluation(document, wide=wide)
        else:
            print_comparison(document, wide=wide)


@command(app, "show", "cgroup results show gtm", "cgroup results show gtm --json", show=_print_run)
def show_command(run: str = options.RUN) -> Document:
    """Show a saved run as it was shown when it ended."""
    return load_run(run)


# --- compare -------------------------------------------------------------------------------------


def _print_differences(document: Document, *, runs: list[str], wide: bool) -> None:
    with _readable(", ".join(runs)):
        compared = document["results"]
        _print_runs(compared, wide=wide)
        if compared["differing_inputs"]:
            print_prose(f"Note: not the same in all of them: {', '.join(compared['differing_inputs'])}.")
        print_text("")
        if compared["kind"] == "methods":
            _print_methods(compared, wide=wide)
            return
        columns = [Column(run["name"], priority=place) for place, run in enumerate(compared["runs"])]
        rows = [
            [str(_NAMES.get(name, name)), *map(show_value, values)]
            for name, values in compared["results"].items()
        ]
        print_table([Column("", is_text=True), *columns], rows, wide=wide)


def _print_runs(compared: Document, *, wide: bool) -> None:
    options = compared["differing_options"]
    columns = [
        Column("run"),
        Column("name", is_text=True),
        Column("saved", is_text=True, priority=2),
        Column("version", is_text=True, priority=3),
        *(Column(name.replace("_", "-"), is_text=True, priority=1) for name in options),
    ]
    rows = [
        [
            str(place + 1),
            run["name"],
            _show_date(run["date"]),
            run["cgroup_version"],
            *(show_value(values[place]) for values in options.values()),
        ]
        for place, run in enumerate(compared["runs"])
    ]
    print_table(columns, rows, wide=wide)


def _print_methods(compared: Document, *, wide: bool) -> None:
    runs = range(len(compared["runs"]))
    methods = compared["methods"]
    columns = [Column("method", is_text=True)]
    rows = [[label_of(method["method"])] for method in methods]
    for title, name, priority, form in _SCORES:
        columns += [Column(f"{title} {run + 1}", priority=priority) for run in runs]
        for row, method in zip(rows, methods, strict=True):
            row += [show_value(value, form) for value in method[name]]
        if name == "f_score" and len(runs) == 2:
            columns.append(Column("change"))
            for row, method in zip(rows, methods, strict=True):
                before, after = method[name]
                row.append(UNKNOWN if before is None or after is None else f"{after - before:+.3f}")
    print_table(columns, rows, wide=wide)
    print_prose("P, R, F: precision, recall, their harmonic mean; reg.: registered; off: of the pose.")


@command(
    app,
    "compare",
    "cgroup results compare shot rcs",
    "cgroup results compare before.json after.json --wide",
    show=_print_differences,
)
def compare_command(runs: list[str] = options.RUNS) -> Document:
    """Show saved runs of one command side by side: results, and by what the poses differ."""
    if len(runs) < 2:
        message = f"NAME: got {len(runs)} run; give two or more to be compared"
        raise InputError(message)
    documents = [load_run(run) for run in runs]
    with _readable(", ".join(runs)):
        return {"results": _compare_runs(runs, documents)}


def _compare_runs(names: Sequence[str], documents: Sequence[Document]) -> Document:
    """Put runs of one kind side by side: where they differ, and lists of results with one item per run."""
    kind, *others = [_KINDS.get(document["command"], "other") for document in documents]
    named = list(zip(names, documents, strict=True))
    if {*others} != {kind} or kind == "other":
        commands = ", ".join(f"{name} of {document['command']}" for name, document in named)
        several = "; give results to cgroup evaluate together" if kind == "other" else ""
        message = f"{commands}: give runs of the same command{several}"
        raise InputError(message)
    digests = [
        {one["role"]: one["sha256"] or one["file"] for one in document["inputs"]} for document in documents
    ]
    compared: Document = {
        "kind": kind,
        "runs": [
            {
                "name": name,
                "command": document["command"],
                "cgroup_version": document["cgroup_version"],
                **document["saved"],
            }
            for name, document in named
        ],
        "differing_options": _find_differing([document["options"] for document in documents]),
        "differing_inputs": _find_differing(digests),
    }
    found = [document["results"] for document in documents]
    if kind == "methods":
        return {**compared, "methods": _collect_methods(found)}
    results = {name: [one[name] for one in found] for name in _QUANTITIES[kind]}
    seconds = [one["seconds"] for one in found]
    results["seconds"] = [float(sum(one.values()) if isinstance(one, dict) else one) for one in seconds]
    return {**compared, "results": {**results, **_pose_differences(documents)}}


def _find_differing(options: Sequence[dict[str, Any]]) -> dict[str, list[Any]]:
    """Return what all have and isn't the same, with the values of each."""
    names = [name for name in options[0] if all(name in one for one in options)]
    values = {name: [one[name] for one in options] for name in names}
    return {name: found for name, found in values.items() if any(value != found[0] for value in found)}


def _collect_methods(found: Sequence[Document]) -> list[dict[str, Any]]:
    by_name = [{row["method"]: row for row in one["methods"]} for one in found]
    return [
        {
            "method": name,
            **{score: [rows.get(name, {}).get(score) for rows in by_name] for _, score, _, _ in _SCORES},
        }
        for name in dict.fromkeys(name for rows in by_name for name in rows)
    ]


def _pose_differences(documents: Sequence[Document]) -> dict[str, list[float | None]]:
    """Measure how far each pose is from the first: the turn, and the way of the source's centre."""
    poses = [document["results"]["T_target_source"] for document in documents]
    first, *_ = matrices = [None if pose is None else check_rigid(pose) for pose in poses]
    center = np.asarray(documents[0]["inputs"][0]["centroid"], dtype=np.float64).reshape(1, 3)
    turns: list[float | None] = []
    ways: list[float | None] = []
    for pose in matrices:
        if first is None or pose is None:
            turns.append(None)
            ways.append(None)
        else:
            turns.append(rotation_error(pose, first))
            ways.append(float(np.linalg.norm(apply(pose, center) - apply(first, center))))
    return {"rotated_deg": turns, "displaced": ways}


# --- remove --------------------------------------------------------------------------------------


def _print_removed(document: Document) -> None:
    print_line(f"removed {', '.join(document['files'])}")


@command(app, "remove", "cgroup results remove gtm lc", show=_print_removed)
def remove_command(runs: list[str] = options.RUNS) -> Document:
    """Delete saved runs."""
    return {"files": remove_runs(runs)}
