"""What is fuzzed of the readers and of the command line; each target takes bytes, and raises what nobody should see.

`make fuzz` runs them under atheris, test_fuzz_targets.py on seeded bytes. An error of cgroup's own is a fine answer, and so is the
end of the program with a status that its help names; any other error is a finding.
"""

import contextlib
import functools
import io
import json
import sys
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from cloud_files import CLOUDS, png
from e57_files import seal

import cgroup
import cgroup.cli
from cgroup.evaluation.result_files import read_results, read_truth
from cgroup.io import read_cloud, read_depth
from cgroup.maps.prepared_map import Level
from cgroup.scenes import PoseGraph, PreparedMap
from cgroup.scenes.kept_links import KeptLinks
from cgroup.scenes.links import Link

# Statuses that `cgroup --help` and the documentation name.
STATUSES = {0, 2, 3}


class Draws:
    """Choices made of bytes; where they end, the first of each."""

    def __init__(self, data: bytes) -> None:
        self._bytes: Iterator[int] = iter(data)

    def number(self, count: int) -> int:
        high, low = next(self._bytes, 0), next(self._bytes, 0)
        return (256 * high + low) % count

    def one_of(self, values: tuple[Any, ...]) -> Any:
        return values[self.number(len(values))]

    def rest(self) -> bytes:
        return bytes(self._bytes)


COMMANDS: tuple[tuple[str, ...], ...] = (
    ("detect", "FILE"),
    ("describe", "FILE"),
    ("group", "FILE", "--out", "OUT"),
    ("register", "FILE", "FILE"),
    ("register", "FILE", "GOOD"),
    ("compare", "GOOD", "GOOD", "--truth", "FILE"),
    ("recognize", "FILE", "GOOD"),
    ("locate", "GOOD", "--map", "FILE"),
    ("benchmark", "run", "FILE", "--out", "OUT"),
    ("benchmark", "status", "FILE", "--out", "OUT"),
)
ENDINGS = (".ptx", ".e57", ".gltf", ".glb", ".ply", ".pcd", ".xyz", ".obj", ".off", ".stl", ".txt", ".npy", ".npz", ".csv", ".pts", ".bin", ".las", ".laz", ".toml", "")  # fmt: skip
HEADS = (
    b"",
    b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n1 0 0\n",
    b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty double x\nproperty double y\nproperty double z\nend_header\n",
    b"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n0 0 0\n",
    b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    b"0 0 0 1 0 0\n1 0 0 2 0 0\n0 1 0 1 1 0\n",
    b"1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n",
    b'[[experiments]]\nname = "a"\n',
    b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }" + b" " * 58 + b"\n",
    CLOUDS["points.las"],
    CLOUDS["points.laz"],
    CLOUDS["layered.laz"],
)


def run_command(data: bytes) -> None:
    draws = Draws(data)
    command, ending, head = draws.one_of(COMMANDS), draws.one_of(ENDINGS), draws.one_of(HEADS)
    start, length = draws.number(len(head) + 1), draws.number(8)
    content = head[:start] + draws.rest() + head[start + length :]
    with tempfile.TemporaryDirectory() as folder:
        files = {"FILE": f"file{ending}", "GOOD": "good.xyz", "OUT": "out"}
        names = {word: Path(folder, name) for word, name in files.items()}
        names["FILE"].write_bytes(content)
        names["GOOD"].write_text("0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\n", encoding="ascii")
        _run([str(names.get(word, word)) for word in command])


def _run(arguments: list[str]) -> None:
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        try:
            cgroup.cli.main(arguments)
        except SystemExit as end:
            status = end.code
    if status not in STATUSES:
        message = f"{arguments} ended with status {status}: {output.getvalue()}"
        raise RuntimeError(message)
    if "Traceback" in output.getvalue():
        raise RuntimeError(output.getvalue())


SCANS = {name: CLOUDS[name] for name in ("scan.e57", "mesh.glb", "mesh.gltf")} | {
    "depth.png": png(np.arange(48, dtype=np.uint16).reshape(6, 8))
}


def read_scan(data: bytes) -> None:
    """Read a small file, some bytes of which are others; where pages have checksums, these are right."""
    draws = Draws(data)
    name = draws.one_of(tuple(SCANS))
    content = SCANS[name]
    start, length = draws.number(len(content)), draws.number(8)
    content = content[:start] + draws.rest() + content[start + length :]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        path.write_bytes(seal(content) if name == "scan.e57" else content)
        with contextlib.suppress(cgroup.InputError):
            if name == "depth.png":
                read_depth(path, (500, 500, 3, 2))
            else:
                read_cloud(path)


def _stored_files(folder: Path) -> dict[str, bytes]:
    """Write a small file of each kind that cgroup keeps, or reads as a result or a graph."""
    pose = np.eye(4)
    pose[:3, 3] = 1, 2, 3
    graph = PoseGraph([np.eye(4), pose, pose @ pose], [(0, 1), (1, 2)], [pose] * 2, [np.eye(6)] * 2)
    graph.write(folder / "graph.g2o")
    graph.write(folder / "graph.json")
    rows = "".join(f"{' '.join(map(str, row))}\n" for row in pose.tolist())
    (folder / "est.log").write_text(f"0 1 3\n{rows}1 2 3\n{rows}")
    (folder / "poses.csv").write_text(
        "target,source,tx,ty,tz,qx,qy,qz,qw\n0,1,1,2,3,0,0,0,1\n1,2,1,2,3,0,0,0,1\n"
    )
    (folder / "poses.tum").write_text("0 0 0 0 0 0 0 1\n1 1 2 3 0 0 0 1\n2 2 4 6 0 0 0 1\n")
    np.savez(folder / "pairs.npz", pairs=[(0, 1), (1, 2)], poses=[pose] * 2)
    scans = [{"name": f"scan{k}", "component": 1, "T_component_scan": pose.tolist()} for k in range(3)]
    (folder / "result.json").write_text(json.dumps({"command": "merge", "results": {"scans": scans}}))
    level = Level(
        1.0, *(np.ones(shape) for shape in ((4, 3), (4, 3), (4, 3), (4, 3, 3), (4, 34), (1, 3), (1,), (1,)))
    )
    PreparedMap(np.ones((4, 3)), [level], 1.0).save(folder / "map")
    with closing(KeptLinks(folder / "pairs.sqlite", [])) as kept:
        kept.add(_stored_files, ((), ()), Link(pose[None], np.ones(1), np.eye(6), 0.5, 0.5))
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@functools.cache
def stored_files() -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        return _stored_files(Path(folder))


NUMBERS = (b"nan", b"inf", b"-1", b"1e300", b"9" * 400, b"[" * 5000, b"0", b"18446744073709551615", b'"', b"null", b"")  # fmt: skip


def read_stored(data: bytes) -> None:
    """Read a graph, a result, a map or finished pairs, some bytes or words of which are others."""
    files, draws = stored_files(), Draws(data)
    name = draws.one_of(tuple(files))
    content = files[name]
    start, length = draws.number(len(content)), draws.number(8)
    new = draws.one_of(NUMBERS) if draws.number(2) else draws.rest()
    content = content[:start] + (new + content[start + length :] if draws.number(8) else b"")
    with tempfile.TemporaryDirectory() as folder:
        for other, whole in files.items():
            if Path(other).parent == Path(name).parent and other.startswith("map"):
                Path(folder, other).parent.mkdir(exist_ok=True)
                Path(folder, other).write_bytes(whole)
        path = Path(folder, name)
        path.write_bytes(content)
        with contextlib.suppress(cgroup.InputError):
            _read_stored(path)


def _read_stored(path: Path) -> None:
    if path.parent.name == "map":
        PreparedMap.load(path.parent)
    elif path.suffix == ".sqlite":
        with closing(KeptLinks(path, [])) as kept:
            kept.find(_stored_files, [((), ())])
    elif path.stem == "graph":
        PoseGraph.read(path).optimize(robust=True, threads=1)
    else:
        truth = read_truth(path)
        read_results(path, truth)


TARGETS = {
    "read_scan": read_scan,
    "read_stored": read_stored,
    "run_command": run_command,
}

if __name__ == "__main__":
    # python fuzz_targets.py <target> <file>: an input that `make fuzz` found, without atheris.
    TARGETS[sys.argv[1]](Path(sys.argv[2]).read_bytes())
