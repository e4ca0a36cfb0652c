"""``cgroup recognize``: detect models in a scene."""

import itertools
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import typer

from cgroup import io
from cgroup._checks.arrays import in_double
from cgroup._checks.quoting import escape
from cgroup._show.words import say_placement
from cgroup.cli import options, terminal
from cgroup.cli.command import command, identify_run
from cgroup.cli.documents import Document, fields
from cgroup.cli.files import describe_cloud, name_frames, name_of_pair, read_cloud, refuse_others, write_pose
from cgroup.cli.options import CLOUDS, FORMATS, GIVE_VIEWPOINT, SEARCH, argument, option
from cgroup.errors import InputError, NoConsensusError
from cgroup.io.files import check_outputs
from cgroup.io.result_folders import Results
from cgroup.registration import Registration, recognize
from cgroup.rigid import apply
from cgroup.types import PointCloud


def _print_models(document: Document, *, wide: bool) -> None:
    results = document["results"]
    terminal.print_clouds(document["inputs"][:1])
    rows: list[tuple[str, ...]] = []
    for name in (Path(one["file"]).stem for one in document["inputs"][1:]):
        copies = [one for one in results["found"] if one["model"] == name]
        if not copies:
            rows.append((name, "no", "", "", ""))
        for place, one in enumerate(copies, 1):
            which = "yes" if len(copies) == 1 else f"{place} of {len(copies)}"
            numbers = f"{one['probability']:.3f}", f"{100 * one['fitness']:.0f}", f"{one['inlier_rmse']:.3g}"
            rows.append((name, which, *numbers))
    head = ("model", "found", "probability", "visible %", "residual")
    terminal.print_table(head, rows, words=(0, 1), wide=wide)
    for one in results["found"]:
        where = say_placement(np.array(one["T_target_source"]), np.array(one["middle"]))
        terminal.print_facts((Path(one["file"]).stem, where))
    if results["found"]:
        terminal.print_facts(
            ("voxel", f"{results['voxel']:.4g} (in the files' unit, as all lengths)"),
            ("time", f"{results['seconds']:.2f} s"),
        )
        terminal.print_files(document)


@command(
    "recognize",
    "cgroup recognize chef.ply T-rex.ply --scene scan.ply --viewpoint 0 0 0",
    "# number and poses of bolts",
    "cgroup recognize bolt.stl --scene box.pcd --voxel 0.002 --html --json",
    show=_print_models,
    takes=("voxel", "viewpoint", "view_direction"),
)
def recognize_command(
    context: typer.Context,
    models: list[Path] = argument("MODEL", f"Whole models, in the scene's unit; meshes are best: {FORMATS}."),
    *,
    scene: Path = option("CLOUD", "Scene to search.", CLOUDS, default=...),
    most: int | None = option("COUNT", "Largest number of copies per model.", SEARCH, "no limit", min=1),
    out: Path = options.OUT,
    html: bool = options.HTML,
    as_json: bool = options.JSON,
    wide: bool = options.WIDE,
    **shared: Any,
) -> Document:
    """Detect models in a scene and estimate their poses; exit status 3 if none is found.

    Writes the pose and the posed cloud of each model found: MODEL_in_SCENE.txt and MODEL_in_SCENE.ply; of
    further copies MODEL_in_SCENE-2.txt and so on. --html writes models_in_SCENE.html.
    """
    files = {file.stem: file for file in models}
    outputs = Counter(name_of_pair(file, scene, "in") for file in models)
    if len(outputs) < len(models):
        name = outputs.most_common(1)[0][0]
        message = f"models: got two files whose results would be named {escape(name)}; rename one"
        raise InputError(message)
    with terminal.show_stages() as begin:
        clouds = {name: read_cloud(file, begin) for name, file in files.items()}
        target = read_cloud(scene, begin)
        results = {name: _outputs_of(out, file, scene) for name, file in files.items()}
        page = out / f"{name_of_pair(Path('models'), scene, 'in')}.html"
        if html:
            Results(out, "recognize").check([page])
        found = recognize(clouds, target, **shared, most=most, progress=begin)
    by_model = {name: [k for k, (other, _) in enumerate(found) if other == name] for name in files}
    copies = [by_model[name].index(k) + 1 for k, (name, _) in enumerate(found)]
    written = [_files_of(out, files[one[0]], scene, copy) for one, copy in zip(found, copies, strict=True)]
    for name, rows in by_model.items():
        results[name].check(file for k in rows for file in written[k])
    pages = [page] if html and found else []
    for name, rows in by_model.items():
        with results[name].writing(identify_run(context)):
            if pages and name == found[0][0]:
                from cgroup.pages import recognition_page, write_page  # noqa: PLC0415 - slow to load

                title = f"Models in {scene.name}"
                write_page(page, recognition_page(clouds, target, found, title=title))
            for k in rows:
                (pose, posed), T_target_source = written[k], found[k][1].T_target_source
                write_pose(pose, T_target_source, name_frames(files[name], scene))
                io.write_cloud(posed, clouds[name].transformed(T_target_source))
    parts: Document = {
        "inputs": [
            describe_cloud("scene", scene, target),
            *(describe_cloud("model", file, clouds[name]) for name, file in files.items()),
        ],
        "results": {
            "found": [
                _describe(name, one, written[k][0].name, clouds[name]) for k, (name, one) in enumerate(found)
            ],
            "not_found": [name for name in clouds if not by_model[name]],
            "voxel": found[0][1].voxel if found else None,
            "seconds": sum(found[0][1].seconds.values()) if found else None,
        },
        "files": [*itertools.chain.from_iterable(written), *pages],
    }
    if not found:
        if not as_json:  # an error is an object of its own
            _print_models(parts, wide=wide)
        hint = "" if shared["viewpoint"] else GIVE_VIEWPOINT
        message = f"no model was found in {scene.name}{hint}"
        raise NoConsensusError(message)
    return parts


def _outputs_of(folder: Path, model: Path, scene: Path) -> Results:
    """Return the results of a model, having checked that the files of its first copy can be written."""
    first = _files_of(folder, model, scene, 1)
    check_outputs(first)
    refuse_others(first[:1], name_frames(model, scene))
    results = Results(folder, f"recognize {_stem(model, scene, 1)}")
    results.check(first)
    return results


def _describe(model: str, found: Registration, file: str, cloud: PointCloud) -> Document:
    middle = (in_double(cloud.points.min(axis=0)) + in_double(cloud.points.max(axis=0))) / 2  # of the box
    pose = found.T_target_source
    placed = {"model": model, "file": file, "T_target_source": pose, "middle": apply(pose, middle[None])[0]}
    return {**placed, **fields(found, "probability", "fitness", "inlier_rmse")}


def _stem(model: Path, scene: Path, copy: int) -> str:
    return name_of_pair(model, scene, "in") + (f"-{copy}" if copy > 1 else "")


def _files_of(folder: Path, model: Path, scene: Path, copy: int) -> tuple[Path, Path]:
    """Return the files of a copy: its pose and its posed cloud."""
    stem = _stem(model, scene, copy)
    return folder / f"{stem}.txt", folder / f"{stem}.ply"
