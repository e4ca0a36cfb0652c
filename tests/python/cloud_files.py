"""Small files of a tetrahedron in every format, written by hand."""

import io
import struct
import zlib
from pathlib import Path

import numpy as np
from e57_files import SINGLE, e57, pose, scaled
from gltf_files import document, glb, gltf, mesh

TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0.25, 0.5, 3]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def numbers(rows: np.ndarray, start: str = "") -> str:
    return "".join(start + " ".join(f"{x:g}" for x in row) + "\n" for row in rows)


def ply_ascii() -> bytes:
    header = (
        "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\n"
        "property float y\nproperty float z\nelement face 4\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    return (header + numbers(TETRAHEDRON) + numbers(FACES, "3 ")).encode()


def ply_binary(order: str) -> bytes:
    word = {"<": "little", ">": "big"}[order]
    header = (
        f"ply\nformat binary_{word}_endian 1.0\nelement vertex 4\nproperty double x\n"
        "property double y\nproperty double z\nproperty uchar red\nproperty uchar green\n"
        "property uchar blue\nelement face 4\nproperty list uchar int vertex_index\nend_header\n"
    )
    rows = b"".join(struct.pack(f"{order}3d3B", *row, 1, 2, 3) for row in TETRAHEDRON)
    faces = b"".join(struct.pack(f"{order}B3i", 3, *row) for row in FACES)
    return header.encode() + rows + faces


def pcd(data: str, *, version: str = "0.7", body: bytes | None = None) -> bytes:
    old = version != "0.7"
    header = (
        f"# .PCD v{version} - Point Cloud Data file format\nVERSION {version}\nFIELDS x y z\n"
        "SIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 4\nHEIGHT 1\n"
        + ("" if old else "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\n")
        + f"DATA {data}\n"
    )
    flat = TETRAHEDRON.astype("<f4")
    bodies = {
        "ascii": numbers(TETRAHEDRON).encode(),
        "binary": flat.tobytes(),
        # One LZF literal run of at most 32 bytes after another.
        "binary_compressed": lzf_literal(flat.T.tobytes()),
    }
    return header.encode() + (bodies[data] if body is None else body)


def write_pcd(path: Path, points: np.ndarray) -> None:
    """Write points in double precision."""
    header = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nPOINTS {len(points)}\nDATA binary\n"
    )
    path.write_bytes(header.encode() + np.ascontiguousarray(points).tobytes())


def lzf_literal(plain: bytes) -> bytes:
    runs = (plain[i : i + 32] for i in range(0, len(plain), 32))
    packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
    return struct.pack("<II", len(packed), len(plain)) + packed


def stl_ascii() -> bytes:
    facet = "facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n"
    body = "".join(facet.format(numbers(TETRAHEDRON[face], "vertex ")) for face in FACES)
    return f"solid tetrahedron\n{body}endsolid tetrahedron\n".encode()


def stl_binary() -> bytes:
    rows = (struct.pack("<12fH", 0, 0, 0, *TETRAHEDRON[f].reshape(-1), 0) for f in FACES)
    return b"made by hand".ljust(80, b" ") + struct.pack("<I", 4) + b"".join(rows)


OBJ = f"# by hand\n{numbers(TETRAHEDRON, 'v ')}{numbers(FACES + 1, 'f ')}".encode()
OFF = f"OFF\n4 4 6\n{numbers(TETRAHEDRON)}{numbers(FACES, '3 ')}".encode()
XYZ = f"// x y z intensity\n{numbers(np.c_[TETRAHEDRON, np.ones(4)])}".encode()

CSV = f"\ufefflabel,Z,Y,X,r,g,b\n{numbers(np.c_[np.zeros(4), TETRAHEDRON[:, ::-1], FACES]).replace(' ', ',')}".encode()
PTS = f"4\n{numbers(np.c_[TETRAHEDRON, np.ones(4), FACES])}".encode()
MIXED_OBJ = b"""# \xe9, not UTF-8
mtllib \xfc.mtl
v 0 0 0 1 0 0
v 1 0 0 0 1 0
vt 0 0
vn 0 0 1
v 0 2 0 0 0 1
v 0.25 0.5 3 0 0 0.5
g first
f 1/1/1 3/1/1 2//1
usemtl other
f 1 2 4
f -3 -2 \\
 -1
f 3 1 4
"""


def las(points: bytes, count: int, point_format: int, *, laszip: bytes = b"") -> bytes:
    """LAS of version 1.2, or 1.4 where the point format needs it; with a record of LASzip, packed points."""
    size = 227 if point_format < 6 else 375
    record = struct.pack("<2x16sHH32x", b"laszip encoded", 22204, len(laszip)) + laszip if laszip else b""
    start = size + len(record)
    header = bytearray(size)
    header[:4], header[24:26] = b"LASF", bytes([1, 2 if size == 227 else 4])
    length = {0: 20, 2: 26, 7: 36}[point_format]
    is_packed = bool(laszip)
    struct.pack_into(
        "<HIIBHI", header, 94, size, start, is_packed, point_format | is_packed << 7, length, count
    )
    struct.pack_into("<6d", header, 131, *[0.25] * 3, *[0] * 3)
    if size == 375:
        struct.pack_into("<Q", header, 247, count)
    if is_packed:  # the place of the chunk table, which counts from the start of the points
        points = struct.pack("<q", start + struct.unpack_from("<q", points)[0]) + points[8:]
    return bytes(header) + record + points


LAS_POINTS = b"".join(struct.pack("<3i8x3H", *row, 256, 512, 768) for row in (4 * TETRAHEDRON).astype(int))
LASZIP_RECORDS = tuple(
    struct.pack(f"<HHBBHIIqqH{3 * items}H", compressor, 0, 2, 2, 0, 0, 50_000, -1, -1, items, *kinds)
    for compressor, items, kinds in ((2, 2, (6, 20, 2, 8, 6, 2)), (3, 2, (10, 30, 3, 11, 6, 3)))
)
"""Of point formats 2 and 7: coordinates and colours."""
LAZ_POINTS = (
    bytes.fromhex(
        "320000000000000000000000000000000000000000000000000000000001000200030055"
        "4379369f9ab5ba41c1d580f8000000000000010000003382000000"
    ),
    bytes.fromhex(
        "6a0000000000000000000000000000000000000000000000000000000000000000000000"
        "0000000100020003040000000c0000000600000000000000000000000000000000000000"
        "00000000000000000000000000000000002a9c42157b12eb8a0000000002220000000000"
        "0000010000003c2d000000"
    ),
)
"""As lazrs packs them, without and with layers."""


def png(depths: np.ndarray, *, bits: int = 16, kind: int = 0, size: tuple[int, int] | None = None) -> bytes:
    """Rows without a filter."""
    width, height = (depths.shape[1], depths.shape[0]) if size is None else size
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in depths)
    chunks = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0)),
        (b"IDAT", zlib.compress(rows)),
        (b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        for name, body in chunks
    )


def npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def npz(**arrays: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def vtk(kind: str, *, is_old: bool) -> bytes:
    """Legacy VTK: cells as they were before version 5.1, each with its count, or as offsets and corners."""

    def write(values: np.ndarray, dtype: str) -> bytes:
        if kind == "ASCII":  # nine numbers a line, as VTK breaks them
            rows = [values.reshape(-1)[i : i + 9] for i in range(0, values.size, 9)]
            return "".join(" ".join(f"{x:g}" for x in row) + "\n" for row in rows).encode()
        return values.astype(dtype).tobytes() + b"\n"

    text = (
        f"# vtk DataFile Version {3 if is_old else 5.1}\nby hand\n{kind}\nDATASET POLYDATA\nPOINTS 4 float\n"
    )
    content = text.encode() + write(TETRAHEDRON, ">f4") + b"METADATA\nINFORMATION 0\n\n"
    if is_old:
        content += b"POLYGONS 4 16\n" + write(np.c_[np.full(4, 3), FACES], ">i4")
    else:
        content += b"POLYGONS 5 12\nOFFSETS vtktypeint64\n" + write(np.arange(0, 13, 3), ">i8")
        content += b"CONNECTIVITY vtktypeint64\n" + write(FACES, ">i8")
    return (
        content + b"\nPOINT_DATA 4\nSCALARS height float\nLOOKUP_TABLE default\n" + write(np.ones(4), ">f4")
    )


def records(*names: str) -> np.ndarray:
    """The points as records, behind a label."""
    array = np.zeros(4, dtype=[("label", "U3"), *((name, "<f8") for name in names)])
    for name, values in zip(names, TETRAHEDRON.T, strict=True):
        array[name] = values
    return array


AXES = "10 20 30\n1 0 0\n0 1 0\n0 0 1\n"
PTX = f"2\n2\n{AXES}1 0 0 0\n0 1 0 0\n0 0 1 0\n10 20 30 1\n{numbers(np.c_[TETRAHEDRON - [10, 20, 30], np.ones(4), FACES])}".encode()
MESH = document(
    TETRAHEDRON.astype("<f4"), FACES.astype("<u2").reshape(-1), meshes=mesh({"POSITION": 0}, indices=1)
)
E57 = e57(
    (
        {
            "cartesianX": (scaled(11, 0.25, 0.0, -1000), 4 * TETRAHEDRON[:, 0] - 4),
            "cartesianY": (SINGLE, TETRAHEDRON[:, 1] - 2),
            "cartesianZ": (scaled(3, 1.0, -3.0), TETRAHEDRON[:, 2]),
        },
        pose(1, 2, 3),
    ),
    size=4,
)

CLOUDS = {
    "ascii.ply": ply_ascii(),
    "little.ply": ply_binary("<"),
    "big.ply": ply_binary(">"),
    "ascii.pcd": pcd("ascii"),
    "old.pcd": pcd("ascii", version=".5"),
    "binary.pcd": pcd("binary"),
    "compressed.pcd": pcd("binary_compressed"),
    "mesh.obj": OBJ,
    "points.obj": numbers(TETRAHEDRON, "v ").encode(),
    "mesh.off": OFF,
    "ascii.stl": stl_ascii(),
    "binary.stl": stl_binary(),
    "points.xyz": XYZ,
    "commas.txt": XYZ.replace(b" ", b", "),
    "SHOUTED.XYZ": XYZ,
    "decimal.txt": XYZ.replace(b".", b","),
    "decimal.csv": CSV.replace(b",", b";").replace(b".", b","),
    "points.asc": b"4\n" + XYZ,
    "normals.xyzn": numbers(np.c_[TETRAHEDRON, np.eye(4)[:, :3]]).encode(),
    "colors.xyzrgb": numbers(np.c_[TETRAHEDRON, FACES / 4]).encode(),
    "upper.pcd": pcd("binary").replace(b"FIELDS x y z", b"FIELDS X Y Z"),
    "ascii.vtk": vtk("ASCII", is_old=True),
    "binary.vtk": vtk("BINARY", is_old=True),
    "offsets.vtk": vtk("ASCII", is_old=False),
    "new.vtk": vtk("BINARY", is_old=False),
    "records.npy": npy(records("x", "y", "z")),
    "records.npz": npz(points=records("X", "Y", "Z")),
    "axes.npz": npz(**dict(zip("xyz", TETRAHEDRON.T, strict=True)), other=np.zeros(9)),
    "names.csv": CSV,
    "count.pts": PTS,
    "mixed.obj": MIXED_OBJ,
    "scan.bin": np.c_[TETRAHEDRON, np.ones(4)].astype("<f4").tobytes(),
    "points.las": las(LAS_POINTS, 4, 2),
    "points.laz": las(LAZ_POINTS[0], 4, 2, laszip=LASZIP_RECORDS[0]),
    "layered.laz": las(LAZ_POINTS[1], 4, 7, laszip=LASZIP_RECORDS[1]),
    "grid.ptx": PTX,
    "mesh.glb": glb(*MESH),
    "mesh.gltf": gltf(*MESH),
    "scan.e57": E57,
    "points.npy": npy(TETRAHEDRON),
    "points.npz": npz(points=TETRAHEDRON, other=np.zeros(9)),
}
