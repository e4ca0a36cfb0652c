"""Clouds of other libraries go in wherever arrays of points do, with their normals and faces.

Most are stand-ins with the same attributes, as their libraries are no part of the tests.
"""

import inspect
import re
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pandas as pd
import pytest
import trimesh
from matplotlib import pyplot as plt
from public_calls import Call, called_names, public_calls

import cgroup
from cgroup import features
from cgroup.errors import InputError
from cgroup.fronts.scan import as_scan
from cgroup.plots import keypoints_figure, registration_figure
from cgroup.types import PointCloud


class Vector:
    """Open3D's Vector3dVector: a sequence that NumPy reads through the buffer protocol."""

    def __init__(self, values: Any) -> None:
        self.values = np.array(values)

    def __len__(self) -> int:
        return len(self.values)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.values, dtype=dtype)


class Tensor:
    """PyTorch's: NumPy may have it detached and on the CPU only; it has no bfloat16."""

    def __init__(self, values: Any, device: str = "cpu", dtype: str = "torch.float64", *, grad: bool = False):
        self.values, self.device, self.dtype, self.grad = np.array(values), device, dtype, grad

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return self.numpy()

    def __len__(self) -> int:
        return len(self.values)

    def cpu(self) -> "Tensor":
        return Tensor(self.values, "cpu", self.dtype, grad=self.grad)

    def detach(self) -> "Tensor":
        return Tensor(self.values, self.device, self.dtype)

    def float(self) -> "Tensor":
        return Tensor(self.values.astype(np.float32), self.device, "torch.float32", grad=self.grad)

    def numpy(self) -> np.ndarray:
        if self.grad:
            message = "Can't call numpy() on Tensor that requires grad."
            raise RuntimeError(message)
        if self.device != "cpu" or self.dtype == "torch.bfloat16":
            message = "can't convert"
            raise TypeError(message)
        return self.values


class OnlyDlpack:
    """What has the common exchange of tensors and nothing else."""

    def __init__(self, values: np.ndarray) -> None:
        self.values = values

    def __dlpack__(self, **options: Any) -> Any:
        return self.values.__dlpack__(**options)

    def __dlpack_device__(self) -> Any:
        return self.values.__dlpack_device__()


class TensorMap(dict):
    """Open3D's map of tensors, which has no `get`."""

    get = None


class Frame:
    """A table with named columns, as pandas, polars and pyarrow have it."""

    def __init__(self, names: list[Any], columns: np.ndarray) -> None:
        self.columns = names
        self._columns = dict(enumerate(np.transpose(columns)))

    def __getitem__(self, name: Any) -> Any:
        return SimpleNamespace(to_numpy=lambda: self._columns[self.columns.index(name)])

    def __len__(self) -> int:
        return len(self._columns[0])


def homogeneous(vectors: np.ndarray, last: float) -> np.ndarray:
    return np.column_stack([vectors, np.full(len(vectors), last)])


def small_gicp(points: np.ndarray, normals: np.ndarray) -> Any:
    return SimpleNamespace(
        points=lambda: homogeneous(points, 1), normals=lambda: homogeneous(normals, 0), point=lambda row: row
    )


def message(points: np.ndarray) -> Any:
    """PointCloud2 with a field between, padding after every point and after every row."""
    height, width = 2, len(points) // 2
    record = np.dtype(
        {"names": ["x", "y", "z", "i"], "formats": ["<f4"] * 3 + ["<u2"], "offsets": [4, 8, 16, 0]}
        | {"itemsize": 24}
    )
    content = bytearray(height * (24 * width + 5))
    for row in range(height):
        records = np.zeros(width, record)
        for axis, name in enumerate("xyz"):
            records[name] = points[row * width : (row + 1) * width, axis]
        start = row * (24 * width + 5)
        content[start : start + 24 * width] = records.tobytes()
    kinds = {"x": 7, "y": 7, "z": 7, "i": 4}
    fields = [
        SimpleNamespace(name=name, offset=record.fields[name][1], datatype=kind, count=1)
        for name, kind in kinds.items()
    ]
    return SimpleNamespace(
        fields=fields, height=height, width=width, point_step=24, row_step=24 * width + 5,
        is_bigendian=False, data=bytes(content),
    )  # fmt: skip


def stand_ins(points: np.ndarray, normals: np.ndarray, faces: np.ndarray) -> dict[str, Any]:
    """Clouds of all kinds, by name; each holds the same points."""
    records = np.zeros(len(points), [("z", float), ("X", float), ("y", float), ("intensity", int)])
    records["X"], records["y"], records["z"] = points.T
    nothing = Vector(np.empty((0, 3)))
    return {
        "Open3D cloud": SimpleNamespace(points=Vector(points), normals=nothing, colors=nothing),
        "Open3D cloud with normals": SimpleNamespace(points=Vector(points), normals=Vector(normals)),
        "Open3D mesh": SimpleNamespace(vertices=Vector(points), triangles=Vector(faces)),
        "Open3D tensors": SimpleNamespace(point=TensorMap(positions=Tensor(points), normals=Tensor(normals))),
        "Open3D mesh of tensors": SimpleNamespace(
            vertex=TensorMap(positions=Tensor(points)), triangle=TensorMap(indices=Tensor(faces))
        ),
        "small_gicp": small_gicp(points, normals),
        "PyVista": SimpleNamespace(
            points=points, faces=np.column_stack([np.full(len(faces), 3), faces]).ravel(), regular_faces=faces
        ),
        "PyVista with normals": SimpleNamespace(points=points, point_data={"Normals": normals}),
        "laspy": SimpleNamespace(xyz=points, points=records, x=points[:, 0]),
        "ROS": message(points),
        "pandas": Frame(["intensity", "Z", "x", "Y"], points[:, [0, 2, 0, 1]]),
        "three columns": Frame([0, 1, 2], points),
        "pandas with normals": Frame(["x", "y", "z", "nx", "ny", "nz"], np.hstack([points, normals])),
        "PCL's names": Frame(
            ["x", "y", "z", "normal_x", "normal_y", "normal_z"], np.hstack([points, normals])
        ),
        "CloudCompare's names": Frame(["//X", "Y", "Z", "R"], points[:, [0, 1, 2, 0]]),
        "records": records,
        "tensor": Tensor(points),
        "tensor with a gradient": Tensor(points, grad=True),
        "brain floats": Tensor(points, dtype="torch.bfloat16"),
        "DLPack": OnlyDlpack(points),
        "not contiguous": points[::-1].T.copy().T[::-1],
    }


POINTS = np.random.default_rng(0).normal(size=(60, 3)).astype(np.float32).astype(np.float64)
NORMALS = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
FACES = np.arange(60).reshape(20, 3)
STAND_INS = stand_ins(POINTS, NORMALS, FACES)
REAL = {
    "trimesh": trimesh.Trimesh(POINTS, FACES, process=False),
    "trimesh cloud": trimesh.PointCloud(POINTS),
    "pandas": pd.DataFrame(POINTS[:, ::-1], columns=["Z", "Y", "X"]),
}

WITH_NORMALS = {"Open3D tensors", "PCL's names"} | {kind for kind in STAND_INS if "with normals" in kind}
WITH_FACES = {"Open3D mesh", "Open3D mesh of tensors", "PyVista"}


def assert_is_read(cloud: Any, atol: float, *, normals: bool, faces: bool) -> None:
    """Points, normals and faces are those of the cloud."""
    np.testing.assert_allclose(features.Cloud(cloud).points, POINTS, atol=atol)
    scan = as_scan("cloud", cloud)
    assert (scan.normals is not None, scan.faces is not None) == (normals, faces)
    if scan.normals is not None:
        np.testing.assert_allclose(scan.normals, NORMALS, rtol=0, atol=atol)
    if scan.faces is not None:
        np.testing.assert_array_equal(scan.faces, FACES)


@pytest.mark.parametrize("kind", STAND_INS)
def test_stand_ins_are_read(kind: str) -> None:
    atol = 0.02 if "brain" in kind else 0
    assert_is_read(STAND_INS[kind], atol, normals=kind in WITH_NORMALS, faces=kind in WITH_FACES)


@pytest.mark.parametrize("kind", REAL)
def test_the_libraries_own_clouds_are_read(kind: str) -> None:
    assert_is_read(REAL[kind], 1e-6, normals=False, faces=kind == "trimesh")


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Call]:
    return public_calls(tmp_path_factory.mktemp("files"))


def as_foreign(value: Any) -> Any:
    """Return a cloud as another library has it; lists and dicts of clouds too."""
    if isinstance(value, dict):
        return {name: as_foreign(cloud) for name, cloud in value.items()}
    if isinstance(value, list) and not isinstance(value[0], list):
        return [as_foreign(cloud) for cloud in value]
    if isinstance(value, PointCloud) and value.faces is not None:
        return SimpleNamespace(vertices=Vector(value.points), triangles=Vector(value.faces))
    points = value.points if isinstance(value, PointCloud | features.Cloud) else value
    return SimpleNamespace(points=Vector(points), normals=Vector(np.empty((0, 3))))


@pytest.mark.parametrize("name", sorted(called_names()))
def test_every_function_takes_them(name: str, calls: dict[str, Call]) -> None:
    call = calls[name]
    annotations = {name: str(p.annotation) for name, p in inspect.signature(call.function).parameters.items()}
    given = {
        name: as_foreign(value)
        for name, value in call.arguments.items()
        if re.search("AnyCloud|CloudLike", annotations[name])
    }
    changes = ({}, given) if given else ({},)  # without a cloud the second call would be the first
    usual, *others = (call.run(**changed) for changed in changes)
    foreign = others[0] if others else usual
    fields = ("mask", "target", "descriptors", "T_target_source")
    parts = [(getattr(foreign, field, None), getattr(usual, field, None)) for field in fields]
    for one, other in [(foreign, usual), *parts]:
        if isinstance(other, np.ndarray | float | tuple):
            np.testing.assert_array_equal(one, other)


def test_figures_take_them() -> None:
    assert keypoints_figure(STAND_INS["Open3D cloud"], {"some": [1, 2]}, title="t").axes
    matches, mask = cgroup.Correspondences(POINTS, POINTS), np.ones(60, bool)
    clouds = STAND_INS["tensor"], STAND_INS["ROS"]
    assert registration_figure(*clouds, matches, mask=mask, T_target_source=np.eye(4), title="t").axes
    plt.close("all")


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (Tensor(POINTS, device="cuda:0"), r"got a Tensor on cuda:0; copy it .*: \.cpu\(\)"),
        (Frame(["a", "b", "c", "d"], POINTS[:, [0, 1, 2, 0]]), "got columns a, b, c, d; call three of them x, y"),
        (Frame(list("abcdefghij"), np.zeros((3, 10))), r"got columns a, .*, h, \.\.\.; call"),
        (Frame(["x", "X", "y", "z"], POINTS[:, [0, 1, 2, 0]]), "several columns called 'x'"),
        (np.zeros(3, [("a", float), ("b", float)]), "got columns a, b; call"),
        (np.zeros((3, 4)), r"got shape \(3,4\); give \(n,3\)"),
        (SimpleNamespace(points=None), "got namespace.*; give .*Open3D, small_gicp"),
        (MagicMock(), "cloud"),
    ],
)  # fmt: skip
def test_what_holds_no_points_is_refused_in_one_sentence(value: Any, reason: str) -> None:
    with pytest.raises(InputError, match=reason) as caught:
        features.Cloud(value, name="cloud")
    assert str(caught.value).startswith("cloud")
    assert len(str(caught.value)) < 500
