"""Files of pose graphs: g2o, the text of TORO and GTSAM, Open3D's JSON."""

import json
import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from cgroup._checks.arrays import BoolArray, FloatArray, IndexArray
from cgroup._checks.quoting import cut, escape
from cgroup.errors import InputError
from cgroup.io.files import load_json, number_lines
from cgroup.io.scan_names import list_names
from cgroup.rigid.transforms import quaternions, turn

MOST_ID = 2**53  # numbers of nodes are smaller, so that floats are exact
_UPPER = np.triu_indices(6)
_PLACE = np.empty((6, 6), int)
# Place of each entry of a symmetric matrix in its upper triangle
_PLACE[_UPPER] = _PLACE.T[_UPPER] = np.arange(21)

# Files of g2o have the translation first; Open3D's have the rotation first, as here
_SWAPPED = (slice(None), *np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2]))
_SKEWED = 1e-6  # difference from the transpose that rounding may cause, of matrices with a diagonal of ones
_ROUNDING = 1e-4  # negative eigenvalues that rounding to few digits may cause, of the same
_LEAST = 1e-9  # new value of such eigenvalues: too small to change a pose
_SINGULAR = 2e-15  # eigenvalue of a singular matrix, up to rounding; far from the origin all come near it
ROUNDED = 3e-14  # new value of eigenvalues that rounding made negative or zero

_MOST_NAMED = 10
# Numbers after the word that a line begins with
_NUMBERS = {"VERTEX_SE3:QUAT": 8, "VERTEX3": 7, "EDGE_SE3:QUAT": 30, "EDGE3": 29}


class GraphContent(NamedTuple):
    """Content of a file, by the field names of a pose graph."""

    poses: FloatArray
    edges: IndexArray
    measurements: FloatArray
    information: FloatArray
    probability: FloatArray
    ids: IndexArray
    notes: tuple[str, ...] = ()


def trust_steps(edges: IndexArray) -> FloatArray:
    """Return the default probability of edges: 1 from a node to the next one, else 0.5."""
    return np.where(edges[:, 1] - edges[:, 0] == 1, 1.0, 0.5)


def parse_text(content: str) -> GraphContent:
    """Read lines of g2o, or of TORO and GTSAM."""
    rows: dict[str, list[list[float]]] = {kind: [] for kind in _NUMBERS}
    for number, line in enumerate(content.splitlines(), 1):
        kind, *words = line.split() or ["#"]
        if kind in rows:
            rows[kind].append([number, *_parse_numbers(number, kind, words)])
        elif kind != "FIX" and not kind.startswith("#"):
            known = "poses in space, as VERTEX_SE3:QUAT and EDGE_SE3:QUAT, or VERTEX3 and EDGE3"
            raise InputError(f"line {number}: {escape(cut(kind))} is not read; give {known}")
    lines, nodes, poses, _ = _arrays_of(rows, "VERTEX_SE3:QUAT", "VERTEX3")
    edge_lines, ends, measurements, information = _arrays_of(rows, "EDGE_SE3:QUAT", "EDGE3")
    if len(nodes) == 0:  # GTSAM's text has edges only
        nodes = np.unique(ends)
        poses = np.tile(np.eye(4), (len(nodes), 1, 1))
    ids, first = np.unique(nodes, return_index=True)
    again = np.isin(np.arange(len(lines)), first, invert=True)
    _refuse(lines, again, "its node is there twice; give each node one line")
    unknown = np.isin(ends, ids, invert=True)
    missing = f"there is no node {', '.join(map(str, ends[unknown][:1]))}; give its VERTEX_SE3:QUAT"
    _refuse(edge_lines, unknown[:, 0] | unknown[:, 1], missing)
    information, changed = definite(information)
    _refuse(edge_lines, singular(information), "the information is not positive definite; give one that is")
    notes = _notes_of(changed, [f"line {line}" for line in edge_lines[changed]])
    edges = np.searchsorted(ids, ends)
    return GraphContent(poses[first], edges, measurements, information, trust_steps(edges), ids, notes)


def _parse_numbers(line: int, kind: str, words: list[str]) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != _NUMBERS[kind] or not all(map(math.isfinite, values)):
        raise InputError(f"line {line}: {kind} needs {_NUMBERS[kind]} finite numbers")
    return values


def _arrays_of(rows: dict[str, list[list[float]]], *kinds: str) -> Iterable[Any]:
    """Return the numbers of lines and nodes, the motions and the information of all lines of two kinds."""
    return map(np.concatenate, zip(*(_split(kind, rows[kind]) for kind in kinds), strict=True))


def _split(kind: str, rows: list[list[float]]) -> tuple[IndexArray, IndexArray, FloatArray, FloatArray]:
    """Split the lines of one kind, which begin with the number of the line."""
    table = np.array(rows, dtype=float).reshape(-1, 1 + _NUMBERS[kind])
    is_edge, has_quaternion = kind.startswith("EDGE"), kind.endswith("QUAT")
    lines, nodes, shifts, rest = np.split(table, np.cumsum([1, 1 + is_edge, 3]), axis=1)
    lines = lines[:, 0].astype(int)
    whole = (nodes == np.floor(nodes)) & (np.abs(nodes) < MOST_ID)
    _refuse(lines, ~whole.all(axis=1), "the number of a node is no whole number")
    if has_quaternion:
        length = np.linalg.norm(rest[:, :4], axis=1)
        _refuse(lines, length == 0, "the quaternion is zero")
        turns = turn(*(rest[:, :4] / length[:, None]).T)
    else:
        (a, b, c), (d, e, f) = np.sin(rest[:, :3] / 2).T, np.cos(rest[:, :3] / 2).T  # roll, pitch, yaw
        turns = turn(0, 0, c, f) @ turn(0, b, 0, e) @ turn(a, 0, 0, d)
    motions = np.tile(np.eye(4), (len(table), 1, 1))
    motions[:, :3, :3], motions[:, :3, 3] = turns, shifts
    # GTSAM does not reorder the blocks of EDGE3, rotation first.
    place = _PLACE[_SWAPPED[1:]] if has_quaternion else _PLACE
    return lines, nodes.astype(np.int64), motions, rest[:, -21:][:, place] if is_edge else motions


def _refuse(lines: IndexArray, is_bad: BoolArray, reason: str) -> None:
    if is_bad.any():
        raise InputError(f"line {lines[int(np.argmax(is_bad))]}: {reason}")


def definite(information: FloatArray, least: float = _LEAST) -> tuple[FloatArray, BoolArray]:
    """Increase the eigenvalues of semi-definite matrices, up to rounding; return also their mask."""
    # Eigenvalues are those of the matrix that is scaled to a diagonal of ones.
    changed = np.zeros(len(information), bool)
    for row in np.flatnonzero(singular(information)):
        matrix = information[row]
        diagonal = matrix.diagonal()
        if not (np.isfinite(matrix).all() and (largest := diagonal.max()) > 0 and diagonal.min() >= 0):
            continue
        scale = np.sqrt(np.where(diagonal > 0, diagonal, largest))
        scaled = matrix / np.outer(scale, scale)
        if np.abs(scaled - scaled.T).max() > _SKEWED:
            continue
        values, vectors = np.linalg.eigh(scaled)
        if values[0] >= -_ROUNDING:
            if not changed.any():
                information = information.copy()
            raised = (vectors * np.maximum(values, least)) @ vectors.T
            raised = (raised + raised.T) / 2 * np.outer(scale, scale)
            information[row], changed[row] = raised, True
    return information, changed


def singular(information: FloatArray) -> BoolArray:
    """Return the mask of matrices that are not symmetric and positive definite, for any units."""
    diagonal = np.sqrt(np.maximum(np.einsum("nii->ni", information), 0))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scaled = information / (diagonal[:, :, None] * diagonal[:, None, :])
        skewed = np.abs(scaled - scaled.transpose(0, 2, 1)).max(axis=(1, 2))
    scaled[~(skewed < _SKEWED)] = 0  # also those that aren't finite
    return np.linalg.eigvalsh(scaled)[:, 0] <= _SINGULAR


def format_g2o(graph: GraphContent, names: Sequence[str] = ()) -> str:
    """Return lines of g2o; if the nodes are scans, their names are comments."""
    lines = [f"# {line}" for line in list_names(names, graph.ids.tolist())] if names else []
    nodes = zip(graph.ids.tolist(), motion_lines(graph.poses), strict=True)
    lines += [f"VERTEX_SE3:QUAT {node} {motion}" for node, motion in nodes]
    weights = number_lines(graph.information[_SWAPPED][:, _UPPER[0], _UPPER[1]])
    edges = zip(graph.ids[graph.edges].tolist(), motion_lines(graph.measurements), weights, strict=True)
    lines += [f"EDGE_SE3:QUAT {i} {j} {motion} {weight}" for (i, j), motion, weight in edges]
    return "".join(f"{line}\n" for line in lines)


def motion_lines(poses: FloatArray) -> list[str]:
    """Return lines x y z qx qy qz qw of poses."""
    return number_lines(np.concatenate([poses[:, :3, 3], quaternions(poses[:, :3, :3])], axis=1))


def parse_json(content: str) -> GraphContent:
    """Read Open3D's JSON."""
    try:
        graph: Any = load_json(content)
        edges = graph["edges"]
        poses = _by_columns([node["pose"] for node in graph["nodes"]], 4)
        ends = np.array([(edge["target_node_id"], edge["source_node_id"]) for edge in edges])
        measurements = _by_columns([edge["transformation"] for edge in edges], 4)
        information = _by_columns([edge["information"] for edge in edges], 6)
        information, changed = definite(information)
        probability = np.array([0.5 if edge["uncertain"] else 1.0 for edge in edges])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        message = f"no PoseGraph of Open3D with nodes and edges ({escape(cut(str(error)))})"
        raise InputError(message) from error
    notes = _notes_of(changed, [f"edge {row}" for row in np.flatnonzero(changed)])
    return GraphContent(poses, ends, measurements, information, probability, np.arange(len(poses)), notes)


def _notes_of(changed: BoolArray, names: list[str]) -> tuple[str, ...]:
    if not changed.any():
        return ()
    more = ", ..." if len(names) > _MOST_NAMED else ""
    where = f"{', '.join(names[:_MOST_NAMED])}{more}"
    what = "semi-definite information matrices within rounding, which were made positive definite"
    return (f"{changed.sum()} of {len(changed)} edges have {what}: {where}",)


def _by_columns(matrices: list[list[float]], size: int) -> FloatArray:
    return np.array(matrices, dtype=float).reshape(-1, size, size).transpose(0, 2, 1)


def format_json(graph: GraphContent, names: Sequence[str] = ()) -> str:
    """Return Open3D's JSON; if the nodes are scans, it contains their names and rows."""
    poses, measurements, information = (
        [matrix.T.ravel().tolist() for matrix in matrices]
        for matrices in (graph.poses, graph.measurements, graph.information)
    )
    uncertain = (graph.probability < 1).tolist()
    version = {"version_major": 1, "version_minor": 0}
    nodes: list[dict[str, Any]] = [
        {"class_name": "PoseGraphNode", "pose": pose, **({"scan": row} if names else {}), **version}
        for row, pose in zip(graph.ids.tolist(), poses, strict=True)
    ]
    edges = [
        {
            "class_name": "PoseGraphEdge", "confidence": 1.0, "information": information[row],
            "source_node_id": j, "target_node_id": i, "transformation": measurements[row],
            "uncertain": uncertain[row], **version,
        }
        for row, (i, j) in enumerate(graph.edges.tolist())
    ]  # fmt: skip
    scans = {"scans": list(map(escape, names))} if names else {}
    return json.dumps({"class_name": "PoseGraph", "edges": edges, "nodes": nodes, **scans, **version})
