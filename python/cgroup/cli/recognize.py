"""``cgroup recognize``: which models are in a scan, and where."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table
from rich.text import Text

from cgroup import io
from cgroup._show import escape
from cgroup.cli.options import DEFAULT_OUT, OutOption
from cgroup.cli.terminal import print_cloud, print_facts, print_table, print_written, show_stages
from cgroup.errors import InputError, NoConsensusError
from cgroup.io._results import check_folder, make_folder
from cgroup.registration import recognize

if TYPE_CHECKING:
    from collections.abc import Callable

    from cgroup.registration import Recognized
    from cgroup.types import PointCloud

_FORMATS = "PLY, PCD, XYZ, TXT, CSV, PTS, OBJ, STL, OFF, KITTI's BIN, NPY, NPZ, LAS, LAZ"

app = typer.Typer()


@app.command("recognize")
def recognize_command(
    models: Annotated[
        list[Path],
        typer.Argument(help=f"Whole models, in the scene's unit; meshes are best: {_FORMATS}."),
    ],
    *,
    scene: Annotated[Path, typer.Option(help="What they are looked for in.")],
    voxel: Annotated[
        float | None,
        typer.Option(
            help="Edge length of the voxels, in the files' unit.", show_default="leaves about 10,000 voxels"
        ),
    ] = None,
    viewpoint: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y Z",
            help="Where the scanner stood, if the scene is one single scan: tells far more.",
            show_default="not known",
        ),
    ] = None,
    most: Annotated[
        int | None, typer.Option(min=1, help="Copies of each model to look for.", show_default="any number")
    ] = None,
    out: OutOption = DEFAULT_OUT,
) -> None:
    """Say which models are in a scene, and where (exit status 3 if none is).

    Writes the pose and the posed cloud of each model found: NAME.txt and NAME.ply; of further copies
    NAME-2.txt and so on.
    """
    files, folder = _by_name(models), check_folder(out)
    with show_stages() as begin:
        clouds = {name: _read(file, begin) for name, file in files.items()}
        target = _read(scene, begin)
        found = recognize(clouds, target, voxel=voxel, viewpoint=viewpoint, most=most, progress=begin)
    print_cloud("scene", scene, target)
    _print_models(list(clouds), found)
    if not found:
        hint = "" if viewpoint else "; if the scene is one single scan, say where the scanner stood"
        message = f"none of the models was found in {scene.name}{hint}"
        raise NoConsensusError(message)
    make_folder(folder)
    print_written(folder, *_write(folder, clouds, found))


def _by_name(models: list[Path]) -> dict[str, Path]:
    files = {file.stem: file for file in models}
    if len(files) < len(models):
        name = Counter(file.stem for file in models).most_common(1)[0][0]
        message = f"models: got two files named {name!r}; rename one"
        raise InputError(message)
    return files


def _read(file: Path, begin: Callable[[str], object]) -> PointCloud:
    begin(f"reading {file.name}")
    return io.read_cloud(file)


def _print_models(names: list[str], found: list[Recognized]) -> None:
    table = Table()
    for column in ("model", "found", "probability", "visible share", "residual"):
        table.add_column(column, justify="left" if column == "model" else "right")
    for name in names:
        copies = [registration for other, registration in found if other == name]
        if not copies:
            table.add_row(Text(escape(name)), "no", "", "", "")
        for number, copy in enumerate(copies, start=1):
            table.add_row(
                Text(escape(name)),
                "yes" if len(copies) == 1 else f"{number} of {len(copies)}",
                f"{copy.probability:.3f}",
                f"{100 * copy.fitness:.0f} %",
                f"{copy.inlier_rmse:.3g}",
            )
    print_table(table)
    if found:
        print_facts(("voxel", f"{found[0].registration.voxel:.4g} (in the files' unit, as the residual)"))
        seconds = found[0].registration.seconds
        print_facts(("time", f"{sum(seconds.values()):.2f} s"))


def _write(folder: Path, clouds: dict[str, PointCloud], found: list[Recognized]) -> list[str]:
    """Write poses and posed models; return the files' names."""
    written: list[str] = []
    copies: Counter[str] = Counter()
    for name, registration in found:
        copies[name] += 1
        stem = name if copies[name] == 1 else f"{name}-{copies[name]}"
        io.write_transform(folder / f"{stem}.txt", registration.T_target_source)
        io.write_cloud(folder / f"{stem}.ply", clouds[name].transformed(registration.T_target_source))
        written += [f"{stem}.txt", f"{stem}.ply"]
    return written
