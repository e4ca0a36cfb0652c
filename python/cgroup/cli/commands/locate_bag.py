"""Locate the scans of a recording in a map, one after another."""

from pathlib import Path
from typing import Any

from cgroup.cli.documents import Document, as_text, fields, make_document
from cgroup.cli.files import name_of_pair
from cgroup.cli.terminal import show_stages
from cgroup.errors import InputError
from cgroup.io.bags import read_bag
from cgroup.io.files import check_outputs, write_file
from cgroup.io.result_folders import Results
from cgroup.maps.locate import locate
from cgroup.pose_graph.files import motion_lines

_PARTS = ("ok", "T_target_source", "covariance", "probability")  # of a place, in a document


def locate_bag(
    bag: Path, file: Path, topic: str | None, out: Path, opened: Any, *, html: bool, **search: Any
) -> Document:
    """Locate each scan: the first anywhere, or near a given place, the next ones near the last pose."""
    if html:
        raise InputError("html", remedy="for one scan; this is a recording")
    stem = out / name_of_pair(bag, file, "in")
    poses, facts = (stem.with_name(f"{stem.name}{end}") for end in (".tum", ".json"))
    results = Results(out, f"locate {stem.name}")
    check_outputs([poses, facts], [bag, file])
    results.check([poses, facts])
    scans: list[Document] = []
    around = first = {name: search.pop(name) for name in ("near", "radius")}
    failure = None
    with show_stages() as begin:
        place, described = opened(begin)
        try:
            for time, cloud in read_bag(bag, topic):
                begin(f"scan {len(scans) + 1}")
                one = _locate_one(cloud, place, {**search, **around})
                scans.append({"time": time, "points": len(cloud), "dropped": cloud.dropped, **one})
                around = {"near": one["T_target_source"][:3, 3]} if one["ok"] else first
        except InputError as error:  # what was read before is kept
            if not scans:
                raise
            failure = str(error)
    good = [scan for scan in scans if scan["ok"]]
    lines = [f"{scan['time']:.9f} {motion_lines(scan['T_target_source'][None])[0]}\n" for scan in good]
    document = make_document("locate", scans=scans)
    with results.writing() as files:
        write_file(facts, (as_text(document) + "\n").encode())
        if good:
            write_file(poses, "".join(lines).encode())
    return {
        "inputs": [{"role": "recording", "file": bag}, described],
        "results": {"ok": bool(good), "scans": scans, "failure": failure},
        "files": files,
        "refusal": failure or (None if good else f"none of {len(scans)} scans was located"),
    }


def _locate_one(cloud: Any, place: Any, options: dict[str, Any]) -> Document:
    found, reason = [], "no candidate place was found"
    try:
        found = locate(cloud, place, **options)
    except InputError as error:
        reason = str(error)
    if not found:
        return {**dict.fromkeys(_PARTS), "ok": False, "reason": reason}
    return {**fields(found[0], *_PARTS), "reason": None if found[0].ok else "no place is reliable"}
