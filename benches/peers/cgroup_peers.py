"""Our side: the nine methods with the paper's defaults, from plain arrays, conversions timed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cgroup
from peers.catalogue import OURS

if TYPE_CHECKING:
    from peers.answers import Answer, Call, Make
    from peers.cases import Case

POINTS = {"src": "source", "tgt": "target"}
FRAMES = {"lrf_src": "source_lrf", "lrf_tgt": "target_lrf"}
RATIO = {"ratio": "ratio"}

INPUTS = {
    "gc": POINTS,
    "ransac": POINTS,
    "st": POINTS,
    "gtm": POINTS,
    "si": POINTS | FRAMES | RATIO,
    "cv": POINTS | FRAMES | RATIO,
    "hough3d": POINTS | FRAMES,
    "nnsr": RATIO,
    "ss": {"sim": "similarity"},
}
"""Which fields of a case a method takes, and by what name."""

OPTIONS: dict[str, dict[str, Any]] = {
    "gc": {"resolution": 1.0},
    "ransac": {"resolution": 1.0, "iterations": 10_000},
    "gtm": {"iterations": 100},
    "si": {"resolution": 1.0},
    "cv": {"resolution": 1.0},
}


def _make(method: str) -> Make:
    def make(case: Case, threads: int) -> Call:
        function = getattr(cgroup, method)
        given: dict[str, Any] = {name: case[key].astype(float) for key, name in INPUTS[method].items()}
        given |= OPTIONS.get(method, {})

        def call() -> Answer:
            return function(**given, threads=threads).mask, None

        return call

    return make


PEERS: dict[str, Make] = {f"{OURS}{method}": _make(method) for method in INPUTS}
