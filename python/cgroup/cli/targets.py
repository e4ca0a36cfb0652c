"""Surveyed targets on the command line: their pose, and the report of each target."""

import csv
from html import escape
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from cgroup import io
from cgroup.cli import options
from cgroup.cli.documents import Document, fields
from cgroup.cli.files import extent_of
from cgroup.cli.options import option
from cgroup.cli.terminal import print_facts, print_table, show_length
from cgroup.rigid import apply
from cgroup.rigid.se3 import deviations_at
from cgroup.targets import fit_targets

TARGETS = option(
    "SOURCE TARGET", "Files of surveyed targets, name x y z per line, which give the pose.", options.TARGETS
)
SIGMA = option(
    "LENGTH", "Expected standard deviation of a coordinate of the residuals.", options.TARGETS, "estimated"
)
CSV, PAGE = "_targets.csv", "_targets.html"
_HEAD = ("target", "dx", "dy", "dz", "residual", "leave one out", "verdict")
_CSV_HEAD = (
    "name,source_x,source_y,source_z,target_x,target_y,target_z,dx,dy,dz,residual,leave_one_out,verdict"
)


def fit_files(files: tuple[Path, Path], sigma: float | None) -> tuple[list[Document], Document]:
    """Fit the targets of two files; return the inputs and the results of a document."""
    source, target = map(io.read_targets, files)
    fit = fit_targets(source, target, sigma=sigma)
    some = [np.array([*points.values()]) for points in (source, target)]
    inputs = [
        {
            "role": f"{role} targets",
            "file": file,
            "targets": len(points),
            "centroid": points.mean(axis=0),
            "extent": extent_of(points),
        }
        for role, file, points in zip(("source", "target"), files, some, strict=True)
    ]
    degrees, length = deviations_at(fit.covariance, apply(fit.pose, some[0].mean(axis=0)[None])[0])
    each = [
        {
            "name": name,
            "source": source.get(name),
            "target": target.get(name),
            "residual": fit.residuals[row],
            "distance": float(np.linalg.norm(fit.residuals[row])),
            "leave_one_out": float(fit.leave_one_out[row]),
            "verdict": "used" if fit.is_used[row] else "blunder" if fit.is_blunder[row] else "suspect",
        }
        for row, name in enumerate(fit.names)
    ]
    return inputs, {
        "ok": fit.ok,
        "T_target_source": fit.pose,
        "covariance": fit.covariance,
        "deviation_deg": degrees,
        "deviation": length,
        **fields(fit, "sigma", "redundancy"),
        "targets": each,
        "notes": fit.notes,
    }


def print_targets(found: Document) -> None:
    """Print the facts of a fit, and its targets."""
    print_facts(*_facts(found))
    print_table(_HEAD, _rows(found), words=(0, 6), wide=True)


def refuse_targets(found: Document) -> str | None:
    """Return why a fit is doubtful; None if it is not."""
    doubts = [note for note in found["notes"] if " is a blunder: " not in note]
    return None if found["ok"] else f"the pose of the targets is doubtful: {doubts[0]}"


def report_files(found: Document, title: str, *, html: bool) -> dict[str, bytes]:
    """Return the contents of the report, by the end of its file's name: CSV, and a page if requested."""
    text = StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(_CSV_HEAD.split(","))
    for one in found["targets"]:
        numbers = *one["source"], *one["target"], *one["residual"], one["distance"], one["leave_one_out"]
        rows.writerow([one["name"], *map(float, numbers), one["verdict"]])
    files = {CSV: text.getvalue().encode()}
    if html:
        from cgroup._show.words import pose_html  # noqa: PLC0415 - slow to load
        from cgroup.pages.page import facts_html, page_html, part, table_html  # noqa: PLC0415

        rows_of = ((name, "".join(f"<td>{escape(cell)}</td>" for cell in row)) for name, *row in _rows(found))
        lines = "".join(f'<tr><th scope="row">{escape(name)}</th>{cells}</tr>' for name, cells in rows_of)
        facts = [(name, escape(value)) for name, value in _facts(found)]
        facts.append(("pose", pose_html(found["T_target_source"])))
        table = table_html(_HEAD, lines, label="targets")
        body = f"<main><h1>Surveyed targets: {escape(title)}</h1>{facts_html(facts)}{table}</main>"
        files[PAGE] = page_html(title, body, css=part("viewer.css")).encode("utf-8", "replace")
    return files


def _facts(found: Document) -> list[tuple[str, str]]:
    used, sigma = sum(one["verdict"] == "used" for one in found["targets"]), show_length(found["sigma"])
    deviations = f"{found['deviation_deg']:.2g} degrees, {show_length(found['deviation'], 2)} at the middle"
    return [
        ("targets", f"{used} of {len(found['targets'])} used, redundancy {found['redundancy']}"),
        ("sigma", f"{sigma} per coordinate of the residuals, source and target together"),
        ("deviation", f"{deviations} (standard deviation of the pose)"),
        ("reliable", "yes" if found["ok"] else "no"),
        *(("note", note) for note in found["notes"]),
    ]


def _rows(found: Document) -> list[tuple[str, ...]]:
    def show(value: Any) -> str:
        return show_length(None if value is None or np.isnan(value) else value)

    return [
        (one["name"], *map(show, (*one["residual"], one["distance"], one["leave_one_out"])), one["verdict"])
        for one in found["targets"]
    ]
