"""Files of registration results and of true poses, in the formats of the field's tools.

A pair is the number of its target and of its source in a scene; its pose maps the source into the target's
frame, as ``i j`` of Redwood's logs does. Trajectories and graphs give the pairs of the truth.
"""

import csv
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import combinations, islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cgroup._checks.quoting import escape
from cgroup.errors import InputError
from cgroup.evaluation.recalls import check_information
from cgroup.io.files import load_json, load_numbers, load_text, naming, parse_file
from cgroup.io.numpy_files import read_arrays
from cgroup.io.scan_names import find_names, last_numbers, names_file
from cgroup.io.transforms import find_poses, read_matrices, read_transforms
from cgroup.pose_graph.files import parse_json, parse_text
from cgroup.rigid import check_rigid
from cgroup.rigid.transforms import are_rigid
from cgroup.types import BoolArray, FloatArray

# Of pairs: scene, "" if unknown, target, source and pose.
_Pairs = Iterable[tuple[str, int, int, Any]]

# Names of files that are no scene; the folder is named after it.
_UNNAMED = {"est", "gt", "poses", "graph", "result", "results", "trajectory"}
_MOST_CLOUDS = 1_000  # largest number of clouds whose pairs are all evaluated
_BLOCK = 10_000  # pairs whose poses are computed at once
_LARGEST_NUMBER = 1 << 53  # numbers of clouds are smaller, so that floats are exact
_TAIL = "-evaluation"  # of folders of 3DMatch
_QUATERNION = ["tx", "ty", "tz", "qx", "qy", "qz", "qw"]

Key = tuple[str, int, int]  # scene, target and source


class _Clouds(NamedTuple):
    """Row, component and pose of clouds; names by row, also of clouds without a pose."""

    placed: Sequence[tuple[int, int | None, Any]]
    names: dict[int, str]


@dataclass(frozen=True, eq=False)
class PairPoses:
    """Poses (n,4,4) of pairs, NaN if refused; of true ones also information and overlap, NaN if unknown.

    Where a file lists clouds and no pairs, their numbers are in its order in `clouds`, by scene, with their
    names, "" if unknown.
    """

    name: str
    keys: list[Key]
    poses: FloatArray
    information: FloatArray = field(default_factory=lambda: np.empty((0, 6, 6)))
    overlap: FloatArray = field(default_factory=lambda: np.empty(0))
    clouds: dict[str, dict[int, str]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class PairErrors:
    """Errors of pairs (n,): in degrees, in the data's unit, and the root of Redwood's error, NaN if unknown.

    They are infinite where a pose was refused or is missing. Clouds whose numbers are lost have -1.
    """

    name: str
    keys: list[Key]
    rotation: FloatArray
    translation: FloatArray
    rmse: FloatArray
    refused: BoolArray
    missing: BoolArray
    overlap: FloatArray
    notes: list[str] = field(default_factory=list)


def read_results(path: Path, truth: PairPoses | None = None) -> list[PairPoses | PairErrors]:
    """Read the results in a file or a folder; one per method."""
    if path.suffix.lower() == ".npz" and path.is_file() and read_arrays(path, optional=["stats"]):
        return _split_methods(path)
    files = _files_of(path, is_truth=truth is None)
    scenes = sorted({key[0] for key in truth.keys}) if truth else []
    scene_of = {file: next((name for name in _names_of(file) if name in scenes), "") for file in files}
    only = scenes[0] if len(scenes) == 1 and not any(scene_of.values()) else ""
    found: dict[Key, Path] = {}
    matrices: list[FloatArray] = []
    refused = np.full((4, 4), np.nan)
    clouds: dict[str, dict[int, str]] = {}
    for file in files:
        rows, scene = _READERS.get(file.suffix.lower(), _read_trajectory)(file), scene_of[file] or only
        if isinstance(rows, _Clouds):
            numbers = _number_clouds(rows, truth, scene)
            named = {number: rows.names.get(row, "") for row, number in numbers.items()}
            clouds.setdefault(scene or _names_of(file)[0], {}).update(named)
            rows = _pairs_among(file, rows, numbers, truth, scene)
        usual = scene or _names_of(file)[0]
        for name, i, j, pose in rows:
            key = name.removesuffix(_TAIL) or usual, i, j
            first = next((other for other in (key, (key[0], j, i)) if other in found), None)
            if first is not None:
                raise InputError(f"{file}: pair {show_pair(key)} is there twice, first in {found[first]}")
            if max(abs(i), abs(j)) >= _LARGEST_NUMBER:
                raise InputError(f"{file}: a cloud's number has more than 15 digits; number clouds from 0")
            found[key] = file
            matrices.append(refused if pose is None else pose)
    if not found:
        of = ", ".join(scenes) or "any scene"
        message = f"{path}: holds no poses of pairs of {of}; files of some end in {', '.join(_SUFFIXES)}"
        raise InputError(message)
    poses = np.array(matrices)
    poses[~np.isfinite(poses).all(axis=(1, 2))] = np.nan
    for row in np.flatnonzero(~are_rigid(poses) & ~np.isnan(poses[:, 0, 0])):
        key = list(found)[row]
        check_rigid(poses[row], f"{found[key]}: pose of pair {show_pair(key)}")
    return [PairPoses(path.stem, list(found), poses, clouds=clouds)]


def read_truth(path: Path) -> PairPoses:
    """Read true poses, and ``gt.info`` and ``gt_overlap.log`` beside a ``gt.log``."""
    known, *_ = read_results(path)
    if isinstance(known, PairErrors) or np.isnan(known.poses).any():
        raise InputError(f"{path}: not a truth; give the true pose of every pair")
    rows = {key: row for row, key in enumerate(known.keys)}
    information: FloatArray = np.broadcast_to(np.nan, (len(rows), 6, 6))  # takes no memory
    overlap = np.full(len(rows), np.nan)
    for file in _files_of(path, is_truth=True):
        scene, info, shares = _names_of(file)[0], *map(file.with_name, ("gt.info", "gt_overlap.log"))
        if info.is_file():
            information = np.require(information, None, ["C", "W"])
            for (i, j), matrix in read_matrices(info, 6, check_information).items():
                information[rows.get((scene, i, j), [])] = matrix
        if shares.is_file():
            for i, j, share in parse_file(shares, lambda content: load_numbers(content).reshape(-1, 3)):
                overlap[rows.get((scene, i, j), [])] = share
    return PairPoses(known.name, known.keys, known.poses, information, overlap, known.clouds)


def show_pair(key: Key) -> str:
    """Return the usual name of a pair: scene/target-source."""
    return escape(f"{key[0]}/{key[1]}-{key[2]}" if key[1] >= 0 else f"{key[0]}/?")


def _files_of(path: Path, *, is_truth: bool) -> list[Path]:
    """Return the files of a truth or a result, which may share a folder; logs of pairs take precedence."""
    if not path.is_dir():
        return [path]
    files = sorted(file for file in path.rglob("*") if file.suffix.lower() in _SUFFIXES)
    true, found = ([file for file in files if file.name == name] for name in ("gt.log", "est.log"))
    rest = [file for file in files if file.name not in ("gt.log", "gt_overlap.log")]
    # `cgroup merge` writes the poses of its graphs beside them.
    graphs = {file for file in rest if file.with_name(f"{file.stem.replace('graph', 'poses')}.tum") in rest}
    rest = [file for file in rest if file.suffix != ".g2o" or file not in graphs]
    return (is_truth and true) or found or rest


def _names_of(file: Path) -> list[str]:
    """Return possible names of a file's scene: its own, and those of the folders above."""
    own = () if file.stem in _UNNAMED or _numbers_in(file) else (file.stem,)
    return [name.removesuffix(_TAIL) for name in (*own, *(parent.name for parent in file.absolute().parents))]


def _number_clouds(clouds: _Clouds, truth: PairPoses | None, scene: str) -> dict[int, int]:
    """Return the number in the truth of each row: by the same name, or the same place."""
    # A truth that lists as many clouds is in the same order. In others, the numbers at the end of the names
    # count, or the rows, whichever are more of the truth's.
    rows = sorted({*clouds.names, *(row for row, _, _ in clouds.placed)})
    as_rows = dict(zip(rows, rows, strict=True))
    by_name = last_numbers(clouds.names) or as_rows
    if truth is None:
        return by_name
    known = truth.clouds.get(scene, {})
    places = {name: number for number, name in known.items() if name}
    same = {row: places[name] for row, name in clouds.names.items() if name in places}
    if same:
        return same
    if known and rows == [*range(len(known))]:
        return dict(zip(rows, known, strict=True))
    asked = {number for key in truth.keys if key[0] == scene for number in key[1:]}
    is_named = len(asked & {*by_name.values()}) >= len(asked & {*rows})
    return by_name if is_named else as_rows


def _pairs_among(
    file: Path, clouds: _Clouds, numbers: dict[int, int], truth: PairPoses | None, scene: str
) -> _Pairs:
    """Yield poses of pairs of clouds: those of the truth, or all; solved in blocks."""
    placed: dict[int, tuple[int | None, Any]] = {}
    for row, component, pose in clouds.placed:
        if row not in numbers:  # the truth doesn't name it
            continue
        if numbers[row] in placed or (truth is None and len(placed) == _MOST_CLOUDS):
            is_twice = numbers[row] in placed
            why = f"cloud {row} is there twice" if is_twice else f"more than {_MOST_CLOUDS} clouds"
            raise InputError(f"{file}: {why}; list the pairs that count, each with its pose")
        if component is not None:
            check_rigid(pose, f"{file}: cloud {row}")
        placed[numbers[row]] = component, pose
    asked = [key[1:] for key in truth.keys if key[0] == scene] if truth else combinations(sorted(placed), 2)
    there = ((i, j) for i, j in asked if i in placed and j in placed)
    while block := list(islice(there, _BLOCK)):
        ends = [(placed[i], placed[j]) for i, j in block]
        is_joined = [first is not None and first == second for (first, _), (second, _) in ends]
        joined = [(one[1], other[1]) for (one, other), joins in zip(ends, is_joined, strict=True) if joins]
        targets, sources = np.array(joined).reshape(-1, 2, 4, 4).transpose(1, 0, 2, 3)
        solved = iter(np.linalg.solve(targets, sources))
        for (i, j), joins in zip(block, is_joined, strict=True):
            yield "", i, j, next(solved) if joins else None


def _read_log(file: Path) -> _Clouds | _Pairs:
    poses = read_matrices(file, 4)
    if not all(i == j for i, j in poses):
        return [("", i, j, pose) for (i, j), pose in poses.items()]
    return _Clouds([(i, 0, pose) for (i, _), pose in poses.items()], _read_names(file)[0])


def _read_names(file: Path) -> tuple[dict[int, str], list[int]]:
    """Read the names and rows of scans from the file beside one without comments."""
    beside = names_file(file)
    return find_names(load_text(beside).splitlines()) if beside.is_file() else ({}, [])


def _read_graph(file: Path) -> _Clouds | _Pairs:
    """Read the nodes of a g2o file, or its edges if it has no nodes."""
    text = load_text(file)
    with naming(file):
        graph = parse_text(text)
    if "VERTEX" in text:
        placed = [(number, 0, pose) for number, pose in zip(graph.ids.tolist(), graph.poses, strict=True)]
        return _Clouds(placed, find_names(text.splitlines()).names)
    edges = zip(graph.ids[graph.edges].tolist(), graph.measurements, strict=True)
    return [("", i, j, pose) for (i, j), pose in edges]


def _read_trajectory(file: Path) -> _Clouds | _Pairs:
    """Read a pose per line, of KITTI or of TUM, whose times in s or us are the numbers of the clouds."""
    poses, pair = read_transforms(file), _numbers_in(file)
    if len(poses) == 1 and pair:
        return [("", *pair, poses[0])]
    is_text = file.suffix.lower() != ".npy"
    table = parse_file(file, load_numbers) if is_text else np.empty((0, 0))
    if table.shape == (len(poses), 8):
        numbers, names = table[:, 0], find_names(load_text(file).splitlines()).names
        with np.errstate(over="ignore", invalid="ignore"):
            numbers = numbers if (numbers == np.floor(numbers)).all() else np.round(1e6 * numbers)
        if not (np.abs(numbers) < _LARGEST_NUMBER).all():
            message = f"{file}: a time is not finite, or too large; give times in seconds or microseconds"
            raise InputError(message)
    else:
        names, rows = _read_names(file)
        numbers = rows if len(rows) == len(poses) else range(len(poses))
    return _Clouds([(int(number), 0, pose) for number, pose in zip(numbers, poses, strict=True)], names)


def _read_npz(file: Path) -> _Pairs:
    """Read ``pairs``, ``poses`` and optionally ``scenes``, or the pose of one pair by GeoTransformer."""
    pair, arrays = _numbers_in(file), read_arrays(file, optional=["estimated_transform"])
    if pair and arrays:
        pairs, poses, scenes = np.array([pair]), arrays["estimated_transform"][None], np.array([""])
    else:
        pairs, poses = (np.atleast_1d(each) for each in read_arrays(file, ["pairs", "poses"]).values())
        scenes = read_arrays(file, optional=["scenes"], texts=True).get("scenes", np.full(len(pairs), ""))
    fits = poses.shape[1:] == (4, 4) and pairs.shape == (len(poses), 2) and scenes.shape == poses.shape[:1]
    if not fits or not ((pairs == np.floor(pairs)) & (pairs >= 0) & (pairs < _LARGEST_NUMBER)).all():
        message = f"{file}: pairs {pairs.shape}, poses {poses.shape}; give whole numbers (n,2), and (n,4,4)"
        raise InputError(message)
    rows = zip(scenes.tolist(), pairs.astype(int).tolist(), poses.astype(float), strict=True)
    return [(str(scene), i, j, pose) for scene, (i, j), pose in rows]


def _read_csv(file: Path) -> _Pairs:
    try:
        yield from _rows_of_csv(file)
    except csv.Error as error:
        raise InputError(f"{file}: not a table of poses ({error})") from error


def _rows_of_csv(file: Path) -> _Pairs:
    lines = load_text(file).splitlines()
    separator = next((mark for mark in ";\t" if mark in "".join(lines[:1])), ",")
    table = csv.DictReader(lines, restval="", skipinitialspace=True, delimiter=separator)
    names = [*(table.fieldnames or [])]
    columns = sorted((name for name in names if re.fullmatch(r"\D*\d\d", name)), key=lambda name: name[-2:])
    columns = _QUATERNION if {*_QUATERNION} <= {*names} else columns
    if not {"target", "source"} <= {*names} or len(columns) not in (7, 12, 16):
        wanted = "scene, target, source, and 12 columns t00 to t23, or tx ty tz qx qy qz qw"
        raise InputError(f"{file}: not a table of poses; its first line has to name {wanted}")
    for row in table:
        if table.restkey in row:
            message = f"{file}: line {table.line_num} has more cells than the first; quote those with commas"
            raise InputError(message)
        try:
            words = [row[name] for name in columns]
            # As in all texts, so that commas may be decimal ones.
            numbers = load_numbers(";".join(words).encode()) if any(words) else np.array([[np.nan]])
            pose = find_poses("its pose", numbers)[0] if np.isfinite(numbers).all() else None
            pair = int(row["target"]), int(row["source"])
        except ValueError as error:
            message = f"{file}: line {table.line_num} isn't a pair and the numbers of its pose ({error})"
            raise InputError(message) from error
        yield row.get("scene") or "", *pair, pose


def _read_json(file: Path) -> _Clouds | _Pairs:
    """Read a document of ``cgroup register`` or ``cgroup merge``, or a graph of scans in Open3D's JSON."""
    document: Any = parse_file(file, load_json)
    try:
        if "error" in document:  # a refusal lacks its pair
            source, _, target = file.stem.partition("_on_")
            return [("", _last_number(target), _last_number(source), None)]
        if document.get("class_name") == "PoseGraph":
            poses = parse_json(load_text(file)).poses
            rows = [int(node.get("scan", row)) for row, node in enumerate(document["nodes"])]
            names = {row: str(name) for row, name in enumerate(document.get("scans", ()))}
            return _Clouds([(row, 0, pose) for row, pose in zip(rows, poses, strict=True)], names)
        done, is_pose = document["results"], document["command"] in ("register", "assess")
        if document["command"] == "merge":
            scans = [(one["name"], one["component"], one["T_component_scan"]) for one in done["scans"]]
            placed = [(at, at if at is None else _matrix(pose)) for _, at, pose in scans]
            names = {row: escape(name) for row, (name, _, _) in enumerate(scans)}
            return _Clouds([(row, *one) for row, one in enumerate(placed)], names)
        source, target = (_last_number(one["file"]) for one in document["inputs"] if is_pose)
        return [("", target, source, _matrix(done["T_target_source"]) if done["ok"] else None)]
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        hint = error if isinstance(error, InputError) else "give what register or merge print by --json"
        raise InputError(f"{file}: not a result of cgroup; {hint}") from error


_READERS = {".log": _read_log, ".csv": _read_csv, ".npz": _read_npz, ".json": _read_json, ".g2o": _read_graph}
# Files of suffixes without a reader have a pose per line.
_SUFFIXES = (*_READERS, ".tum", ".kitti", ".txt", ".npy")


def _matrix(rows: list[list[float]]) -> FloatArray:
    return np.array(rows, dtype=float).reshape(4, 4)


def _last_number(name: str) -> int:
    found = re.findall(r"\d+", Path(name).stem)
    if not found:
        raise InputError(f"no number in the name {escape(name)!r}, to identify the cloud")
    return int(found[-1])


def _numbers_in(file: Path) -> tuple[int, int] | None:
    """Return target and source of a file named after them, such as 0_13."""
    found = re.fullmatch(r"(\d+)[_-](\d+)", file.stem)
    return None if found is None else (int(found[1]), int(found[2]))


def _split_methods(path: Path) -> list[PairPoses | PairErrors]:
    """Read DGR's arrays (methods, pairs, 5): success, errors in m and degrees, seconds, scene."""
    arrays = read_arrays(path, ["stats", "names"], texts=True)
    stats, names = arrays["stats"], arrays["names"].tolist()
    if stats.ndim != 3 or stats.shape[::2] != (len(names), 5) or not np.isfinite(stats[..., 4]).all():
        message = f"{path}: stats has shape {stats.shape}; DGR's is (methods, pairs, 5), the last the scene"
        raise InputError(message)
    no, unknown = np.zeros(stats.shape[1], dtype=bool), np.full(stats.shape[1], np.nan)
    keys = [[(str(int(scene)), -1, -1) for scene in scenes] for scenes in stats[..., 4]]
    rows = zip(map(str, names), keys, stats[..., 2], stats[..., 1], strict=True)
    return [PairErrors(*row, unknown, no, no, unknown) for row in rows]
