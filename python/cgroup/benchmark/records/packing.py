"""Arrays as bytes, for the store and for the way to other processes; the same numbers, the same bytes."""

from __future__ import annotations

import io
import zipfile
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup.types import OPTIONAL_FIELDS, Correspondences

if TYPE_CHECKING:
    from cgroup.types import BoolArray, FloatArray, RealArray


def pack(correspondences: Correspondences) -> bytes:
    """Correspondences as the bytes of an NPZ file, the same for the same numbers."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name in ("source", "target", *OPTIONAL_FIELDS):
            value = getattr(correspondences, name)
            if value is not None:
                # Without a date of its own the entry would bear the time of day.
                with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w") as entry:
                    np.lib.format.write_array(entry, np.asarray(value, dtype=np.float64))
    return buffer.getvalue()


def unpack(content: bytes) -> Correspondences:
    """Correspondences from `pack`."""
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        fields: dict[str, Any] = {name: archive[name] for name in archive.files}
    if "resolution" in fields:
        fields["resolution"] = float(fields["resolution"])
    return Correspondences(fields.pop("source"), fields.pop("target"), **fields)


def pack_mask(mask: BoolArray) -> bytes:
    """Group as one bit per correspondence."""
    return np.packbits(mask).tobytes()


def unpack_mask(packed: bytes, n: int) -> BoolArray:
    """Group from its bits: (n,) array of bool."""
    return np.unpackbits(np.frombuffer(packed, dtype=np.uint8), count=n).astype(bool)


def floats_as_bytes(array: RealArray) -> bytes:
    """Float64, row by row."""
    return np.ascontiguousarray(array, dtype=np.float64).tobytes()


def floats_from_bytes(content: bytes, shape: tuple[int, ...]) -> FloatArray:
    """Reverse `floats_as_bytes`."""
    return np.frombuffer(content, dtype=np.float64).reshape(shape)
