"""What every reference method returns, and the two argument rules they share."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class ReferenceGrouping:
    """What a method of cgroup gives, and intermediate quantities; `threshold` is the cut really used."""

    mask: BoolArray
    scores: FloatArray | None
    threshold: float | None
    details: dict[str, Any] = field(default_factory=dict)
    alternatives: FloatArray | None = None
    alternative_scores: FloatArray | None = None
    ok: bool | None = None
    false_alarms: float | None = None
    noise: float | None = None
    instances: BoolArray | None = None


def as_rows(values: ArrayLike, *shape: int) -> FloatArray:
    """(n, *shape) float64 copy: numbers, points (3) or frames (3, 3) with the x, y, z axes as rows."""
    return np.array(values, dtype=np.float64).reshape(-1, *shape)


def has_frame(source_lrf: FloatArray, target_lrf: FloatArray) -> BoolArray:
    """(n,) True where both frames of a correspondence are free of NaN."""
    return np.isfinite(source_lrf).all(axis=(1, 2)) & np.isfinite(target_lrf).all(axis=(1, 2))


def length(value: float | None, resolution: float | None, multiple: float) -> float:
    """Return `value`, or `multiple` times `resolution` when it is not given."""
    if value is None:
        assert resolution is not None
        return multiple * resolution
    return value
