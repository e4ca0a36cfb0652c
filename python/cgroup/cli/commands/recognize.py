"""``cgroup recognize``: find models in a scene."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

from cgroup import io
from cgroup.cli import options
from cgroup.cli.command import command, make_app
from cgroup.cli.inputs import describe_cloud, read_cloud
from cgroup.cli.show.json import Document
from cgroup.cli.show.tables import Column, print_table
from cgroup.cli.show.terminal import print_clouds, print_facts, print_files, show_stages
from cgroup.errors import InputError, NoConsensusError
from cgroup.io._results import make_folder
from cgroup.registration import Recognized, recognize

_COLUMNS = (
    Column("model", is_text=True),
    Column("found", is_text=True),
    Column("probability"),
    Column("visible %"),
    Column("residual"),
)

app = make_app()


def _print_models(document: Document, *, wide: bool) -> None:
    """Print which models are in the scene, from the document."""
    results = document["results"]
    print_clouds(document["inputs"][:1])
    rows: list[tuple[str, ...]] = []
    for name in (Path(one["file"]).stem for one in document["inputs"][1:]):
        copies = [one for one in results["found"] if one["model"] == name]
        rows += [_cells(name, place, copies) for place in range(len(copies))] or [(name, "no", "", "", "")]
    print_table(_COLUMNS, rows, wide=wide)
    if results["found"]:
        print_facts(
            ("voxel", f"{results['voxel']:.4g} (in the files' unit, as the residual)"),
            ("time", f"{results['seconds']:.2f} s"),
        )
        print_files(document)


def _cells(name: str, place: int, copies: list[Document]) -> tuple[str, ...]:
    one = copies[place]
    return (
        name,
        "yes" if len(copies) == 1 else f"{place + 1} of {len(copies)}",
        f"{one['probability']:.3f}",
        f"{100 * one['fitness']:.0f}",
        f"{one['inlier_rmse']:.3g}",
    )


@command(
    app,
    "recognize",
    "cgroup recognize chef.ply T-rex.ply --scene scan.ply --viewpoint 0 0 0",
    "",
    "# how many bolts, and where",
    "cgroup recognize bolt.stl --scene box.pcd --voxel 0.002 --json",
    show=_print_models,
)
def recognize_command(
    models: options.ModelsArgument,
    *,
    scene: Annotated[Path, options.option("CLOUD", "What they are looked for in.", options.CLOUDS)],
    voxel: Annotated[
        float | None,
        options.option(
            "LENGTH",
            "Edge length of the voxels, in the files' unit.",
            options.CLOUDS,
            "leaves about 10,000 voxels",
        ),
    ] = None,
    viewpoint: Annotated[
        tuple[float, float, float] | None,
        options.option(
            "X Y Z",
            "Where the scanner stood, if the scene is one single scan: tells far more.",
            options.CLOUDS,
        ),
    ] = None,
    most: Annotated[
        int | None,
        options.option("COUNT", "Copies of each model to look for.", options.SEARCH, "any number", min=1),
    ] = None,
    out: options.OutOption = options.DEFAULT_OUT,
    as_json: options.JsonOption = False,
    wide: options.WideOption = False,
) -> Document:
    """Say which models are in a scene, and where (exit status 3 if none is).

    Writes the pose and the posed cloud of each model found: NAME.txt and NAME.ply; of further copies
    NAME-2.txt and so on.
    """
    files = _by_name(models)
    with show_stages() as begin:
        clouds = {name: read_cloud(file, begin) for name, file in files.items()}
        target = read_cloud(scene, begin)
        found = recognize(clouds, target, voxel=voxel, viewpoint=viewpoint, most=most, progress=begin)
    named = _name_copies(found)
    said: Document = {
        "inputs": [
            describe_cloud("scene", scene, target),
            *(describe_cloud("model", file, clouds[name]) for name, file in files.items()),
        ],
        "results": _results(list(clouds), named),
        "files": [out / (stem + suffix) for stem in named for suffix in (".txt", ".ply")],
    }
    if not found:
        if not as_json:  # an error is an object of its own
            _print_models(said, wide=wide)
        hint = "; if the scene is one single scan, say where the scanner stood: --viewpoint"
        message = f"none of the models was found in {scene.name}{'' if viewpoint else hint}"
        raise NoConsensusError(message)
    make_folder(out)
    for stem, (name, one) in named.items():
        io.write_transform(out / f"{stem}.txt", one.T_target_source)
        io.write_cloud(out / f"{stem}.ply", clouds[name].transformed(one.T_target_source))
    return said


def _by_name(models: list[Path]) -> dict[str, Path]:
    files = {file.stem: file for file in models}
    if len(files) < len(models):
        name = Counter(file.stem for file in models).most_common(1)[0][0]
        message = f"models: got two files named {name!r}; rename one"
        raise InputError(message)
    return files


def _name_copies(found: list[Recognized]) -> dict[str, Recognized]:
    """Name the files of each copy of a model: NAME, NAME-2 and so on."""
    copies: Counter[str] = Counter()
    named: dict[str, Recognized] = {}
    for one in found:
        name = one[0]
        copies[name] += 1
        named[name if copies[name] == 1 else f"{name}-{copies[name]}"] = one
    return named


def _results(names: list[str], found: dict[str, Recognized]) -> Document:
    """List what a document says of the models in a scene."""
    poses = [
        {
            "model": name,
            "file": f"{stem}.txt",
            "T_target_source": one.T_target_source,
            "probability": one.probability,
            "fitness": one.fitness,
            "inlier_rmse": one.inlier_rmse,
        }
        for stem, (name, one) in found.items()
    ]
    first = next((one for _, one in found.values()), None)
    return {
        "found": poses,
        "not_found": [name for name in names if name not in {name for name, _ in found.values()}],
        "voxel": None if first is None else first.voxel,
        "seconds": None if first is None else sum(first.seconds.values()),
    }
