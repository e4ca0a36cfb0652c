"""Saved runs side by side: their options, their results, and by how much their poses differ."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup.cli.show.json import Document
from cgroup.cli.show.numbers import UNKNOWN, show_date, show_value
from cgroup.cli.show.tables import Column, print_table
from cgroup.cli.show.terminal import print_prose, print_text
from cgroup.errors import InputError
from cgroup.registry import label_of
from cgroup.rigid import apply, check_rigid, rotation_error

if TYPE_CHECKING:
    from collections.abc import Sequence

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


def compare_runs(names: Sequence[str], documents: Sequence[Document]) -> Document:
    """Put runs of one kind side by side: where they differ, and lists of results with one item per run."""
    kinds = [_KINDS.get(document["command"], "other") for document in documents]
    if len(set(kinds)) > 1 or kinds[0] == "other":
        pairs = zip(names, documents, strict=True)
        commands = ", ".join(f"{name} of {document['command']}" for name, document in pairs)
        message = f"{commands}: give runs of the same command"
        raise InputError(message)
    runs = [
        {
            "name": name,
            "command": document["command"],
            "cgroup_version": document["cgroup_version"],
            **document["saved"],
        }
        for name, document in zip(names, documents, strict=True)
    ]
    compared: Document = {
        "kind": kinds[0],
        "runs": runs,
        "differing_options": _find_differing([document["options"] for document in documents]),
        "differing_inputs": _find_differing([_digests(document) for document in documents]),
    }
    found = [document["results"] for document in documents]
    if kinds[0] == "methods":
        return {**compared, "methods": _collect_methods(found)}
    results = {name: [one[name] for one in found] for name in _QUANTITIES[kinds[0]]}
    seconds = [one["seconds"] for one in found]
    results["seconds"] = [float(sum(one.values()) if isinstance(one, dict) else one) for one in seconds]
    return {**compared, "results": {**results, **_pose_differences(documents)}}


def print_differences(document: Document, *, wide: bool) -> None:
    """Print runs side by side, from their document."""
    compared = document["results"]
    _print_runs(compared, wide=wide)
    if compared["differing_inputs"]:
        print_prose(f"Note: not the same in all of them: {', '.join(compared['differing_inputs'])}.")
    print_text("")
    if compared["kind"] == "methods":
        _print_methods(compared, wide=wide)
        return
    runs = [Column(run["name"], priority=place) for place, run in enumerate(compared["runs"])]
    columns = [Column("", is_text=True), *runs]
    rows = [
        [str(_NAMES.get(name, name)), *map(show_value, values)]
        for name, values in compared["results"].items()
    ]
    print_table(columns, rows, wide=wide)


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
            show_date(run["date"]),
            run["cgroup_version"],
            *(show_value(values[place]) for values in options.values()),
        ]
        for place, run in enumerate(compared["runs"])
    ]
    print_table(columns, rows, wide=wide)


def _print_methods(compared: Document, *, wide: bool) -> None:
    runs = range(len(compared["runs"]))
    is_pair = len(runs) == 2
    columns, change = [Column("method", is_text=True)], [Column("change")] if is_pair else []
    for title, name, priority, _ in _SCORES:
        columns += [Column(f"{title} {run + 1}", priority=priority) for run in runs]
        columns += change if name == "f_score" else []
    rows: list[list[str]] = []
    for method in compared["methods"]:
        row = [label_of(method["method"])]
        for _, name, _, form in _SCORES:
            row += [show_value(value, form) for value in method[name]]
            row += [_show_change(*method[name])] if is_pair and name == "f_score" else []
        rows.append(row)
    print_table(columns, rows, wide=wide)
    print_prose("P, R, F: precision, recall, their harmonic mean; reg.: registered; off: of the pose.")


def _find_differing(options: Sequence[dict[str, Any]]) -> dict[str, list[Any]]:
    """Return what all have and isn't the same, with the values of each."""
    names = [name for name in options[0] if all(name in one for one in options)]
    values = {name: [one[name] for one in options] for name in names}
    return {name: found for name, found in values.items() if any(value != found[0] for value in found)}


def _digests(document: Document) -> dict[str, str]:
    return {one["role"]: one["sha256"] or one["file"] for one in document["inputs"]}


def _collect_methods(found: Sequence[Document]) -> list[dict[str, Any]]:
    by_name = [{row["method"]: row for row in one["methods"]} for one in found]
    names = dict.fromkeys(name for rows in by_name for name in rows)

    def collect(name: str, score: str) -> list[Any]:
        return [rows.get(name, {}).get(score) for rows in by_name]

    return [{"method": name, **{score: collect(name, score) for _, score, _, _ in _SCORES}} for name in names]


def _pose_differences(documents: Sequence[Document]) -> dict[str, list[float | None]]:
    """Measure how far each pose is from the first: the turn, and the way of the source's centre."""
    poses = [document["results"]["T_target_source"] for document in documents]
    matrices = [None if pose is None else check_rigid(pose) for pose in poses]
    center = np.asarray(documents[0]["inputs"][0]["centroid"], dtype=np.float64).reshape(1, 3)
    first = matrices[0]
    known = [None if first is None or pose is None else (pose, first) for pose in matrices]
    ways = [None if pair is None else apply(pair[0], center) - apply(pair[1], center) for pair in known]
    return {
        "rotated_deg": [None if pair is None else rotation_error(*pair) for pair in known],
        "displaced": [None if way is None else float(np.linalg.norm(way)) for way in ways],
    }


def _show_change(before: float | None, after: float | None) -> str:
    return UNKNOWN if before is None or after is None else f"{after - before:+.3f}"
