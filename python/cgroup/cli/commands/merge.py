"""``cgroup merge``: register many scans into one scene."""

from collections import Counter
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import typer

from cgroup._checks.quoting import escape
from cgroup._show.words import counted
from cgroup.cli import options, terminal
from cgroup.cli.command import command, identify_run
from cgroup.cli.documents import Document, fields
from cgroup.cli.errors import is_given
from cgroup.cli.files import find_source, name_moved, print_contents, unique_names
from cgroup.cli.options import FORMATS, GIVE_VIEWPOINT, SEARCH, option
from cgroup.cli.targets import fit_files, refuse_targets
from cgroup.errors import CgroupError, InputError
from cgroup.io.attributes import unkept_attributes
from cgroup.io.clouds import find_clouds
from cgroup.io.files import check_outputs, load_text
from cgroup.io.las import check_laspy, merge_files
from cgroup.io.moved import transform_file
from cgroup.io.result_folders import Results, make_folder
from cgroup.io.scan_names import find_names, names_file
from cgroup.io.transforms import read_transforms
from cgroup.registration import FalseAccepts
from cgroup.rigid import apply
from cgroup.rigid.se3 import deviations_at
from cgroup.scenes import Scene, false_joins, register_all
from cgroup.scenes.scene import cloud_of
from cgroup.types import FloatArray

_EDGES = ("source", "target", "probability", "residual", "kept", "reason")
_EDGE_KEYS = (  # of an edge in a document
    *("source", "target", "T_target_source", "probability", "covariance", "fitness", "target_fitness"),
    *("kept", "residual", "reason"),
)

_MOST_EDGES = 40  # edges that are printed: dropped ones first, then by residual
_POSES, _GRAPH, _MERGED, _PICTURE = "poses.tum", "graph.g2o", "merged.ply", "scene.png"
_FULL, _E57, _PAGE, _PAIRS, _MOVED = "merged.laz", "merged.e57", "scene.html", "pairs.sqlite", "moved"
_CONTENTS = {
    ".tum": "pose of each scan in the frame of its component's first scan",
    ".g2o": "kept edges",
    ".ply": "all scans as one reduced cloud",
    ".laz": "all points of the files, with their attributes",
    ".e57": "all points of the files, each file a scan with its pose",
    ".png": "picture",
    ".html": "interactive page",
    ".sqlite": "finished pairs, for another run",
    f"{_MOVED}/": "moved by the poses",
}


def _print_scene(document: Document, *, wide: bool) -> None:
    done, edges = document["results"], document["results"]["edges"]
    rows = [_row_of_scan(scan, done["components"]) for scan in done["scans"]]
    head = ("scan", "component", "probability", "sd deg", "sd length")
    terminal.print_table(head, rows, drop=(4, 3), wide=wide)
    terminal.print_line("")
    if edges:
        shown = sorted(edges, key=lambda edge: (edge["kept"], -(edge["residual"] or 0.0)))[:_MOST_EDGES]
        columns = len(_EDGES) - all(edge["kept"] for edge in shown)  # none has a reason
        rows = [_row_of(edge, done["scans"]) for edge in shown]
        terminal.print_table(_EDGES[:columns], rows, words=(0, 1, 4, 5), wide=wide)
        if len(shown) < len(edges):
            terminal.print_line(f"{len(shown)} of {len(edges)} edges; --json has all")
        terminal.print_line("")
    kept = sum(edge["kept"] for edge in edges)
    unkept = list(dict.fromkeys(name for one in document["inputs"] for name in one["not_kept"]))
    written = {Path(file).suffix for file in document["files"]}
    is_lossy = unkept and ".ply" in written and ".laz" not in written
    terminal.print_facts(
        ("components", ", ".join(counted(len(rows), "scan") for rows in done["components"])),
        ("pairs", f"{done['tried']} tried; edges: {kept} kept, {len(edges) - kept} dropped"),
        ("two scans", str(FalseAccepts(**done["false_accepts"]))),
        *([("joins", _joined_wrongly(FalseAccepts(**wrong)))] if (wrong := done["false_joins"]) else []),
        ("sd", "standard deviation of a scan's rotation, and of the position of its middle"),
        ("voxel", f"{done['voxel']:.4g} (in the files' unit, as all lengths)"),
        ("time", f"{sum(done['seconds'].values()):.2f} s"),
        *(("note", note) for note in done["notes"]),
        *([("removed", f"{names} of an earlier run")] if (names := ", ".join(done["removed"])) else []),
        *([("not kept", f"{', '.join(unkept)} of the scans; --full keeps those of LAS")] if is_lossy else []),
    )
    print_contents(document, _CONTENTS)


def _row_of_scan(scan: Document, components: Sequence[Sequence[int]]) -> tuple[str, ...]:
    if scan["component"] is None or len(components[scan["component"]]) == 1:
        return scan["name"], "left out" if scan["component"] is None else "alone", "", "", ""
    deviations = _show(scan["deviation_deg"], ".2g"), terminal.show_length(scan["deviation"], 2)
    return scan["name"], str(scan["component"] + 1), _show(scan["probability"]), *deviations


def _joined_wrongly(found: FalseAccepts) -> str:
    low, high = (100 * bound for bound in found.interval)
    wrong = f"about {100 * found.share:.3g} % ({low:.3g} to {high:.3g} %) of the joined scans are wrong"
    return f"{found.decoys} of {counted(found.pairs, 'mirrored scan')} would be joined: {wrong}"


def _row_of(edge: Document, scans: Sequence[Document]) -> tuple[str, ...]:
    names = scans[edge["source"]]["name"], scans[edge["target"]]["name"]
    numbers = _show(edge["probability"]), _show(edge["residual"], ".2f")
    return (*names, *numbers, "yes" if edge["kept"] else "no", edge["reason"])


def _show(value: float | None, form: str = ".3f") -> str:
    return "" if value is None else format(value, form)


@command(
    "merge",
    "cgroup merge scans/*.ply --out scene",
    "# LiDAR scans, each from its own origin, in metres",
    "cgroup merge *.pcd --voxel 0.3 --viewpoint 0 0 0 --axis 0 0 1 --out map",
    "# hundreds of scans, on a Dask cluster",
    "cgroup merge *.ply --scheduler tcp://10.0.0.1:8786 --out scene --json",
    show=_print_scene,
    takes=("voxel", *options.VIEW, "effort"),
)
def merge_command(
    context: typer.Context,
    scans: list[Path] = options.argument(
        "CLOUD", f"Scans in one unit, each in its own frame, in any order; or a folder of them: {FORMATS}."
    ),
    *,
    scheduler: str | None = option(
        "ADDRESS",
        "Dask scheduler whose workers register the pairs; local: one in this process.",
        "Machines",
        "this process",
    ),
    threads: int | None = option("COUNT", "Threads to compute on.", "Machines", "all cores", min=1),
    decoys: int = option(
        "COUNT",
        "Mirrored scans to add, which show how often a scan is joined wrongly.",
        SEARCH,
        default=0,
        min=0,
    ),
    known: list[Path] | None = option(
        "FILE",
        "Known pose of a scan, as register writes it, or of several, as poses.tum; they give the frame.",
        SEARCH,
    ),
    targets: list[Path] | None = option(
        "FILE",
        "Surveyed targets, name x y z per line: of the site first, then a.csv of a.laz and so on.",
        SEARCH,
    ),
    full: bool = options.flag(
        "--full", "Write all points of the files too, with their attributes.", needs="laspy", extra="las"
    ),
    e57: bool = options.flag("--e57", "Write all points of the files too, as scans with poses."),
    write_scans: bool = options.flag("--write-scans", "Write each file too, moved by its pose."),
    out: Path = options.OUT,
    html: bool = options.HTML,
    **shared: Any,
) -> Document:
    """Register many scans into one scene; exit status 3 if they are not all connected.

    A scan that is unreadable, empty, or in another unit is left out (exit status 3).

    Writes the poses, the graph of edges, the merged cloud and a picture of each component of at least two
    scans: poses.tum, graph.g2o, merged.ply, scene.png; of a second component poses_2.tum and so on. --full
    adds merged.laz, where point_source_id numbers the scans of poses.tum from 1. --e57 adds merged.e57, with
    a scan and its pose for each file. --write-scans adds moved/, with the files of connected scans in the
    frame of their component, as cgroup apply has them. Finished pairs are kept in pairs.sqlite, from which a
    killed run continues.
    """
    scans = find_clouds("CLOUD", scans)
    check_laspy(scans if e57 else ())
    merged = [_FULL] * full + [_E57] * e57
    possible = _files_of(out, max(1, len(scans) // 2), html=True, merged=(_FULL, _E57))
    moved = [out / _MOVED / name for name in name_moved(scans)] if write_scans else []
    check_outputs([*possible, *moved, out / _PAIRS], scans)
    results = Results(out, "merge")
    results.check([*_files_of(out, 1, html=html, merged=merged), *moved])
    with _folder_if_needed(out), terminal.show_stages(piped=True) as begin:
        scene = register_all(
            scans,
            **_read_names(scans, known or (), targets or ()) | shared,
            keep=out / _PAIRS,
            scheduler=scheduler,
            threads=threads,
            progress=begin,
        )
        wrong = asdict(false_joins(scene, scans=decoys, threads=threads, progress=begin)) if decoys else None
        inputs, placed = _describe(scene, scans, begin)
        several = sum(len(rows) > 1 for rows in scene.components)
        results.check(_files_of(out, several, html=html, merged=merged))
        with results.writing(identify_run(context)) as files:
            _write(scene, out, several, begin, html=html)
            lost = _merge_files(scene, scans, out, several, merged, begin)
            lost += _move_scans(scene, scans, moved, begin)
    return {
        "inputs": inputs,
        "results": {
            "scans": placed,
            "edges": [fields(edge, *_EDGE_KEYS) for edge in scene.edges],
            "false_accepts": asdict(scene.false_accepts),
            "false_joins": wrong,
            **fields(scene, "components", "tried", "voxel", "seconds"),
            "notes": [*scene.notes, *lost],
            "removed": [path.name for path in results.removed],
        },
        "files": [*files, *([out / _PAIRS] if (out / _PAIRS).exists() else [])],
        "refusal": _refuse(scene, has_viewpoint=is_given(context, "viewpoint")),
    }


def _read_names(scans: Sequence[Path], known: Sequence[Path], targets: Sequence[Path]) -> dict[str, Any]:
    """Return the names of the scans, and the known poses, those of targets too, by the rows of scans."""
    names, stems = unique_names(scans, [scan.name for scan in scans]), [scan.stem for scan in scans]
    rows = {escape(stem): row for row, stem in enumerate(stems) if stems.count(stem) == 1}
    rows |= {escape(name): row for row, name in enumerate(names)}
    found = [pair for file in known for pair in _read_known(file, rows)]
    if (targets and not all(escape(file.stem) in rows for file in targets[1:])) or len(targets) == 1:
        got, remedy = ", ".join(map(str, targets)), "give the site's file, then files named as scans"
        raise InputError("targets", got, f"{remedy}: --targets site.csv --targets {stems[0]}.csv")
    for file in targets[1:]:
        fit = fit_files((file, targets[0]), None)[1]
        if (doubt := refuse_targets(fit)) is not None:
            raise InputError("targets", f"{file}", f"{doubt}; cgroup group --targets has the report")
        found.append((rows[escape(file.stem)], fit["T_target_source"]))
    if len(known_poses := dict(found)) < len(found):
        row = Counter(row for row, _ in found).most_common(1)[0][0]
        raise InputError("known, targets", f"several poses of {names[row]}", "give one pose per scan")
    return {"names": names} | ({"known": known_poses} if found else {})


def _read_known(file: Path, rows: Mapping[str, int]) -> list[tuple[int, FloatArray]]:
    """Return the poses of a file, each with the row of the scan that it names."""
    poses, beside = read_transforms(file), names_file(file)
    text = load_text(beside if beside.is_file() else file)
    listed = find_names(text.splitlines())
    called = [listed.names[row] for row in listed.rows] or [*filter(None, [find_source(text)])]
    keys = ((name, Path(name).name, Path(name).stem) for name in called)
    placed = [next((rows[key] for key in each if key in rows), None) for each in keys]
    found = [(row, pose) for row, pose in zip(placed, poses, strict=False) if row is not None]
    if not len(called) == len(set(called)) == len(poses) or not found:
        got = f"{file}: {len(poses)} poses, {len(called)} names, {len(found)} of them of these scans"
        raise InputError("known", got, "name the scan of each pose in a comment: # scan 0: a.ply")
    return found


def _refuse(scene: Scene, *, has_viewpoint: bool) -> str | None:
    """Return the omitted scans and the number of components in words; None if all are connected."""
    placed = {row for rows in scene.components for row in rows}
    left_out = [name for row, name in enumerate(scene.names) if row not in placed]
    reasons: list[str] = []
    if left_out:
        names = ", ".join(left_out[:5]) + (", ..." if len(left_out) > 5 else "")
        reasons.append(f"{len(left_out)} of {counted(len(scene.names), 'scan')} left out ({names})")
    if len(scene.components) > 1:
        hint = "" if has_viewpoint else GIVE_VIEWPOINT
        sizes = ", ".join(counted(len(rows), "scan") for rows in scene.components[:5])
        more = ", ..." if len(scene.components) > 5 else ""
        parts = f"{len(scene.components)} components ({sizes}{more})"
        reasons.append(f"not all scans are connected: {parts}{hint}")
    return "; ".join(reasons) or None


@contextmanager
def _folder_if_needed(folder: Path) -> Generator[None]:
    """Make the folder for finished pairs; remove it again if it stays empty."""
    was_there = folder.exists()
    make_folder(folder)
    try:
        yield
    except CgroupError:
        with suppress(OSError):  # it holds something
            if not was_there:
                folder.rmdir()
        raise


def _files_of(folder: Path, components: int, *, html: bool, merged: Sequence[str]) -> list[Path]:
    """List the files of a number of components of two scans or more."""
    of_each = (_POSES, _GRAPH, _MERGED, *merged, _PICTURE)
    files = (_file(folder, name, k) for k in range(components) for name in of_each)
    return [*files, folder / _PAGE] if html else [*files]


def _file(folder: Path, name: str, component: int) -> Path:
    path = folder / name
    return path.with_stem(f"{path.stem}_{component + 1}") if component else path


def _describe(scene: Scene, files: Sequence[Path], begin: Any) -> tuple[list[Document], list[Document]]:
    """Return the inputs and the scans for a document."""
    component = {row: k for k, rows in enumerate(scene.components) for row in rows}
    inputs: list[Document] = []
    scans: list[Document] = []
    for row, file in enumerate(files):
        read: Document = {"points": None, "dropped": None, "centroid": None, "not_kept": []}
        deviations: tuple[float | None, float | None] = None, None
        is_placed = row in component
        if is_placed:
            begin(f"reading {file.name}")
            cloud = cloud_of(scene, row)
            middle, unkept = cloud.points.mean(axis=0), unkept_attributes(file)
            deviations = deviations_at(scene.covariance[row], apply(scene.poses[row], middle[None])[0])
            read = {"points": len(cloud), "dropped": cloud.dropped, "centroid": middle, "not_kept": unkept}
        inputs.append({"role": "scan", "file": file, **read})
        scans.append(
            {
                "name": scene.names[row],
                "component": component.get(row),
                "T_component_scan": scene.poses[row] if is_placed else None,
                "probability": scene.probability[row],
                "covariance": scene.covariance[row] if is_placed else None,
                "deviation_deg": deviations[0],
                "deviation": deviations[1],
            }
        )
    return inputs, scans


def _write(scene: Scene, folder: Path, components: int, begin: Any, *, html: bool) -> None:
    begin("writing")
    for k in range(components):
        for name in (_POSES, _GRAPH, _MERGED):
            scene.write(_file(folder, name, k), component=k)
        terminal.write_figure(_file(folder, _PICTURE, k), scene.plot(component=k))
    if html:
        from cgroup.pages import scene_page, write_page  # noqa: PLC0415 - slow to load

        write_page(folder / _PAGE, scene_page(scene))


def _merge_files(
    scene: Scene, files: Sequence[Path], folder: Path, components: int, merged: Sequence[str], begin: Any
) -> list[str]:
    """Merge the files of each component; return the attributes that are not kept."""
    notes: list[str] = []
    for k, rows in enumerate(scene.components[:components]):
        for path in (_file(folder, name, k) for name in merged):
            begin(f"writing {path.name}")
            notes += merge_files([files[row] for row in rows], scene.poses[rows], path)
    return notes


def _move_scans(scene: Scene, files: Sequence[Path], moved: Sequence[Path], begin: Any) -> list[str]:
    """Move the files of connected scans; return the attributes that are not kept."""
    notes: list[str] = []
    placed = [row for rows in scene.components for row in rows if len(rows) > 1] if moved else []
    for row in placed:
        begin(f"moving {files[row].name}")
        make_folder(moved[row].parent)
        notes += [
            f"{files[row].name}: {note}" for note in transform_file(files[row], scene.poses[row], moved[row])
        ]
    return notes
