"""Files of pose graphs: g2o, the text of TORO and GTSAM, Open3D's JSON."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np

from cgroup._checks.quoting import cut, escape
from cgroup.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cgroup._checks.array_types import FloatArray, IndexArray

_UPPER = np.triu_indices(6)
_SWAPPED = np.array([3, 4, 5, 0, 1, 2])
"""Files of g2o and Open3D have the translation first."""

_NUMBERS = {"VERTEX_SE3:QUAT": 8, "VERTEX3": 7, "EDGE_SE3:QUAT": 30, "EDGE3": 29, "FIX": 1}
"""Numbers after the word that a line begins with."""

_PLANE = ("VERTEX_SE2", "EDGE_SE2", "VERTEX2", "EDGE2")


class GraphContent(NamedTuple):
    """What a file holds."""

    poses: FloatArray
    edges: IndexArray
    measurements: FloatArray
    information: FloatArray
    ids: IndexArray
    uncertain: NDArray[np.bool_] | None = None


def parse_text(content: bytes) -> GraphContent:
    """Read lines of g2o, or of TORO and GTSAM."""
    rows: dict[str, list[list[float]]] = {kind: [] for kind in _NUMBERS}
    lines: dict[str, list[int]] = {kind: [] for kind in _NUMBERS}
    for number, line in enumerate(content.decode("utf-8-sig", errors="replace").splitlines(), 1):
        kind, *words = line.split() or ["#"]
        if kind.startswith("#"):
            continue
        if kind not in _NUMBERS:
            _refuse(number, kind)
        expected = _NUMBERS[kind]
        try:
            values = list(map(float, words))
        except ValueError:
            values = []
        if kind == "FIX" and len(values) > 1:
            expected = len(values)
        if len(values) != expected or not np.isfinite(values).all():
            message = f"line {number}: {kind} needs {expected} finite numbers"
            raise InputError(message)
        rows[kind].append(values)
        lines[kind].append(number)
    return _assemble(rows, lines)


def _refuse(number: int, kind: str) -> NoReturn:
    shown = escape(cut(kind))
    reason = f"{shown} is not read; give lines of VERTEX_SE3:QUAT and EDGE_SE3:QUAT, or VERTEX3 and EDGE3"
    if kind.startswith(_PLANE):
        reason = f"{shown} is of a graph in the plane; give poses in space, VERTEX_SE3:QUAT and EDGE_SE3:QUAT"
    message = f"line {number}: {reason}"
    raise InputError(message)


def _assemble(rows: dict[str, list[list[float]]], lines: dict[str, list[int]]) -> GraphContent:
    """Make arrays of the numbers of each kind of line; in the order of the kinds, then of the lines."""
    table = {kind: np.array(values, dtype=float) for kind, values in rows.items() if values and kind != "FIX"}
    ids, poses, ends, measurements, information = [], [], [], [], []
    for kind, numbers in table.items():
        first = 1 if kind.startswith("VERTEX") else 2
        motion = _from_quaternions if kind.endswith("QUAT") else _from_angles
        placed, bad = motion(numbers[:, first:])
        if bad.any():
            message = f"line {lines[kind][int(np.argmax(bad))]}: the quaternion is zero"
            raise InputError(message)
        if first == 1:
            ids.append(_whole(numbers[:, :1], lines[kind]))
            poses.append(placed)
            continue
        ends.append(_whole(numbers[:, :2], lines[kind]))
        measurements.append(placed)
        symmetric = np.empty((len(numbers), 6, 6))
        symmetric[:, _UPPER[0], _UPPER[1]] = symmetric[:, _UPPER[1], _UPPER[0]] = numbers[:, -21:]
        # GTSAM takes the blocks of EDGE3 as they are, rotation first.
        information.append(swap_blocks(symmetric) if kind.endswith("QUAT") else symmetric)
    named = np.concatenate(ids)[:, 0] if ids else np.empty(0, np.int64)
    edges = np.concatenate(ends) if ends else np.empty((0, 2), np.int64)
    placed = np.concatenate(poses) if poses else np.empty((0, 4, 4))
    where = [line for kind in table if kind.startswith("EDGE") for line in lines[kind]]
    if not len(named):  # GTSAM's text has edges only
        named = np.unique(edges)
        placed = np.tile(np.eye(4), (len(named), 1, 1))
    order = np.argsort(named, kind="stable")
    named = named[order]
    twice = np.flatnonzero(named[1:] == named[:-1])
    if len(twice):
        message = f"node {named[twice[0]]} is there twice; give each node one line"
        raise InputError(message)
    for line, fixed in zip(lines["FIX"], rows["FIX"], strict=True):
        if not np.isin(fixed, named).all():
            message = f"line {line}: a node that isn't there is held; give its VERTEX_SE3:QUAT"
            raise InputError(message)
    joined = np.concatenate(measurements) if measurements else np.empty((0, 4, 4))
    weights = np.concatenate(information) if information else np.empty((0, 6, 6))
    _check_lines(edges, weights, named, where)
    return GraphContent(placed[order], np.searchsorted(named, edges), joined, weights, named)


def _check_lines(edges: IndexArray, information: FloatArray, named: IndexArray, lines: list[int]) -> None:
    unknown = ~np.isin(edges, named)
    if unknown.any():
        row, column = np.argwhere(unknown)[0]
        message = f"line {lines[row]}: there is no node {edges[row, column]}; give its VERTEX_SE3:QUAT"
        raise InputError(message)
    bad = singular(information)
    if bad.any():
        message = f"line {lines[int(np.argmax(bad))]}: the information is not positive definite"
        raise InputError(message)


def singular(information: FloatArray) -> NDArray[np.bool_]:
    """Tell which matrices aren't symmetric and positive definite, whatever the units."""
    if not len(information):
        return np.zeros(0, dtype=bool)
    diagonal = np.sqrt(np.maximum(np.einsum("nii->ni", information), 0))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scaled = information / (diagonal[:, :, None] * diagonal[:, None, :])
        symmetric = np.abs(scaled - scaled.transpose(0, 2, 1)).max(axis=(1, 2)) < 1e-6
    defined = symmetric & np.isfinite(scaled).all(axis=(1, 2))
    scaled[~defined] = 0
    return ~(defined & (np.linalg.eigvalsh(scaled)[:, 0] > 1e-12))


def swap_blocks(information: FloatArray) -> FloatArray:
    """Exchange rotation and translation."""
    return information[:, _SWAPPED][:, :, _SWAPPED]


def _whole(numbers: FloatArray, lines: list[int]) -> IndexArray:
    bad = ((numbers != np.floor(numbers)) | (np.abs(numbers) >= 2.0**53)).any(axis=1)
    if bad.any():
        message = f"line {lines[int(np.argmax(bad))]}: the number of a node is no whole number"
        raise InputError(message)
    return numbers.astype(np.int64)


def _matrices(rotation: FloatArray, translation: FloatArray) -> FloatArray:
    poses = np.zeros((len(rotation), 4, 4))
    poses[:, :3, :3], poses[:, :3, 3], poses[:, 3, 3] = rotation, translation, 1
    return poses


def _from_quaternions(rows: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    length = np.linalg.norm(rows[:, 3:7], axis=1)
    bad = length == 0
    x, y, z, w = (rows[:, 3:7] / np.where(bad, 1, length)[:, None]).T
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return _matrices(rotation.transpose(2, 0, 1), rows[:, :3]), bad


def _from_angles(rows: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Turn about x by roll, then about y by pitch, then about z by yaw."""
    (a, b, c), (d, e, f) = np.cos(rows[:, 3:6]).T, np.sin(rows[:, 3:6]).T
    rotation = np.array(
        [
            [c * b, c * e * d - f * a, c * e * a + f * d],
            [f * b, f * e * d + c * a, f * e * a - c * d],
            [-e, b * d, b * a],
        ]
    )
    return _matrices(rotation.transpose(2, 0, 1), rows[:, :3]), np.zeros(len(rows), dtype=bool)


def _quaternions(poses: FloatArray) -> FloatArray:
    """Return x y z w of rotations, the largest of them first found."""
    r = poses[:, :3, :3]
    trace = np.einsum("nii->n", r)
    table = np.zeros((len(r), 4, 4))  # q q' of each
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        table[:, k, k] = 1 + 2 * r[:, k, k] - trace
        table[:, i, j] = table[:, j, i] = r[:, i, j] + r[:, j, i]
        table[:, k, 3] = table[:, 3, k] = r[:, j, i] - r[:, i, j]
    table[:, 3, 3] = 1 + trace
    largest = np.einsum("nii->ni", table).argmax(axis=1)
    found = table[np.arange(len(r)), largest]
    found *= np.where(found[:, 3:] < 0, -1, 1)
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def format_g2o(content: GraphContent) -> bytes:
    """Write lines of g2o."""
    lines = []
    for name, row in zip(content.ids.tolist(), motion_lines(content.poses), strict=True):
        lines.append(f"VERTEX_SE3:QUAT {name} {row}\n")
    upper = swap_blocks(content.information)[:, _UPPER[0], _UPPER[1]].tolist()
    ends = content.ids[content.edges].tolist()
    for (i, j), row, numbers in zip(ends, motion_lines(content.measurements), upper, strict=True):
        lines.append(f"EDGE_SE3:QUAT {i} {j} {row} {' '.join(map(repr, numbers))}\n")
    return "".join(lines).encode()


def motion_lines(poses: FloatArray) -> list[str]:
    """Write x y z qx qy qz qw of poses."""
    rows = np.concatenate([poses[:, :3, 3], _quaternions(poses)], axis=1).tolist()
    return [" ".join(map(repr, row)) for row in rows]


def parse_json(content: bytes) -> GraphContent:
    """Read Open3D's JSON."""
    try:
        graph: Any = json.loads(content)
        nodes, edges = graph["nodes"], graph["edges"]
        poses = _column_major([node["pose"] for node in nodes], 4)
        motions = _column_major([edge["transformation"] for edge in edges], 4)
        weights = _column_major([edge["information"] for edge in edges], 6)
        ends = [(edge["target_node_id"], edge["source_node_id"]) for edge in edges]
        pairs = _whole(np.array(ends, dtype=float).reshape(-1, 2), list(range(len(ends))))
        uncertain = np.array([edge["uncertain"] for edge in edges], dtype=bool)
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        message = "no PoseGraph of Open3D with nodes and edges"
        raise InputError(message) from error
    return GraphContent(poses, pairs, motions, swap_blocks(weights), np.arange(len(poses)), uncertain)


def _column_major(matrices: list[list[float]], size: int) -> FloatArray:
    return np.array(matrices, dtype=float).reshape(-1, size, size).transpose(0, 2, 1).copy()


def format_json(content: GraphContent) -> bytes:
    """Write Open3D's JSON."""

    def numbers(matrix: FloatArray) -> list[float]:
        return matrix.T.ravel().tolist()

    version = {"version_major": 1, "version_minor": 0}
    nodes = [{"class_name": "PoseGraphNode", "pose": numbers(pose), **version} for pose in content.poses]
    weights = swap_blocks(content.information)
    uncertain = np.zeros(len(weights), bool) if content.uncertain is None else content.uncertain
    edges = [
        {
            "class_name": "PoseGraphEdge",
            "confidence": 1.0,
            "information": numbers(information),
            "source_node_id": int(j),
            "target_node_id": int(i),
            "transformation": numbers(motion),
            "uncertain": bool(doubtful),
            **version,
        }
        for (i, j), motion, information, doubtful in zip(
            content.edges, content.measurements, weights, uncertain, strict=True
        )
    ]
    return json.dumps({"class_name": "PoseGraph", "edges": edges, "nodes": nodes, **version}).encode()
