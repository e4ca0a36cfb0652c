"""Clouds and arrays as other libraries have them: stand-ins with the same attributes, and the real ones."""

import importlib
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np


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
        "trimesh": SimpleNamespace(vertices=points, faces=faces, triangles=points[faces]),
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


def real_clouds(points: np.ndarray, normals: np.ndarray, faces: np.ndarray) -> dict[str, Callable[[], Any]]:
    """Makers of the real ones, by library and kind; they raise ImportError where it isn't installed."""

    def of(library: str, make: Callable[[Any], Any]) -> Callable[[], Any]:
        return lambda: make(importlib.import_module(library))

    def open3d_cloud(o3d: Any) -> Any:
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        cloud.normals = o3d.utility.Vector3dVector(normals)
        return cloud

    def open3d_mesh(o3d: Any) -> Any:
        corners = o3d.utility.Vector3dVector(points), o3d.utility.Vector3iVector(faces)
        return o3d.geometry.TriangleMesh(*corners)

    def estimated(gicp: Any) -> Any:
        cloud = gicp.PointCloud(points)
        gicp.estimate_normals(cloud)
        return cloud

    padded = np.column_stack([np.full(len(faces), 3), faces])
    return {
        "Open3D cloud": of("open3d", open3d_cloud),
        "Open3D mesh": of("open3d", open3d_mesh),
        "Open3D tensors": of("open3d", lambda o3d: o3d.t.geometry.PointCloud.from_legacy(open3d_cloud(o3d))),
        "Open3D mesh of tensors": of(
            "open3d", lambda o3d: o3d.t.geometry.TriangleMesh.from_legacy(open3d_mesh(o3d))
        ),
        "Open3D tensor": of("open3d", lambda o3d: o3d.core.Tensor(points)),
        "small_gicp": of("small_gicp", estimated),
        "small_gicp without normals": of("small_gicp", lambda gicp: gicp.PointCloud(points)),
        "trimesh": of("trimesh", lambda trimesh: trimesh.Trimesh(points, faces, process=False)),
        "trimesh cloud": of("trimesh", lambda trimesh: trimesh.PointCloud(points)),
        "PyVista": of("pyvista", lambda pyvista: pyvista.PolyData(points, padded)),
        "PyVista cloud": of("pyvista", lambda pyvista: pyvista.PolyData(points)),
        "pandas": of("pandas", lambda pandas: pandas.DataFrame(points[:, ::-1], columns=["Z", "Y", "X"])),
        "polars": of("polars", lambda polars: polars.DataFrame(points, schema=["x", "y", "z"])),
        "pyarrow": of("pyarrow", lambda arrow: arrow.table(dict(zip("xyz", points.T.copy(), strict=True)))),
        "torch": of("torch", lambda torch: torch.tensor(points, requires_grad=True)),
        "torch brain floats": of("torch", lambda torch: torch.tensor(points, dtype=torch.bfloat16)),
    }
