"""The machine that makes results."""

from __future__ import annotations

import functools
import hashlib
import json
import os
import platform
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np


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
        """Short name, the same for machines that are alike."""
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
