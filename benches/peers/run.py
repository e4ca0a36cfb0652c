"""Run cgroup and its peers on the same cases, then write the report: ``python -m peers.run --help``."""

from __future__ import annotations

import functools
import json
import os
import signal
import subprocess
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import IO, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from peers import cgroup_peers
from peers import plan as planning
from peers.answers import judge, unpack
from peers.cases import Mask, ensure_case, load_case
from peers.catalogue import OURS, PEERS, Peer, selected
from peers.environment import BENCHES, Environment, child_environment, describe, prepare
from peers.measure import MARK
from peers.records import Journal, Run
from peers.report import write_report

ROOT = BENCHES.parent
PCL_BUILD = ROOT / "target" / "pcl-peers"
FIRST_WAIT, LATER_WAIT = 0.02, 0.2
SHORT = 2.0
"""Seconds after which a run is looked at less often."""

STOPPED = 130

console = Console(highlight=False, soft_wrap=True)
app = typer.Typer(add_completion=False)


@app.command()
def main(
    out: Annotated[Path, typer.Option(help="Folder of cases, records, report and figures.")] = Path(
        "out/peers"
    ),
    n: Annotated[list[str] | None, typer.Option("--n", help="Numbers of matches: 500,1000.")] = None,
    ratio: Annotated[list[str] | None, typer.Option(help="Shares of inliers: 0.5,0.1.")] = None,
    peers: Annotated[list[str] | None, typer.Option(help="Names or patterns: 'pcl_*,cgroup_gc'.")] = None,
    threads: Annotated[list[str] | None, typer.Option(help="Numbers of threads; 1,2 if not given.")] = None,
    rounds: Annotated[int | None, typer.Option(min=1, help="Rounds; 3 if not given, 1 if quick.")] = None,
    time_limit: Annotated[float, typer.Option(help="Seconds that one run may take.")] = 120.0,
    memory_limit: Annotated[float, typer.Option(help="GiB that one run may take.")] = 8.0,
    venv: Annotated[Path, typer.Option(help="Environment of the libraries.")] = ROOT / ".venv-peers",
    *,
    quick: Annotated[bool, typer.Option("--quick", help="n = 500 and 1000 in one round.")] = False,
    fresh: Annotated[bool, typer.Option("--fresh", help="Forget the records in the folder.")] = False,
) -> None:
    """Run what is not recorded yet, and write report.md, time.png and memory.png."""
    settings = planning.Settings(
        sizes=tuple(map(int, split(n))) or (planning.QUICK_SIZES if quick else planning.SIZES),
        shares=tuple(map(float, split(ratio))),
        threads=tuple(map(int, split(threads))) or (1, 2),
        rounds=rounds or (1 if quick else 3),
        seconds=time_limit,
        mib=memory_limit * 1024,
    )
    wanted = selected(split(peers))
    if not wanted:
        console.print(f"No such peer; there are {', '.join(PEERS)}.")
        raise typer.Exit(2)
    path = out / "results.jsonl"
    if fresh:
        path.unlink(missing_ok=True)
    environment = prepare(wanted, venv=venv, build=PCL_BUILD, say=console.print)
    journal = Journal(path)
    session = describe(environment)
    if journal.sessions and journal.sessions[-1]["identity"] != session["identity"]:
        console.print(f"{path} comes from another machine or build: add --fresh, or give another --out.")
        raise typer.Exit(2)
    journal.add_session(session)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends the measuring process too
    try:
        run_all(
            settings, [peer for peer in wanted if not environment.why_missing(peer)], environment, journal
        )
    except KeyboardInterrupt:
        console.print("Stopped; the same command goes on from here.")
        raise typer.Exit(STOPPED) from None
    finally:
        write_report(journal, out)
    console.print(f"Written: {out / 'report.md'}, {out / 'time.png'}, {out / 'memory.png'}")


def split(values: list[str] | None) -> list[str]:
    """Take an option's values apart, which may be given by commas or by repeating the option."""
    return [part for value in values or () for part in value.replace(",", " ").split()]


def run_all(
    settings: planning.Settings, peers: list[Peer], environment: Environment, journal: Journal
) -> None:
    """Run what is left of the plan, with a progress bar."""
    runs = list(planning.plan(settings, peers))
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("", total=len(runs))
        for run in runs:
            progress.update(task, description=f"{run.peer:20} n = {run.n:6,} {run.share:4.0%} x{run.threads}")
            run_next(run, settings, environment, journal)
            progress.advance(task)


def run_next(run: Run, settings: planning.Settings, environment: Environment, journal: Journal) -> None:
    """Measure and record one run, unless there is no need or no hope."""
    if planning.is_settled(run, journal.runs):
        return
    record = planning.hopeless(run, journal.runs, settings)
    if record is None:
        case = ensure_case(journal.path.parent / "cases", run.n, run.share)
        command = environment.command(PEERS[run.peer], case, run.threads)
        record = run_process(
            command, child_environment(run.threads), seconds=settings.seconds, mib=settings.mib
        )
        if "failed" not in record:
            record = assess(record, PEERS[run.peer], case)
    journal.add(run, record)


def assess(record: dict[str, Any], peer: Peer, path: Path) -> dict[str, Any]:
    """Judge the mask of a record, in whose place its quality and its difference from ours stand."""
    case = load_case(path)
    ours = None if peer.program == "cgroup" else our_mask(peer.method, path)
    mask = unpack(record.pop("mask"), len(case["gt"]))
    return record | {"median_s": round(median(record["times_s"]), 7), **judge(case, mask, ours)}


@functools.cache
def our_mask(method: str, path: Path) -> Mask:
    """Return the mask of our method on a case."""
    mask, _ = cgroup_peers.PEERS[OURS + method](load_case(path), os.cpu_count() or 1)()
    return mask


def run_process(
    command: list[str], environment: dict[str, str], *, seconds: float, mib: float
) -> dict[str, Any]:
    """Run a measuring process within limits of time and memory; its record, or why there is none."""
    busy, own, start = _busy(), _own(), time.monotonic()
    with (
        tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as output,
        tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors,
    ):
        process = subprocess.Popen(
            command, env=environment, stdout=output, stderr=errors, start_new_session=True
        )
        try:
            failure = _watch(process, seconds, mib)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        wall = time.monotonic() - start
        record = failure or _record(output) or _crash(process, errors)
    others = None if busy is None else (_busy() - busy - (_own() - own)) / wall
    return record | {"others": None if others is None else round(max(0.0, others), 2)}


def _watch(process: subprocess.Popen[bytes], seconds: float, mib: float) -> dict[str, str] | None:
    """Wait for a process; what limit it broke, if any."""
    start = time.monotonic()
    while True:
        spent = time.monotonic() - start
        try:
            process.wait(FIRST_WAIT if spent < SHORT else LATER_WAIT)
        except subprocess.TimeoutExpired:
            if spent > seconds:
                return {"failed": "time", "why": f"took more than {seconds:.0f} s"}
            if _resident_mib(process.pid) > mib:
                return {"failed": "memory", "why": f"took more than {mib / 1024:.3g} GiB"}
        else:
            return None


def _record(output: IO[str]) -> dict[str, Any] | None:
    output.seek(0)
    lines = [line for line in output.read().splitlines() if line.startswith(MARK)]
    return json.loads(lines[-1].removeprefix(MARK)) if lines else None


def _crash(process: subprocess.Popen[bytes], errors: IO[str]) -> dict[str, str]:
    errors.seek(0)
    lines = errors.read().strip().splitlines() or ["no message"]
    return {"failed": "error", "why": f"exit code {process.returncode}: {lines[-1][:200]}"}


def _resident_mib(pid: int) -> float:
    """Resident memory, 0 where the system does not tell."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def _busy() -> float | None:
    """Seconds that all processors together were busy, None where the system does not tell."""
    try:
        ticks = [int(value) for value in Path("/proc/stat").read_text(encoding="ascii").split()[1:9]]
    except OSError:
        return None
    idle, waiting = 3, 4
    return (sum(ticks) - ticks[idle] - ticks[waiting]) / os.sysconf("SC_CLK_TCK")


def _own() -> float:
    """Seconds of processor time of this process and of those it has started."""
    return sum(os.times()[:4])


if __name__ == "__main__":
    app()
