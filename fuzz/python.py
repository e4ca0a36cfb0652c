"""Runs a Python fuzz target under atheris: python fuzz/python.py <target> <libFuzzer's arguments>."""

from __future__ import annotations

import sys
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "python"))

with atheris.instrument_imports(include=["cgroup"]):
    import fuzz_targets

if __name__ == "__main__":
    target = fuzz_targets.TARGETS[sys.argv.pop(1)]
    atheris.Setup(sys.argv, target)
    atheris.Fuzz()
