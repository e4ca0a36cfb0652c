"""``cgroup apply``: move original files by a pose."""

from collections.abc import Sequence
from pathlib import Path

from cgroup import io
from cgroup.cli.command import command
from cgroup.cli.documents import Document
from cgroup.cli.files import name_moved
from cgroup.cli.options import OUT, OUTPUT, argument, option
from cgroup.cli.terminal import print_facts, print_files, show_stages
from cgroup.errors import InputError
from cgroup.io.clouds import find_clouds
from cgroup.io.files import load_text
from cgroup.io.result_folders import Results
from cgroup.io.scan_names import find_names
from cgroup.types import FloatArray


def _print_moved(document: Document) -> None:
    done = document["results"]
    print_facts(*((one["name"], note) for one in done["moved"] for note in one["notes"]))
    if done["left_out"]:
        print_facts(("left out", f"{', '.join(done['left_out'])}: without a pose in the scene"))
    print_files(document)


@command(
    "apply",
    "cgroup apply out/source_on_target.txt source.laz --out moved",
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
    scale: float = option("FACTOR", "Scale the files first.", OUTPUT, default=1.0),
    out: Path = OUT,
) -> Document:
    """Move original files at full resolution, with all attributes.

    Writes each file under its name into the folder. Exit status 3 if the scene has no pose of a file.
    """
    files = find_clouds("FILE", files)
    poses = _poses_of(pose, files)
    names = name_moved(files)
    results = Results(out, f"apply {' '.join(names)}")
    results.check([out / name for name in names], [*files, pose])
    moved: list[Document] = []
    with show_stages(piped=True) as begin, results.writing() as written:
        for file, name, matrix in zip(files, names, poses, strict=True):
            if matrix is not None:
                begin(f"moving {file.name}")
                notes = io.transform_file(file, matrix, out / name, scale=scale)
                moved += [{"name": file.name, "file": out / name, "T_moved_file": matrix, "notes": notes}]
    left_out = [file.name for file, matrix in zip(files, poses, strict=True) if matrix is None]
    parts: Document = {
        "inputs": [{"role": "file", "file": file} for file in files],
        "results": {"moved": moved, "left_out": left_out},
        "files": written,
    }
    if left_out:
        parts["refusal"] = f"{len(left_out)} of {len(files)} files left out: the scene has no pose of them"
    return parts


def _poses_of(pose: Path, files: Sequence[Path]) -> list[FloatArray | None]:
    """Return the pose of each file; None for scans that a scene left out."""
    if not pose.is_dir():
        return [io.read_transform(pose)] * len(files)
    if not (pose / "poses.tum").exists():
        raise InputError(
            "POSE", f"{pose}", "a folder without poses.tum; give that of cgroup merge, or a file"
        )
    known: dict[str, FloatArray | None] = {}
    for file in (pose / "poses.tum", *pose.glob("poses_[0-9]*.tum")):
        (names, rows), poses = find_names(load_text(file).splitlines()), io.read_transforms(file)
        if len(rows) != len(poses):
            raise InputError(f"{file}: {len(poses)} poses of {len(rows)} scans")
        known = dict.fromkeys(names.values()) | known
        known |= {names[row]: one for row, one in zip(rows, poses, strict=True)}
    wanted = [str(file) if str(file) in known else file.name for file in files]
    if missing := [name for name in wanted if name not in known]:
        shown = ", ".join(sorted(known))
        raise InputError("FILE", missing[0], f"{pose} has no scan of this name; it has {shown}")
    return [known[name] for name in wanted]
