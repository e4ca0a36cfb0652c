"""Files of registration results, and of the true poses: whatever the tools of the field write.

A pair is the number of its target and of its source in a scene; its pose maps the source into the target's
frame, as ``i j`` of Redwood's logs does. Trajectories and graphs give the pairs that the truth asks for.
"""

from __future__ import annotations

import csv
import json
import re
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup._checks.quoting import escape
from cgroup.errors import InputError
from cgroup.io._files import load_numbers, load_text, naming, parse_file, write_file
from cgroup.io._graphs import parse_text
from cgroup.io._logs import format_log, read_matrices
from cgroup.io._numpy_files import read_arrays
from cgroup.io._results import make_folder
from cgroup.io.transforms import find_poses, read_transforms
from cgroup.rigid import are_rigid, check_rigid

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from cgroup.types import BoolArray, FloatArray

    _Pair = tuple[str | None, int, int, FloatArray | None]  # scene, if it is told; target, source; the pose
    _Clouds = dict[
        int, tuple[int | None, Any]
    ]  # by number: the component, if there is one, and the pose in it

_SUFFIXES = (".log", ".csv", ".npz", ".json", ".g2o", ".tum", ".kitti", ".txt", ".npy")
_UNNAMED = {"est", "gt", "poses", "graph", "result", "results", "trajectory"}
"""Names of files that tell no scene; their folder's does."""

_QUATERNION = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")

Key = tuple[str, int, int]
"""Scene, target and source."""


@dataclass(frozen=True, eq=False)
class PairPoses:
    """Poses of pairs (n,4,4) by scene, target and source; NaN where a pose was refused.

    Of true ones also the information matrix (n,6,6) and the overlap (n,) of each pair, NaN if not known.
    """

    name: str
    keys: list[Key]
    poses: FloatArray
    information: FloatArray = field(default_factory=lambda: np.empty((0, 6, 6)))
    overlap: FloatArray = field(default_factory=lambda: np.empty(0))


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
    """Read what a file or a folder holds; several results where it has several methods."""
    if path.suffix.lower() == ".npz" and path.is_file() and read_arrays(path, optional=["stats"]):
        return _split_methods(path)
    found: dict[Key, tuple[FloatArray, Path]] = {}
    scenes = {scene for scene, _, _ in truth.keys} if truth else None
    for file in _files_of(path):
        content = _READERS.get(file.suffix.lower(), _read_trajectory)(file)
        if isinstance(content, dict):
            content = _pairs_among(content, truth, _name_scene(None, file, scenes))
        for told, target, source, pose in content:
            key = _name_scene(told, file, scenes), target, source
            if key in found:
                message = f"{file}: pair {show_pair(key)} is there twice, first in {found[key][1]}"
                raise InputError(message)
            found[key] = np.full((4, 4), np.nan) if pose is None else pose, file
    if not found:
        message = f"{path}: holds no poses of pairs; names of files with some end in {', '.join(_SUFFIXES)}"
        raise InputError(message)
    poses = np.array([pose for pose, _ in found.values()])
    poses[~np.isfinite(poses).all(axis=(1, 2))] = np.nan
    for row in np.flatnonzero(~are_rigid(poses) & ~np.isnan(poses[:, 0, 0])):
        key = list(found)[row]
        check_rigid(poses[row], f"{found[key][1]}: pose of pair {show_pair(key)}")
    return [PairPoses(path.stem, list(found), poses)]


def read_truth(path: Path) -> PairPoses:
    """Read true poses, and what ``gt.info`` and ``gt_overlap.log`` beside a ``gt.log`` tell."""
    known, *_ = read_results(path)
    if isinstance(known, PairErrors) or np.isnan(known.poses).any():
        message = f"{path}: not a truth; give the true pose of every pair"
        raise InputError(message)
    information: dict[Key, FloatArray] = {}
    overlap: dict[Key, float] = {}
    for file in _files_of(path):
        scene, info, shares = _name_scene(None, file), *map(file.with_name, ("gt.info", "gt_overlap.log"))
        if info.is_file():
            information |= {(scene, *pair): matrix for pair, matrix in read_matrices(info, 6).items()}
        if shares.is_file():
            rows = parse_file(shares, load_numbers).reshape(-1, 3).tolist()
            overlap |= {(scene, int(i), int(j)): share for i, j, share in rows}
    matrices = np.array([information.get(key, np.full((6, 6), np.nan)) for key in known.keys])
    shares = np.array([overlap.get(key, np.nan) for key in known.keys])
    return PairPoses(known.name, known.keys, known.poses, matrices, shares)


def show_pair(key: Key) -> str:
    """Name a pair as data sets do: scene/target-source."""
    return escape(f"{key[0]}/{key[1]}-{key[2]}")


def write_logs(folder: Path | str, results: PairPoses) -> None:
    """Write an est.log per scene, exact to the last bit, as scripts of Predator and GeoTransformer read it.

    Refused pairs are left out, and so are scenes without others.
    """
    scenes, *numbers = (np.array(each) for each in zip(*results.keys, strict=True))
    answered = np.isfinite(results.poses).all(axis=(1, 2))
    for scene in np.unique(scenes[answered]).tolist():
        rows = answered & (scenes == scene)
        file = make_folder(Path(folder) / scene) / "est.log"
        write_file(file, format_log(np.column_stack(numbers)[rows], results.poses[rows]).encode())


def _files_of(path: Path) -> list[Path]:
    """List the files of a result: logs of pairs alone, where a folder has any."""
    files = sorted(file for file in path.rglob("*") if file.suffix.lower() in _SUFFIXES)
    logs = [file for file in files if file.name in ("est.log", "gt.log")]
    return logs or (files if path.is_dir() else [path])


def _name_scene(told: str | None, file: Path, known: Collection[str] | None = None) -> str:
    """Return the scene of a pair, by what is told, by the file's name, or by that of a folder above."""
    stem = () if file.stem in _UNNAMED or _numbers_in(file) else (file.stem,)
    names = [told] if told else [*stem, *(parent.name for parent in file.absolute().parents)]
    names = [name.removesuffix("-evaluation") for name in names]
    chosen = names[0] if known is None else next((name for name in names if name in known), told)
    if chosen is None and known and len(known) > 1:
        message = f"{file}: tells none of the scenes {', '.join(sorted(known))}; name it or its folder so"
        raise InputError(message)
    return chosen or next(iter(known or names))


def _pairs_among(clouds: _Clouds, truth: PairPoses | None, scene: str) -> Iterator[_Pair]:
    """Yield poses of pairs of clouds: of those that the truth has, or of all."""
    every = ((scene, *pair) for pair in combinations(sorted(clouds), 2))
    for name, i, j in truth.keys if truth else every:
        if name == scene and i in clouds and j in clouds:
            (first, target), (second, source) = clouds[i], clouds[j]
            is_joined = first is not None and first == second
            yield None, i, j, np.linalg.solve(target, source) if is_joined else None


def _read_log(file: Path) -> list[_Pair] | _Clouds:
    poses = read_matrices(file, 4)
    if all(i == j for i, j in poses):  # a trajectory
        return {i: (0, pose) for (i, _), pose in poses.items()}
    return [(None, i, j, pose) for (i, j), pose in poses.items()]


def _read_graph(file: Path) -> list[_Pair] | _Clouds:
    """Read the nodes of a g2o file, or its edges where it has no nodes."""
    text = load_text(file)
    with naming(file):
        graph = parse_text(text)
    if "VERTEX" in text:
        return {int(number): (0, pose) for number, pose in zip(graph.ids, graph.poses, strict=True)}
    edges = zip(graph.ids[graph.edges], graph.measurements, strict=True)
    return [(None, int(i), int(j), pose) for (i, j), pose in edges]


def _read_trajectory(file: Path) -> list[_Pair] | _Clouds:
    """Read a pose per line: of TUM, whose times number the clouds if they are whole, or of KITTI."""
    poses, pair = read_transforms(file), _numbers_in(file)
    if len(poses) == 1 and pair:
        return [(None, *pair, poses[0])]
    table = np.empty((0, 0)) if file.suffix.lower() == ".npy" else parse_file(file, load_numbers)
    has_numbers = table.shape == (len(poses), 8) and (table[:, 0] == np.floor(table[:, 0])).all()
    numbers = table[:, 0] if has_numbers else np.arange(len(poses))
    return {int(number): (0, pose) for number, pose in zip(numbers, poses, strict=True)}


def _read_npz(file: Path) -> list[_Pair]:
    """Read ``pairs``, ``poses`` and maybe ``scenes``, or the pose of one pair as GeoTransformer keeps it."""
    pair, single = _numbers_in(file), read_arrays(file, optional=["estimated_transform"])
    if pair and single:
        return [(None, *pair, single["estimated_transform"].astype(float))]
    arrays = read_arrays(file, ["pairs", "poses"], ["scenes"], texts=True)
    pairs, poses = arrays["pairs"], arrays["poses"].astype(float)
    scenes = arrays["scenes"].tolist() if "scenes" in arrays else [None] * len(pairs)
    if pairs.shape != (len(poses), 2) or poses.shape[1:] != (4, 4) or len(scenes) != len(poses):
        message = f"{file}: pairs {pairs.shape}, poses {poses.shape}; give (n,2) and (n,4,4)"
        raise InputError(message)
    return [(scene, int(i), int(j), pose) for scene, (i, j), pose in zip(scenes, pairs, poses, strict=True)]


def _read_csv(file: Path) -> Iterator[_Pair]:
    table = csv.DictReader(load_text(file).splitlines(), restval="")
    names = [*(table.fieldnames or [])]
    columns = [name for name in names if re.fullmatch(r"\D*\d\d", name)]
    columns = [*_QUATERNION] if {*_QUATERNION} <= {*names} else columns
    if not {"target", "source"} <= {*names} or len(columns) not in (7, 12, 16):
        wanted = "scene, target, source, and 12 columns t00 to t23, or tx ty tz qx qy qz qw"
        message = f"{file}: not a table of poses; its first line has to name {wanted}"
        raise InputError(message)
    for number, row in enumerate(table, 2):
        try:
            words = [row[name] for name in columns]
            numbers = np.array([words if any(words) else [np.nan]], dtype=float)
            pose = find_poses("its pose", numbers)[0] if np.isfinite(numbers).all() else None
            pair = int(row["target"]), int(row["source"])
        except ValueError as error:
            message = f"{file}: line {number} isn't a pair and the numbers of its pose ({error})"
            raise InputError(message) from error
        yield row.get("scene") or None, *pair, pose


def _read_json(file: Path) -> list[_Pair] | _Clouds:
    """Read a document of ``cgroup register`` or ``cgroup merge``."""
    document: Any = parse_file(file, json.loads)
    try:
        if "error" in document:  # a refusal doesn't tell its pair
            source, _, target = file.stem.partition("_on_")
            return [(None, _last_number(target), _last_number(source), None)]
        done = document["results"]
        if document["command"] == "merge":
            placed = [(one["name"], one["component"], one["T_component_scan"]) for one in done["scans"]]
            return {_last_number(name): (component, pose) for name, component, pose in placed}
        source, target = (_last_number(one["file"]) for one in document["inputs"])
        return [(None, target, source, np.array(done["T_target_source"], dtype=float))]
    except (KeyError, TypeError, ValueError) as error:
        hint = error if isinstance(error, InputError) else "give what register or merge print by --json"
        message = f"{file}: not a result of cgroup; {hint}"
        raise InputError(message) from error


_READERS = {".log": _read_log, ".csv": _read_csv, ".npz": _read_npz, ".json": _read_json, ".g2o": _read_graph}
"""Files of other suffixes have a pose per line."""


def _last_number(name: str) -> int:
    """Return the number of a cloud: the last one in its name."""
    found = re.findall(r"\d+", Path(name).stem)
    if not found:
        message = f"no number in the name {escape(name)!r}, by which clouds are told"
        raise InputError(message)
    return int(found[-1])


def _numbers_in(file: Path) -> tuple[int, int] | None:
    """Return target and source of a file that is named after them, as 0_13 is."""
    found = re.fullmatch(r"(?:.*\D)?(\d+)[_-](\d+)", file.stem)
    return None if found is None else (int(found[1]), int(found[2]))


def _split_methods(path: Path) -> list[PairPoses | PairErrors]:
    """Read DGR's arrays (methods, pairs, 5): success, errors in m and degrees, seconds, scene."""
    arrays = read_arrays(path, ["stats", "names"], texts=True)
    stats, names = arrays["stats"], arrays["names"].tolist()
    if stats.ndim != 3 or stats.shape[2] != 5 or len(names) != len(stats):
        message = f"{path}: stats has shape {stats.shape}; DGR's is (methods, pairs, 5)"
        raise InputError(message)
    no, unknown = np.zeros(stats.shape[1], dtype=bool), np.full(stats.shape[1], np.nan)
    return [
        PairErrors(
            str(name),
            [(str(int(scene)), -1, -1) for scene in s[:, 4]],
            s[:, 2],
            s[:, 1],
            unknown,
            no,
            no,
            unknown,
        )
        for name, s in zip(names, stats, strict=True)
    ]
