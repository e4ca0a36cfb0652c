"""Turn the records into report.md and two figures: ``python -m peers.report out/peers``."""

from __future__ import annotations

import sys
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from peers.catalogue import OURS, PEERS, Peer
from peers.environment import TITLES, needs
from peers.figures import is_ours, scaling_figure
from peers.records import Figures, Journal, Run, summaries
from peers.scaling import LEAST_MIB, Quantity, common_share, curves

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

NOTHING = "-"
PREAMBLE = """# cgroup and its peers

Medians over the rounds of the median time of a call. F is the F-score at 5 pr. Memory is the peak of the
process above what it held before the call. *Times ours* is how many times longer a peer takes than cgroup's
method on the same number of threads. Peers without threads run on one, and their figures stand for any
number. PCL, Open3D, GC-RANSAC and KISS-Matcher end with a fit of the pose, so that their F is not the
grouping's alone. *Differs* counts the matches on which a peer's mask is not that of cgroup's method.
"""

FAILURES = {"time": "too long", "memory": "too much memory", "error": "failed"}
FIGURES: dict[Quantity, str] = {"seconds": "time", "mib": "memory"}


def write_report(journal: Journal, out: Path) -> None:
    """Write report.md and the figures beside the records."""
    works = summaries(journal)
    out.mkdir(parents=True, exist_ok=True)
    (out / "report.md").write_text(report(journal, works), encoding="utf-8")
    counts = thread_counts(works)
    for quantity, name in FIGURES.items():
        least, most = (counts[0], counts[-1]) if counts else (1, 1)
        more = curves(works, quantity, most) if most > least else {}
        figure = scaling_figure(
            curves(works, quantity, least),
            {peer: curve for peer, curve in more.items() if is_ours(peer)},
            quantity=quantity,
            share=common_share(works),
        )
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # laying out takes long, and is done
        for ending in ("png", "pdf"):
            figure.savefig(out / f"{name}.{ending}")


def report(journal: Journal, works: Mapping[Run, Figures]) -> str:
    """Put the whole report together."""
    parts = [
        PREAMBLE,
        *machine(journal),
        "## Growth\n",
        *growth(works),
        "![time](time.png)\n",
        "![memory](memory.png)\n",
        *(line for case in case_keys(works) for line in case_table(works, *case)),
        *equality(works),
        *failures(works),
        *not_run(journal, works),
    ]
    return "\n".join(parts)


def machine(journal: Journal) -> Iterator[str]:
    """Machine, versions, and what is missing."""
    if not journal.sessions:
        yield "No session is recorded.\n"
        return
    session = journal.sessions[-1]
    identity = session["identity"]
    yield "## Machine\n"
    yield f"- {identity['cpu']}, {identity['cores']} cores"
    yield f"- {session['system']}, Python {session['python']}"
    yield f"- load at the start: {session['load']:.2f}{_others(journal)}{_spread(journal)}"
    versions: dict[str, str] = {}
    for each in journal.sessions:
        versions |= each["versions"]
    listed = ", ".join(f"{name} {version}" for name, version in sorted(versions.items()))
    yield f"- {listed} (build {identity['build']})"
    for name, why in session["missing"].items():
        yield f"- not available: {TITLES.get(name, 'PCL')}: {why}"
    yield ""


def _others(journal: Journal) -> str:
    """Say what else the machine did meanwhile."""
    busy = [record["others"] for record in journal.runs.values() if record.get("others") is not None]
    if not busy:
        return ""
    return f"; other programs used {median(busy):.2f} cores during half of the runs, {max(busy):.2f} at most"


def _spread(journal: Journal) -> str:
    """Say how far rounds differ."""
    spreads = [figures.spread for figures in summaries(journal).values() if figures.rounds > 1]
    if not spreads:
        return ""
    return f"; slowest and fastest round differ by {median(spreads):.0%} in the median"


def growth(works: Mapping[Run, Figures]) -> Iterator[str]:
    """Exponents of ours."""
    counts = thread_counts(works)
    yield f"Least-squares exponents over n ≥ 2,000 at {common_share(works):.0%} inliers.\n"
    yield from _header(
        ("method",), [f"{name}, {_threads(count)}" for name in FIGURES.values() for count in counts]
    )
    for peer in filter(lambda peer: is_ours(peer.name), PEERS.values()):
        cells = [peer.label]
        for quantity in FIGURES:
            for count in counts:
                curve = curves(works, quantity, count).get(peer.name)
                least = LEAST_MIB if quantity == "mib" else 0.0
                value = np.nan if curve is None else curve.exponent(least=least)
                cells.append(NOTHING if np.isnan(value) else f"{value:.2f}")
        yield _row(cells)
    yield ""


def case_keys(works: Mapping[Run, Figures]) -> list[tuple[int, float]]:
    """Sizes and shares of inliers that there is anything of."""
    return sorted({(work.n, work.share) for work in works}, key=lambda case: (case[0], -case[1]))


def case_table(works: Mapping[Run, Figures], n: int, share: float) -> Iterator[str]:
    """All peers on one case."""
    counts = thread_counts(works)
    yield f"## n = {n:,}, {share:.0%} inliers\n"
    names = ("ms", "times ours", "MiB")
    yield from _header(
        ("", "F", "differs"), [f"{name}, {_threads(count)}" for count in counts for name in names]
    )
    for peer in PEERS.values():
        found = [find(works, peer, n, share, count) for count in counts]
        if all(figures is None for figures in found):
            continue
        measured = next((figures for figures in found if figures and figures.f is not None), None)
        cells = [
            f"**{peer.label}**" if is_ours(peer.name) else peer.label,
            NOTHING if measured is None else f"{measured.f:.2f}",
            _difference(measured),
        ]
        for count, figures in zip(counts, found, strict=True):
            ours = find(works, PEERS[OURS + peer.method], n, share, count)
            cells += [_time(figures), "" if is_ours(peer.name) else _ratio(figures, ours), _memory(figures)]
        yield _row(cells)
    yield ""


def equality(works: Mapping[Run, Figures]) -> Iterator[str]:
    """Whether the masks of each peer are ours, and why not."""
    rows = []
    for peer in PEERS.values():
        known = {
            (work.n, work.share): figures.differs
            for work, figures in works.items()
            if work.peer == peer.name and figures.differs is not None
        }
        equal = list(known.values()).count(0)
        if known:
            note = peer.note if equal < len(known) else ""
            rows.append(_row([peer.label, f"in {equal} of {len(known)} cases", note]))
    if rows:
        yield "## Masks equal ours\n"
        yield from _header(("peer", "equal", "if not, why"), ())
        yield from (*rows, "")


def failures(works: Mapping[Run, Figures]) -> Iterator[str]:
    """List what did not finish."""
    failed = [(work, figures) for work, figures in works.items() if figures.failed]
    if failed:
        yield "## Without a result\n"
        for work, figures in failed:
            peer = PEERS[work.peer]
            where = f"n = {work.n:,}, {work.share:.0%} inliers, {_threads(work.threads)}"
            yield f"- {peer.label}, {where}: {figures.why}"
        yield ""


def not_run(journal: Journal, works: Mapping[Run, Figures]) -> Iterator[str]:
    """List the peers that there are no records of."""
    missing = journal.sessions[-1]["missing"] if journal.sessions else {}
    absent = [peer for peer in PEERS.values() if all(work.peer != peer.name for work in works)]
    if absent:
        yield "## Not run\n"
        for peer in absent:
            why = missing.get(needs(peer))
            yield f"- {peer.label}: {'not asked for, or not yet' if why is None else f'not available: {why}'}"
        yield ""


def thread_counts(works: Mapping[Run, Figures]) -> list[int]:
    """Numbers of threads that there are records of."""
    return sorted({work.threads for work in works})


def find(works: Mapping[Run, Figures], peer: Peer, n: int, share: float, threads: int) -> Figures | None:
    """Figures of a peer on a case; for one without threads, those of any number."""
    for count in [threads] if peer.threaded else thread_counts(works):
        figures = works.get(Run(peer.name, n, share, count, 0))
        if figures is not None:
            return figures
    return None


def _time(figures: Figures | None) -> str:
    if figures is None:
        return NOTHING
    if figures.seconds is None:
        return FAILURES[figures.failed]
    return _digits(figures.seconds * 1000)


def _memory(figures: Figures | None) -> str:
    return NOTHING if figures is None or figures.mib is None else f"{figures.mib:,.1f}"


def _difference(measured: Figures | None) -> str:
    if measured is None:
        return NOTHING
    return "" if measured.differs is None else f"{measured.differs:,}"


def _ratio(peer: Figures | None, ours: Figures | None) -> str:
    if peer is None or ours is None or peer.seconds is None or ours.seconds is None:
        return NOTHING
    return f"{_digits(peer.seconds / ours.seconds)} x"


def _digits(value: float) -> str:
    """Three significant digits, without an exponent."""
    places = max(0, 2 - int(np.floor(np.log10(value)))) if value > 0 else 0
    return f"{value:,.{places}f}"


def _threads(count: int) -> str:
    return "1 thread" if count == 1 else f"{count} threads"


def _header(words: Sequence[str], numbers: Sequence[str]) -> Iterator[str]:
    yield _row([*words, *numbers])
    yield "|" + "---|" * len(words) + "---:|" * len(numbers)


def _row(cells: Sequence[Any]) -> str:
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    write_report(Journal(folder / "results.jsonl"), folder)
