"""Attributes of points that no output has are named: per file in documents, and on the terminal."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_lines import succeed
from e57_files import FLOAT, e57

from cgroup.datasets import standin_pair
from cgroup.io import write_cloud
from cgroup.io.attributes import unkept_attributes

E57_FIELDS = ("cartesianX", "cartesianY", "cartesianZ", "intensity", "timeStamp", "colorRed")


def ply_of(points: np.ndarray, *names: str) -> bytes:
    """Binary PLY with further numbers per point."""
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    lines += [f"property double {name}" for name in ("x", "y", "z", *names)]
    more = np.zeros((len(points), len(names)))
    return "\n".join([*lines, "end_header", ""]).encode() + np.hstack([points, more]).tobytes()


@pytest.mark.parametrize(
    ("name", "content", "wanted"),
    [
        ("a.ply", ply_of(np.eye(3), "nx", "Red", "intensity", "scalar_GPS", "\x1b[2J"), None),
        ("b.pcd", b"VERSION 0.7\nFIELDS x y z rgb intensity ring _\nDATA ascii\n", ["ring"]),
        ("c.las", bytes(104) + b"\x06" + bytes(200), None),
        ("d.laz", bytes(104) + b"\x80" + bytes(200), None),
        ("e.bin", bytes(16), []),
        ("f.xyz", b"0 0 0 7\n1 0 0 7\n", ["column 4"]),
        ("f.csv", b"x,y,z,nx,ny,nz,Intensity,Ring\n0,0,0,0,0,1,7,8\n", ["Ring"]),
        ("f.asc", b"//X Y Z Scalar\n0 0 0 7\n", ["Scalar"]),
        ("g.txt", b"1,5 2,5 3,5\n1,5 2,5 3,5\n", []),
        ("h.csv", b"1,5;2,5;3,5;7\n", ["column 4"]),
        ("j.csv", b'"x";"y";"z";"scan angle"\n1;2;3;4\n', ["scan angle"]),
        ("l.asc", b"//X Y Z R G B\n0 0 0 1 2 3\n", ["R", "G", "B"]),
        ("f.pts", b"1\n0 0 0 7 1 2 3\n", []),
        ("g.pts", b"1\n0 0 0 1 2 3\n", []),
        ("h.e57", e57(({**dict.fromkeys(E57_FIELDS, (FLOAT, [0.0]))}, "")), ["timeStamp"]),
        ("i.e57", e57(({**dict.fromkeys(E57_FIELDS, (FLOAT, [0.0]))}, ""))[:600], []),
        ("h.ply", b"element", []),
    ],
)  # fmt: skip
def test_headers(tmp_path: Path, name: str, content: bytes, wanted: list[str] | None) -> None:
    (tmp_path / name).write_bytes(content)
    found = unkept_attributes(tmp_path / name)
    assert all(text.isprintable() for text in found)
    if name == "a.ply":
        assert found[0] == "scalar_GPS"
    elif wanted is None:
        assert "classification" in found
        assert "intensity" not in found
        assert ("GPS time" in found) == (name == "c.las")
    else:
        assert found == wanted


def test_commands_name_what_their_outputs_lack(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pair = standin_pair(pixels=60)
    (elsewhere / "source.ply").write_bytes(ply_of(pair.source.points, "ring", "gps_time"))
    write_cloud("target.ply", pair.target)
    assert "ring, gps_time: neither used nor written" in " ".join(
        succeed(capsys, "register", "source.ply", "target.ply").split()
    )
    said = json.loads(succeed(capsys, "register", "source.ply", "target.ply", "--json"))
    assert [one["not_kept"] for one in said["inputs"]] == [["ring", "gps_time"], []]
    assert "not kept    ring, gps_time of the scans" in succeed(
        capsys, "merge", "source.ply", "target.ply", "--out", "scene"
    )
