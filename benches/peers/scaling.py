"""Time and memory of each peer over n, and the exponents of power laws fitted to them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from cgroup.benchmark.solving import fit_exponent
from cgroup.benchmark.tables import FITTED_FROM
from peers.catalogue import COMMON_SHARE, PEERS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from peers.records import Figures, Run

Quantity: TypeAlias = Literal["seconds", "mib"]

LEAST_SIZES = 3
LEAST_MIB = 1.0
"""Less memory than this is noise of the allocator."""


@dataclass(frozen=True)
class Curve:
    """One quantity of one peer over n, ascending."""

    peer: str
    threads: int
    sizes: tuple[int, ...]
    values: tuple[float, ...]

    def exponent(self, *, least: float = 0.0) -> float:
        """Least-squares exponent over n >= 2000, of values above `least`; NaN with fewer than three."""
        points = [
            (n, value)
            for n, value in zip(self.sizes, self.values, strict=True)
            if n >= FITTED_FROM and value > least
        ]
        if len(points) < LEAST_SIZES:
            return float("nan")
        return round(fit_exponent(*zip(*points, strict=True)), 3) + 0.0  # no negative zero


def curves(works: Mapping[Run, Figures], quantity: Quantity, threads: int) -> dict[str, Curve]:
    """Curves of all peers at the common share of inliers; peers without threads have one for each number."""
    share = common_share(works)
    found = {}
    for peer in PEERS.values():
        points = sorted(
            (work.n, value)
            for work, figures in works.items()
            if work.peer == peer.name
            and work.share == share
            and (work.threads == threads or not peer.threaded)
            and (value := getattr(figures, quantity)) is not None
        )
        if points:
            sizes, values = zip(*points, strict=True)
            found[peer.name] = Curve(peer.name, threads, sizes, values)
    return found


def common_share(works: Mapping[Run, Figures]) -> float:
    """Share of inliers that stands at the most sizes, one in ten if it is among them."""
    sizes: dict[float, set[int]] = {}
    for work in works:
        sizes.setdefault(work.share, set()).add(work.n)
    return max(sizes, key=lambda share: (len(sizes[share]), share == COMMON_SHARE), default=COMMON_SHARE)
