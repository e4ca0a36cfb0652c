"""Our side: all methods with the paper's defaults, from plain arrays, conversions timed."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any

from cgroup.registry import METHOD_INFO, MethodInfo
from peers.catalogue import OURS

if TYPE_CHECKING:
    from peers.answers import Answer, Call, Make
    from peers.cases import Case

NAMES = {
    "source": "src",
    "target": "tgt",
    "source_lrf": "lrf_src",
    "target_lrf": "lrf_tgt",
    "similarity": "sim",
    "ratio": "ratio",
}
"""Fields of correspondences, and what a case calls them."""


def _make(info: MethodInfo) -> Make:
    taken = inspect.signature(info.function).parameters
    unit = {"resolution": 1.0} if "resolution" in taken else {}

    def make(case: Case, threads: int) -> Call:
        given: dict[str, Any] = {name: case[NAMES[name]].astype(float) for name in info.fields}

        def call() -> Answer:
            return info.function(**given, **unit, threads=threads).mask, None

        return call

    return make


PEERS: dict[str, Make] = {f"{OURS}{name}": _make(info) for name, info in METHOD_INFO.items()}
