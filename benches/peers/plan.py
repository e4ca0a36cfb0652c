"""Which runs there are, in which order, and which of them are left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cgroup.benchmark.solving import fit_exponent
from peers.catalogue import COMMON_SHARE, PEERS, Peer
from peers.records import Run

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

SIZES = (500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000)
QUICK_SIZES = (500, 1000)
SHARES = (0.5, 0.1, 0.03, 0.01)
SIZE_OF_ALL_SHARES = 5000

SLOW = 2.0
"""Seconds per call above which one round is enough."""


@dataclass(frozen=True)
class Settings:
    """What the command line asks for.

    Attributes
    ----------
    sizes : tuple of int
        Numbers of matches n.
    shares : tuple of float
        Shares of inliers; if empty, all of them at n = 5000 and one in ten elsewhere.
    threads : tuple of int
        Numbers of threads.
    rounds : int
        How often all peers of a case are run in turn.
    seconds, mib : float
        Limits of one run.
    """

    sizes: tuple[int, ...] = SIZES
    shares: tuple[float, ...] = ()
    threads: tuple[int, ...] = (1, 2)
    rounds: int = 3
    seconds: float = 120.0
    mib: float = 8192.0


def plan(settings: Settings, peers: Sequence[Peer]) -> Iterator[Run]:
    """Yield all runs: within a case, round after round, so that a machine's mood hits all peers alike."""
    for n, share in cases(settings):
        for number in range(settings.rounds):
            runs = [
                Run(peer.name, n, share, threads, number)
                for peer in peers
                if n <= peer.largest and (share == COMMON_SHARE or not peer.common_share_only)
                for threads in (settings.threads if peer.threaded else settings.threads[:1])
            ]
            yield from runs if number % 2 == 0 else reversed(runs)


def cases(settings: Settings) -> Iterator[tuple[int, float]]:
    """Yield sizes and shares of inliers, small cases first."""
    for n in sorted(settings.sizes):
        default = SHARES if n == SIZE_OF_ALL_SHARES else (COMMON_SHARE,)
        for share in settings.shares or default:
            yield n, share


def is_settled(run: Run, done: Mapping[Run, dict[str, Any]]) -> bool:
    """Tell whether a run adds nothing: it is recorded, or an earlier round was slow or failed."""
    earlier = (done.get(run._replace(round=number)) for number in range(run.round))
    return run in done or any(
        "failed" in record or record["median_s"] > SLOW for record in earlier if record is not None
    )


def hopeless(run: Run, done: Mapping[Run, dict[str, Any]], settings: Settings) -> dict[str, str] | None:
    """Why a run is not even started, as its record: it can't fit, or takes too long by what fewer took."""
    expected = PEERS[run.peer].bytes_per_pair * run.n**2 / 2**20
    if expected > settings.mib:
        return {"failed": "memory", "why": f"not run: would take {expected / 1024:.0f} GiB"}
    for other, record in done.items():
        if (
            (other.peer, other.threads) == (run.peer, run.threads)
            and other.n < run.n
            and record.get("failed") in {"time", "memory"}
        ):
            return {"failed": record["failed"], "why": f"not run: n = {other.n:,} was too much already"}
    expected = extrapolated(run, done)
    if expected > settings.seconds:
        return {"failed": "time", "why": f"not run: would take some {expected:,.0f} s"}
    return None


def extrapolated(run: Run, done: Mapping[Run, dict[str, Any]]) -> float:
    """Seconds to expect from a power law through the two next smaller sizes; 0 without them."""
    smaller = sorted(
        (other.n, record["median_s"])
        for other, record in done.items()
        if other._replace(n=run.n) == run.same_work and other.n < run.n and "failed" not in record
    )
    if len(smaller) < 2:
        return 0.0
    sizes, seconds = zip(*smaller[-2:], strict=True)
    return seconds[-1] * (run.n / sizes[-1]) ** fit_exponent(sizes, seconds)
