"""Results of solvers and matches of problems, and arrays of both as bytes."""

import functools
import hashlib
import io
import json
import os
import platform
import zipfile
from dataclasses import asdict, dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from cgroup import __version__
from cgroup.benchmark.problem import Problem
from cgroup.benchmark.solver import Solver
from cgroup.types import OPTIONAL_FIELDS, Correspondences, FloatArray, RealArray

# Error of a task that ended its process
KILLED = "WorkerKilled: the process that worked on it died, perhaps out of memory"
OUT_OF_TIME = "OutOfTime"  # first word of the error of a solver that exceeded its limit
# Errors of a pose: in degrees, in the data's unit, and the mean displacement over the overlap in pr
ERRORS = ("rotation_error", "translation_error", "rmse_pr")


@dataclass(frozen=True)
class Machine:
    """Hardware and software that determine the speed."""

    cpu: str
    cores: int
    system: str
    python: str
    numpy: str

    @property
    def id(self) -> str:
        """Short name, the same for equal machines."""
        return hashlib.sha256(json.dumps(asdict(self)).encode()).hexdigest()[:12]


@functools.cache
def this_machine() -> Machine:
    """Describe the machine that this process runs on."""
    return Machine(
        _cpu(), os.cpu_count() or 1, platform.platform(), platform.python_version(), np.__version__
    )


def _cpu() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


@dataclass(frozen=True, eq=False)
class Matched:
    """Matches of a problem, and the truth about them.

    `truth` is the true pose, if there is one; `sample` are source points in the overlap. `pr` is the unit of
    the errors, in the data's unit. `facts` are overlap, clutter and occlusion, as far as known.
    """

    matches: Correspondences
    truth: FloatArray | None
    sample: RealArray
    pr: float
    facts: dict[str, float]


@dataclass(frozen=True)
class Result:
    """Result of a solver on a problem, both named by their keys.

    `threads` is 0 for all cores. Groups are scored at `epsilons`. `limit` and `seconds` are those of the
    solver. `mask` has one bit per match, `pose` 16 float64. `numbers` are further ones as JSON.
    `skipped` is the reason why the solver did not run to its end. The store keeps the fields in this order.
    """

    problem: str
    solver: str
    threads: int = 1
    epsilons: str = "[]"
    limit: float | None = None
    seconds: float | None = None
    mask: bytes | None = None
    pose: bytes | None = None
    numbers: str = "{}"
    skipped: str = ""
    error: str = ""
    version: str = __version__
    machine: Machine = field(default_factory=this_machine)
    created: str = field(default_factory=lambda: datetime.now(timezone.utc).isoformat(timespec="seconds"))


@dataclass(frozen=True)
class Pending:
    """A problem, and the solvers without a result for it.

    `entry` numbers the set in the plan. `limit` are seconds after which a solver is stopped.
    """

    problem: Problem
    solvers: tuple[Solver, ...]
    threads: int
    epsilons: tuple[float, ...]
    limit: float
    entry: int = 0

    def result(self, solver: Solver, **fields: Any) -> Result:  # noqa: ANN401 - of a result
        """Make the result of a solver."""
        epsilons = json.dumps(self.epsilons)
        return Result(self.problem.key, solver.key, self.threads, epsilons, self.limit, **fields)

    def fail(self, error: str) -> list[Result]:
        """Make results of all solvers with the same error."""
        return [self.result(each, error=error) for each in self.solvers]


def describe_error(error: Exception) -> str:
    """Return type and message in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def none_unless_finite(value: float) -> float | None:
    """Return the number, or None for NaN and infinity, which JSON does not have."""
    return float(value) if np.isfinite(value) else None


def pack(matched: Matched) -> bytes:
    """Return matches as the bytes of an NPZ file; equal numbers give equal bytes."""
    arrays = {name: getattr(matched.matches, name) for name in ("source", "target", *OPTIONAL_FIELDS)}
    arrays |= {"_truth": matched.truth, "_sample": matched.sample, "_pr": matched.pr}
    arrays |= {f"_facts_{name}": value for name, value in matched.facts.items()}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, value in arrays.items():
            if value is not None:
                # An entry without a date of its own would contain the current time.
                with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w") as entry:
                    np.lib.format.write_array(entry, np.asarray(value, dtype=np.float64))
    return buffer.getvalue()


def unpack(content: bytes) -> Matched:
    """Return the matches from the bytes of `pack`."""
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        fields: dict[str, Any] = {name: archive[name] for name in archive.files}
    facts = {
        name.removeprefix("_facts_"): float(fields.pop(name))
        for name in list(fields)
        if name.startswith("_facts_")
    }
    truth, sample, pr = fields.pop("_truth", None), fields.pop("_sample"), float(fields.pop("_pr"))
    if "resolution" in fields:
        fields["resolution"] = float(fields["resolution"])
    matches = Correspondences(fields.pop("source"), fields.pop("target"), **fields)
    return Matched(matches, truth, sample, pr, facts)
