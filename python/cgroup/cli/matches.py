"""``cgroup group``: grouping of correspondences from a file."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from cgroup import io
from cgroup.cli.options import MethodOption
from cgroup.cli.terminal import print_line, print_pose, show_stages
from cgroup.errors import NoConsensusError
from cgroup.evaluation import match_errors
from cgroup.group import check_method, group
from cgroup.io._results import check_file
from cgroup.registry import label_of
from cgroup.types import OPTIONAL_FIELDS, Correspondences

if TYPE_CHECKING:
    from cgroup.types import Grouping

app = typer.Typer()


@app.command("group")
def group_command(
    correspondences: Annotated[
        Path, typer.Argument(help="NPZ with the fields of Correspondences, or text: x y z x' y' z' per line.")
    ],
    method: MethodOption = "gtm",
    resolution: Annotated[
        float | None,
        typer.Option(
            help="Mean point spacing of the clouds, in the file's unit.", show_default="as in the file"
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Tolerance of methods that have one, in the file's unit.", show_default="the method's"
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Mask to write: .npy, or text with 0 or 1 per line.", show_default="NAME_METHOD.npy"
        ),
    ] = None,
) -> None:
    """Group correspondences of your own: which of them are selected, and the pose they fix."""
    method = check_method(method)
    path = Path(f"{correspondences.stem}_{method}.npy") if out is None else out
    check_file(path)
    given = io.read_correspondences(correspondences)
    if resolution is not None:
        given = _with_resolution(given, resolution)
    options: dict[str, Any] = {} if tolerance is None else {"tolerance": tolerance}
    start = time.perf_counter()
    with show_stages() as begin:
        begin(f"grouping by {label_of(method)}")
        grouping = group(given, method, **options)
    seconds = time.perf_counter() - start
    io.write_mask(path, grouping.mask)
    print_line(f"{grouping.size} of {len(given)} selected by {label_of(method)} in {1e3 * seconds:.0f} ms")
    if grouping.false_alarms is not None:
        trust = "can be trusted" if grouping.ok else "may be chance"
        print_line(f"the group {trust}: {grouping.false_alarms:.2g} false alarms expected")
    _print_pose(given, grouping)
    print_line(f"wrote {path}")


def _print_pose(matches: Correspondences, grouping: Grouping) -> None:
    """Print the least-squares pose of the group, and how closely the group follows it."""
    try:
        pose = grouping.transform()
    except NoConsensusError as error:
        print_line(f"no pose: {error}")
        return
    print_pose(pose)
    residuals = match_errors(matches.source[grouping.mask], matches.target[grouping.mask], pose)
    half, most = np.quantile(residuals, [0.5, 0.9])
    pr = matches.resolution
    unit = "" if pr is None else f" ({half / pr:.2g} and {most / pr:.2g} pr)"
    print_line(f"residuals of the group: half below {half:.3g}, nine in ten below {most:.3g}{unit}")


def _with_resolution(correspondences: Correspondences, resolution: float) -> Correspondences:
    fields = {name: getattr(correspondences, name) for name in OPTIONAL_FIELDS}
    fields["resolution"] = resolution
    return Correspondences(correspondences.source, correspondences.target, **fields)
