"""``cgroup locate``: estimate the pose of a scan in a map."""

from functools import partial
from pathlib import Path
from typing import Any

import typer

from cgroup import io
from cgroup.cli import options, terminal
from cgroup.cli.command import command, identify_run
from cgroup.cli.commands.locate_bag import locate_bag
from cgroup.cli.documents import Document
from cgroup.cli.files import describe_cloud, name_frames, name_of_pair, read_cloud, refuse_others, write_pose
from cgroup.cli.options import CLOUDS, FORMATS, GIVE_VIEWPOINT, OUTPUT, SEARCH, Point, option
from cgroup.cli.registration_facts import placement_facts, registration_results
from cgroup.errors import InputError
from cgroup.io.bags import is_bag
from cgroup.io.files import check_outputs
from cgroup.io.result_folders import Results, check_folder, make_folder
from cgroup.maps.locate import as_disk
from cgroup.maps.map_files import check_new
from cgroup.registration import Registration
from cgroup.scenes import PreparedMap, locate, prepare_map


def _print_places(document: Document, *, wide: bool) -> None:
    done, places = document["results"], document["results"].get("places", ())
    if "scans" in done:
        good = sum(scan["ok"] for scan in done["scans"])
        terminal.print_facts(("scans", f"{good} of {len(done['scans'])} located"))
    else:
        terminal.print_clouds(document["inputs"])
        levels = ", ".join(f"{level['voxels']} of {level['voxel']:.4g}" for level in done["levels"])
        terminal.print_facts(("voxels", f"{levels} (in the files' unit, as all lengths)"))
    if places:
        overlap = f"{100 * places[0]['fitness']:.0f} % of the scan overlaps the map"
        facts = placement_facts(places[0], document["inputs"][0]["centroid"])
        terminal.print_facts(
            ("places", "1" if len(places) == 1 else f"{len(places)} share the probability"),
            *((name, overlap if name == "overlap" else text) for name, text in facts),
            ("time", f"{sum(places[0]['seconds'].values()):.2f} s"),
        )
    if places and done["ok"]:
        terminal.print_pose(places[0]["T_target_source"], document["inputs"][0], "scan", "map")
    if len(places) > 1:
        terminal.print_line("origin of the scan's frame in the map")
        origins = [[terminal.show_length(row[3]) for row in place["T_target_source"][:3]] for place in places]
        chances = [f"{place['probability']:.3f}" for place in places]
        rows = [(str(row + 1), chances[row], *origin) for row, origin in enumerate(origins)]
        terminal.print_table(("place", "probability", "x", "y", "z"), rows, words=(), wide=wide)
    for file in document["files"]:
        terminal.print_line(f"wrote {file}")


def _check_new(name: str | None) -> Path | None:
    return None if name is None else check_folder(check_new(Path(name)))


@command(
    "locate",
    "cgroup locate scan.ply --map building.ply",
    "# prepare a large map once, and keep it for the next scans",
    "cgroup locate scan1.ply --map city.laz --save-map city",
    "cgroup locate scan2.ply --map city --near 310 -42 0 --radius 20 --json",
    "# see the scan in its place, and rival places",
    "cgroup locate scan.ply --map building.ply --html",
    "# all scans of a ROS recording",
    "cgroup locate drive.mcap --map city --topic /points",
    show=_print_places,
    takes=("voxel", *options.VIEW, "effort"),
)
def locate_command(
    context: typer.Context,
    scan: Path = options.argument("SCAN", f"Cloud to locate: {FORMATS}; or a recording: MCAP, ROS bags."),
    *,
    map: Path = option("MAP", "Cloud, or a folder of --save-map.", CLOUDS, default=...),  # noqa: A002
    near: Point | None = option("X Y Z", "Approximate origin of the scan's frame in the map.", SEARCH),
    radius: float | None = option("LENGTH", "Search radius around --near.", SEARCH, "the scan's radius"),
    topic: str | None = option("NAME", "Topic of a recording with several.", CLOUDS, "the one with clouds"),
    out: Path = options.OUT,
    html: bool = options.HTML,
    save_map: Path | None = option(
        "FOLDER", "Keep the prepared map here.", OUTPUT, parser=str, callback=_check_new
    ),
    **shared: Any,
) -> Document:
    """Estimate the pose of a scan in a map; exit status 3 if none is reliable.

    Writes the pose and the scan in the map's frame: SCAN_in_MAP.txt, SCAN_in_MAP_aligned.ply. If the map
    repeats, all places that share the probability are listed. Of a recording of ROS (MCAP, bags) all scans
    are located: SCAN_in_MAP.tum, and SCAN_in_MAP.json with covariances.
    """
    open_map = partial(_open_map, map, shared.pop("voxel"), save_map)
    search: dict[str, Any] = {**shared, "near": near, "radius": radius}
    as_disk(near, radius)  # preparing a map may take long
    if is_bag(scan):
        return locate_bag(scan, map, topic, out, open_map, html=html, **search)
    if topic is not None:
        raise InputError("topic", topic, "for a recording only")
    name, frames = name_of_pair(scan, map, "in"), name_frames(scan, map)
    pose, moved, page = (out / f"{name}{ending}" for ending in (".txt", "_aligned.ply", ".html"))
    results = Results(out, f"locate {name}")
    check_outputs([pose, moved, page], [scan, map])
    refuse_others([pose], frames)
    results.check([pose, moved, *([page] if html else [])])
    with terminal.show_stages() as begin:
        cloud = read_cloud(scan, begin)
        place, described = open_map(begin)
        found = locate(cloud, place, **search, progress=begin)
    is_found = bool(found) and found[0].ok
    views = {shared["viewpoint"] is None, shared["view_direction"] is None, cloud.viewpoint is None}
    refusal = None if is_found else _reason(found, is_near=near is not None, is_viewed=views != {True})
    with results.writing(identify_run(context)) as files:
        if is_found:
            write_pose(pose, found[0].T_target_source, frames)
            io.write_cloud(moved, found[0].place(cloud))
        if html and found:
            _write_page(page, cloud, place, found, f"{scan.name} in {map.name}", refusal)
    if refusal is not None and found and not html:
        refusal += options.DRAW_GUESS
    return {
        "inputs": [describe_cloud("scan", scan, cloud), described],
        "results": {
            "ok": is_found,
            "levels": [{"voxel": level.voxel, "voxels": len(level.voxels)} for level in place.levels],
            "places": [registration_results(one) for one in found],
        },
        "files": [*files, *([save_map] if save_map else [])],
        "refusal": refusal,
    }


def _write_page(page: Path, *shown: Any) -> None:
    from cgroup.pages import location_page, write_page  # noqa: PLC0415 - slow to load

    *clouds, title, refusal = shown
    write_page(page, location_page(*clouds, title=title, refusal=refusal))


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
    return f"the best place is {chance} only: {overlap}{'' if is_viewed else GIVE_VIEWPOINT}"
