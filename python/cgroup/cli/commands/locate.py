"""``cgroup locate``: estimate the pose of a scan in a map."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from cgroup import io
from cgroup.cli import options
from cgroup.cli.command import command, identify_run, make_app
from cgroup.cli.documents import Document
from cgroup.cli.files import describe_cloud, name_frames, name_of_pair, read_cloud, refuse_others, write_pose
from cgroup.cli.options import Point, option
from cgroup.cli.registration_facts import placement_facts, registration_results
from cgroup.cli.terminal import (
    Column,
    print_clouds,
    print_facts,
    print_line,
    print_pose,
    print_table,
    show_length,
    show_stages,
)
from cgroup.errors import InputError
from cgroup.io.files import check_outputs
from cgroup.io.result_folders import Results, check_folder, make_folder
from cgroup.maps.locate import as_disk
from cgroup.maps.map_files import check_new
from cgroup.registration import Registration
from cgroup.scenes import PreparedMap, locate, prepare_map

_PLACES = (Column("place"), Column("probability"), Column("x"), Column("y"), Column("z"))

app = make_app()


def _print_places(document: Document, *, wide: bool) -> None:
    done, places = document["results"], document["results"]["places"]
    print_clouds(document["inputs"])
    levels = ", ".join(f"{level['voxels']} of {level['voxel']:.4g}" for level in done["levels"])
    print_facts(("voxels", f"{levels} (in the files' unit, as all lengths)"))
    if places:
        overlap = f"{100 * places[0]['fitness']:.0f} % of the scan overlaps the map"
        facts = placement_facts(places[0], document["inputs"][0]["centroid"])
        print_facts(
            ("places", "1" if len(places) == 1 else f"{len(places)} share the probability"),
            *((name, overlap if name == "overlap" else text) for name, text in facts),
            ("time", f"{sum(places[0]['seconds'].values()):.2f} s"),
        )
    if done["ok"]:
        print_pose(places[0]["T_target_source"], document["inputs"][0], "scan", "map")
    if len(places) > 1:
        print_line("origin of the scan's frame in the map")
        origins = [[show_length(row[3]) for row in place["T_target_source"][:3]] for place in places]
        chances = [f"{place['probability']:.3f}" for place in places]
        rows = [(str(row + 1), chances[row], *origin) for row, origin in enumerate(origins)]
        print_table(_PLACES, rows, wide=wide)
    for file in document["files"]:
        print_line(f"wrote {file}")


def _check_new(name: str | None) -> Path | None:
    return None if name is None else check_folder(check_new(Path(name)))


@command(
    app,
    "locate",
    "cgroup locate scan.ply --map building.ply",
    "",
    "# prepare a large map once, and keep it for the next scans",
    "cgroup locate scan1.ply --map city.laz --save-map city",
    "cgroup locate scan2.ply --map city --near 310 -42 0 --radius 20 --json",
    "",
    "# see the scan in its place, and rival places",
    "cgroup locate scan.ply --map building.ply --html",
    show=_print_places,
    takes=("voxel", *options.VIEW, "effort"),
)
def locate_command(
    context: typer.Context,
    scan: Path = options.argument("SCAN", f"Cloud to locate: {options.FORMATS}."),
    *,
    map: Path = option(..., "MAP", "Cloud, or a folder of --save-map.", options.CLOUDS),  # noqa: A002
    near: Point | None = option(
        None, "X Y Z", "Approximate origin of the scan's frame in the map.", options.SEARCH
    ),
    radius: float | None = option(
        None, "LENGTH", "Search radius around --near.", options.SEARCH, "the scan's radius"
    ),
    out: Path = options.OUT,
    html: bool = options.HTML,
    save_map: Path | None = option(
        None, "FOLDER", "Keep the prepared map here.", options.OUTPUT, parser=str, callback=_check_new
    ),
    **shared: Any,
) -> Document:
    """Estimate the pose of a scan in a map; exit status 3 if none is reliable.

    Writes the pose and the scan in the map's frame: SCAN_in_MAP.txt, SCAN_in_MAP_aligned.ply. If the map
    repeats, all places that share the probability are listed.
    """
    voxel = shared.pop("voxel")
    name, frames = name_of_pair(scan, map, "in"), name_frames(scan, map)
    pose, moved, page = (out / f"{name}{ending}" for ending in (".txt", "_aligned.ply", ".html"))
    results = Results(out, f"locate {name}")
    check_outputs([pose, moved, page], [scan, map])
    refuse_others([pose], frames)
    results.check([pose, moved, *([page] if html else [])])
    as_disk(near, radius)  # preparing a map may take long
    with show_stages() as begin:
        cloud = read_cloud(scan, begin)
        place, described = _open_map(map, voxel, save_map, begin)
        found = locate(cloud, place, **shared, near=near, radius=radius, progress=begin)
    is_found = bool(found) and found[0].ok
    views = shared["viewpoint"], shared["view_direction"], cloud.viewpoint
    is_viewed = any(view is not None for view in views)
    refusal = None if is_found else _reason(found, is_near=near is not None, is_viewed=is_viewed)
    with results.writing(identify_run(context)) as files:
        if is_found:
            write_pose(pose, found[0].T_target_source, frames)
            io.write_cloud(moved, found[0].place(cloud))
        if html and found:
            from cgroup.pages import location_page, write_page  # noqa: PLC0415 - slow to load

            title = f"{scan.name} in {map.name}"
            write_page(page, location_page(cloud, place, found, title=title, refusal=refusal))
    parts: Document = {
        "inputs": [describe_cloud("scan", scan, cloud), described],
        "results": {
            "ok": is_found,
            "levels": [{"voxel": level.voxel, "voxels": len(level.voxels)} for level in place.levels],
            "places": [registration_results(one) for one in found],
        },
        "files": [*files, *([save_map] if save_map else [])],
    }
    if refusal is not None:
        parts["refusal"] = refusal + (options.DRAW_GUESS if found and not html else "")
    return parts


def _open_map(file: Path, voxel: float | None, kept: Path | None, begin: Any) -> tuple[PreparedMap, Document]:
    """Open a prepared map, or prepare a cloud; return its description for the document too."""
    if file.is_dir():
        for name, value in (("voxel", voxel), ("save_map", kept)):
            if value is not None:
                raise InputError(name, remedy="for a map that is a cloud; this map is a folder")
        place = PreparedMap.load(file)
        unread = {"points": len(place.points), "dropped": None, "centroid": None, "extent": None}
        return place, {"role": "map", "file": file, **unread}
    cloud = read_cloud(file, begin)
    place = prepare_map(cloud, voxel=voxel, progress=begin)
    if kept is not None:
        make_folder(kept.absolute().parent)
        place.save(kept)
    return place, describe_cloud("map", file, cloud)


def _reason(found: list[Registration], *, is_near: bool, is_viewed: bool) -> str:
    """Return the reason why no place is reliable, and a helpful option."""
    if not found:
        return "no candidate place was found" + ("; give a larger --radius" if is_near else "")
    chance = f"correct with a probability of {found[0].probability:.2f}"
    if len(found) > 1:
        hint = "" if is_near else "; if the place is roughly known, give --near"
        return f"{len(found)} places look the same, and the best is {chance}{hint}"
    overlap = f"{100 * found[0].fitness:.0f} % of the scan overlaps the map"
    return f"the best place is {chance} only: {overlap}{'' if is_viewed else options.GIVE_VIEWPOINT}"
