"""What was measured, one JSON object per line, written as it comes, so that a run can be ended and go on."""

from __future__ import annotations

import json
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


class Run(NamedTuple):
    """One process: a peer on a case with a number of threads."""

    peer: str
    n: int
    share: float
    threads: int
    round: int

    @property
    def same_work(self) -> Run:
        """The same in the first round."""
        return self._replace(round=0)


class Journal:
    """The file of records, and what it holds."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.sessions: list[dict[str, Any]] = []
        self.runs: dict[Run, dict[str, Any]] = {}
        complete = True
        if path.exists():
            text = path.read_text(encoding="utf-8")
            complete = not text or text.endswith("\n")
            for line in text.splitlines():
                self._take(line)
        self._start = "" if complete else "\n"

    def _take(self, line: str) -> None:
        try:
            record = json.loads(line)
        except json.JSONDecodeError:
            return  # cut off when the run was ended
        if "session" in record:
            self.sessions.append(record["session"])
        else:
            self.runs[Run(*(record[name] for name in Run._fields))] = record

    def add_session(self, session: dict[str, Any]) -> None:
        """Note who was there, on which machine."""
        self.sessions.append(session)
        self._write({"session": session})

    def add(self, run: Run, record: dict[str, Any]) -> None:
        """Note one run."""
        record = {**run._asdict(), **record}
        self.runs[run] = record
        self._write(record)

    def _write(self, record: dict[str, Any]) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(f"{self._start}{json.dumps(record)}\n")
        self._start = ""


@dataclass(frozen=True)
class Figures:
    """What the rounds of one peer on one case amount to.

    Attributes
    ----------
    seconds, mib : float or None
        Medians over the rounds; memory is the peak of the process above what it held before the call.
    f : float or None
        F-score at 5 pr.
    differs : int or None
        Matches on which the mask is not ours; None for ours.
    rounds : int
        Number of rounds with a result.
    spread : float
        Slowest round minus fastest, over the median.
    failed, why : str
        "time", "memory" or "error" where there is no result, and what happened.
    """

    seconds: float | None
    mib: float | None
    f: float | None
    differs: int | None = None
    rounds: int = 0
    spread: float = 0.0
    failed: str = ""
    why: str = ""


def summary(records: Iterable[dict[str, Any]]) -> Figures:
    """Summarise the rounds of one peer on one case."""
    rounds = list(records)
    good = [record for record in rounds if "failed" not in record]
    if not good:
        return Figures(None, None, None, failed=rounds[0]["failed"], why=rounds[0]["why"])
    times = [record["median_s"] for record in good]
    peaks = [
        record["peak_mib"] - record["base_mib"]
        for record in good
        if record["peak_mib"] is not None and record["base_mib"] is not None
    ]
    seconds = median(times)
    spread = (max(times) - min(times)) / seconds
    return Figures(
        seconds, median(peaks) if peaks else None, good[0]["f"], good[0]["differs"], len(good), spread
    )


def summaries(journal: Journal) -> dict[Run, Figures]:
    """Summarise all rounds; keys are the runs of the first round."""
    together: dict[Run, list[dict[str, Any]]] = {}
    for run, record in sorted(journal.runs.items()):
        together.setdefault(run.same_work, []).append(record)
    return {work: summary(records) for work, records in together.items()}
