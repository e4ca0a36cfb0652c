"""``cgroup apply``: move original files by a pose."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cgroup import io
from cgroup.cli.command import command, make_app
from cgroup.cli.documents import Document
from cgroup.cli.files import unique_names
from cgroup.cli.options import OUT, OUTPUT, argument, option
from cgroup.cli.terminal import print_facts, print_files, show_stages
from cgroup.errors import InputError
from cgroup.io.clouds import find_clouds
from cgroup.io.files import check_outputs, load_text
from cgroup.io.moved import find_mover
from cgroup.io.result_folders import Results
from cgroup.io.scan_names import find_names
from cgroup.types import FloatArray

app = make_app()


def _print_moved(document: Document) -> None:
    done = document["results"]
    print_facts(*((moved["name"], note) for moved in done["moved"] for note in moved["notes"]))
    if done["left_out"]:
        print_facts(("left out", f"{', '.join(done['left_out'])}: without a pose in the scene"))
    print_files(document)


@command(
    app,
    "apply",
    "cgroup apply out/source_on_target.txt source.laz --out moved",
    "",
    "# all scans of a scene, by the poses of cgroup merge",
    "cgroup apply scene scans/*.e57 --out moved",
    show=_print_moved,
)
def apply_command(
    pose: Path = argument("POSE", "File of a pose, or the folder of a cgroup merge."),
    files: list[Path] = argument(
        "FILE", "LAS, LAZ, PLY, PCD, E57, PTX, OBJ, STL, GLTF, GLB, BIN, XYZ, ASC, TXT, CSV, PTS."
    ),
    *,
    scale: float = option(1.0, "FACTOR", "Scale the files first.", OUTPUT),
    out: Path = OUT,
) -> Document:
    """Move original files at full resolution, with all attributes.

    Writes each file under its name into the folder. Exit status 3 if the scene has no pose of a file.
    """
    files = find_clouds("FILE", files)
    poses = _poses_of(pose, files)
    moved = [row for row, matrix in enumerate(poses) if matrix is not None]
    outputs = [out / name for name in output_names(files)]
    for file in files:
        find_mover(file)
    check_outputs(outputs, [*files, pose])
    results = Results(out, f"apply {pose}")
    results.check(outputs, files)
    notes: dict[int, list[str]] = {}
    with show_stages(piped=True) as begin, results.writing() as written:
        for row in moved:
            begin(f"moving {files[row].name}")
            notes[row] = io.transform_file(files[row], poses[row], outputs[row], scale=scale)  # pyright: ignore[reportArgumentType]
    left_out = [files[row].name for row in range(len(files)) if row not in notes]
    entries = [
        {"name": files[row].name, "file": outputs[row], "T_moved_file": poses[row], "notes": notes[row]}
        for row in moved
    ]
    parts: Document = {
        "inputs": [{"role": "file", "file": file} for file in files],
        "results": {"moved": entries, "left_out": left_out},
        "files": written,
    }
    if left_out:
        parts["refusal"] = f"{len(left_out)} of {len(files)} files left out: the scene has no pose of them"
    return parts


def output_names(files: Sequence[Path]) -> list[str]:
    """Return different names for files: with that of the folder if a name occurs twice."""
    names = [file.name for file in files]
    full = [
        name if names.count(name) == 1 else f"{file.absolute().parent.name}_{name}"
        for name, file in zip(names, files, strict=True)
    ]
    again = next((name for name in full if full.count(name) > 1), None)
    if again is not None:
        raise InputError("FILE", again, "several files would have this name; move them one by one")
    return full


def _poses_of(pose: Path, files: Sequence[Path]) -> list[FloatArray | None]:
    """Return the pose of each file; None for scans that a scene left out."""
    if not pose.is_dir():
        return [io.read_transform(pose)] * len(files)
    lists = sorted(file for file in pose.glob("poses*.tum") if re.fullmatch(r"poses(_\d+)?\.tum", file.name))
    if not lists:
        raise InputError(
            "POSE", str(pose), "a folder without poses.tum; give that of cgroup merge, or a file"
        )
    by_name: dict[str, FloatArray] = {}
    known: set[str] = set()
    for file in lists:
        names, rows = find_names(load_text(file).splitlines())
        matrices = io.read_transforms(file)
        if len(rows) != len(matrices):
            raise InputError(f"{file}: {len(matrices)} poses of {len(rows)} scans")
        by_name |= {names[row]: np.asarray(one) for row, one in zip(rows, matrices, strict=True)}
        known |= {*names.values()}
    given = unique_names(files, [file.name for file in files])
    wanted = [str(file) if str(file) in known else name for file, name in zip(files, given, strict=True)]
    wanted = [name if name in known else file.name for name, file in zip(wanted, files, strict=True)]
    for name in wanted:
        if name not in known:
            raise InputError(
                "FILE", name, f"{pose} has no scan of this name; it has {', '.join(sorted(known))}"
            )
    return [by_name.get(name) for name in wanted]
