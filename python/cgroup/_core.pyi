"""Types of the compiled core."""

from typing import Any, Literal, TypeAlias

from cgroup.types import BoolArray, Correspondences, FloatArray, RunOptions

RawGrouping: TypeAlias = tuple[BoolArray, FloatArray | None, float | None, FloatArray | None, dict[str, float]]

__version__: str
DEBUG_BUILD: bool

def ss(
    similarity: FloatArray, threshold: float | Literal["otsu"], otsu: str, bins: int
) -> RawGrouping: ...
def nnsr(ratio: FloatArray, max_ratio: float) -> RawGrouping: ...
def si(fields: Correspondences, run_options: RunOptions, **options: Any) -> RawGrouping: ...
