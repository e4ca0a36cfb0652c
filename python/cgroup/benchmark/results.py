"""Results as they come from workers, with arrays as bytes; the same numbers, the same bytes."""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import dataclass, field
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup import __version__
from cgroup.benchmark.machine import Machine, this_machine
from cgroup.types import OPTIONAL_FIELDS, Correspondences

if TYPE_CHECKING:
    from cgroup.types import BoolArray, FloatArray, RealArray

KILLED = "WorkerKilled: the process that worked on it died, perhaps for want of memory"
"""Error of a task that took its worker with it."""

OUT_OF_TIME = "OutOfTime"
"""What the error of a solver that took too long begins with."""


def _now() -> str:
    return datetime.now(timezone.utc).isoformat(timespec="seconds")


@dataclass(frozen=True)
class Provenance:
    """Version and machine that made a result, and the time."""

    version: str = __version__
    machine: Machine = field(default_factory=this_machine)
    created: str = field(default_factory=_now)


@dataclass(frozen=True)
class Matched:
    """A problem of an experiment, or of the timing, matched once for all methods.

    `content` are the packed matches, `truth` and `sample` float64 of the true pose and of source points in
    the overlap; `pr` is the resolution; `facts`, `seconds` (of each step) and `parameters` (of `correspond`)
    are JSON. The store takes the fields in this order.
    """

    problem: str
    content: bytes = b""
    truth: bytes = b""
    sample: bytes = b""
    n: int = 0
    pr: float | None = None
    facts: str = "{}"
    seconds: str = "{}"
    parameters: str = "{}"
    error: str = ""
    provenance: Provenance = field(default_factory=Provenance)


@dataclass(frozen=True)
class Result:
    """The outcome of a solver on a problem, both named by their keys.

    `threads` is 0 for all cores. `machine` is the id of the machine whose times these are; empty for other
    results. `limit` and `seconds` are those of the solver. `mask` has one bit per match, `pose` 16 float64.
    `numbers` is JSON of all other numbers, by the names of their columns. `skipped` says why the solver did
    not run, or not to its end. The store takes the fields in this order.
    """

    problem: str
    solver: str
    threads: int = 1
    machine: str = ""
    limit: float | None = None
    seconds: float | None = None
    mask: bytes | None = None
    pose: bytes | None = None
    numbers: str = "{}"
    skipped: str = ""
    error: str = ""
    provenance: Provenance = field(default_factory=Provenance)


@dataclass(frozen=True)
class Score:
    """One group judged at one threshold: errors in degrees, data unit and pr; protocols as JSON."""

    problem: str
    solver: str
    epsilon: float
    correct: int
    selected: int
    selected_correct: int
    rotation_error: float | None
    translation_error: float | None
    rmse: float | None
    protocols: str


def describe_error(error: Exception) -> str:
    """Type and message in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def none_unless_finite(value: float) -> float | None:
    """Turn NaN and infinity into the records' None."""
    return float(value) if np.isfinite(value) else None


def rounded_json(seconds: dict[str, float]) -> str:
    """Seconds of stages as JSON."""
    return json.dumps({stage: round(value, 6) for stage, value in seconds.items()})


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
