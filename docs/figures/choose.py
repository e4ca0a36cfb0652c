"""Measure the numbers of the README and the pages.

Each command rewrites files of ``measured/``, and the tables of README:

``measure``               all methods on generated matches (choose.toml, some minutes), and options
                          (`method_figures.sweeps`, half a minute);
``order``                 which methods depend on the order of the matches (a minute);
``clouds``                how long `register` takes on clouds of millions of points (half a minute);
``registration FOLDER``   takes the records of ``cgroup benchmark run registration``;
``trust FOLDER``          takes the records of ``cgroup benchmark run trust``;
``matches FOLDER``        takes the records of ``cgroup benchmark run matches``;
``peers FOLDER``          takes the records of ``make bench-peers``.

``write`` only writes the tables. ``check`` names the files whose code has changed since they were measured.
``verify`` measures one value of each method again and compares it with the file.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import pandas as pd

from cgroup.benchmark.config import read_config
from cgroup.benchmark.report.cells import method_cell
from cgroup.benchmark.report.pipelines import answer_table, calibration_table, trust_table
from cgroup.benchmark.report.trials import overview_table, with_fewest_threads
from cgroup.benchmark.run import run
from cgroup.benchmark.tables import load
from cgroup.registry import METHOD_INFO
from method_figures.measure_clouds import measure_clouds
from method_figures.measure_options import COLUMNS, list_changed, measure_all
from method_figures.measure_order import measure_order
from method_figures.measured import FOLDER, METHODS_CSV, OPTIONS_CSV, ROOT, load_origin, save
from method_figures.tables import write_tables

sys.path.insert(0, str(ROOT / "benches"))

from peers.records import Journal, summaries
from peers.report import NOTHING, case_table, growth

if TYPE_CHECKING:
    from collections.abc import Iterable

    from cgroup.benchmark.report.cells import Table

CONFIG = Path(__file__).with_suffix(".toml")
GROUPING = ("rust/core/grouping", "python/cgroup/methods")
REGISTRATION = (
    "rust/core",
    "python/cgroup/fronts",
    "python/cgroup/registration",
    "python/cgroup/verification",
    "python/cgroup/features",
)
PEERS_CASES = {"peers-5000": (5000, (0.03, 0.1)), "peers-100000": (100_000, (0.1,))}
MATCHES = {
    "generated": ("size", "noise", "kinds of wrong matches", "frames", "100,000 matches"),
    "fpfh": (
        *(f"range views, {kind}" for kind in ("nearest", "mutual", "three nearest")),
        *("rooms, nearest", "rooms, mutual", "LiDAR, nearest"),
    ),
    "keypoints": (
        *("range views, H3D+SHOT", "range views, ISS+RCS"),
        *("objects in clutter, H3D+SHOT", "whole models, H3D+SHOT"),
    ),
    "ready-made": (
        *("FGR's features", "others' matches of rooms", "others' matches of LiDAR scans"),
        "one-to-three",
    ),
}
TIMED, LEAST_F = "rooms, nearest", 0.3
"""The set whose times are shown, and the methods: from this F on."""

_MEASURE = "python docs/figures/choose.py measure"
_KIND = ["set", "scene", "n", "inliers", "noise", "frames", "method"]


def measure_methods(folder: Path | None = None) -> None:
    """Run all methods on generated matches and keep the means of each kind of problem.

    Records are kept in `folder`, if one is given: a run that was ended goes on there.
    """
    with tempfile.TemporaryDirectory() as scratch:
        run(read_config(CONFIG), folder or Path(scratch))
        frame = load(folder or Path(scratch), "matches")
    frame = frame[~frame["skipped"].str.startswith("needs ")]
    recipe = {name: frame[name].fillna(0) for name in ("inliers", "noise")}
    frame = frame.assign(milliseconds=1e3 * frame["seconds"], n=frame["size"].fillna(0).astype(int), **recipe)
    for column in ("precision", "recall", "f_score"):
        frame[column] = frame[column].fillna(0.0)
    groups = frame.groupby(_KIND, sort=True, dropna=False)
    table = groups[["precision", "recall", "f_score", "right"]].mean().round(4)
    table["problems"] = groups.size()
    table["milliseconds"] = groups["milliseconds"].median().round(4)
    table["mebibytes"] = groups["mebibytes"].median().round(3)
    code = (*GROUPING, "python/cgroup/datasets/generated_matches.py")
    save(METHODS_CSV, _MEASURE, code, table.reset_index(), "one thread")


def measure_options() -> None:
    """Measure all options."""
    table = pd.DataFrame(measure_all(), columns=list(COLUMNS))
    save(OPTIONS_CSV, _MEASURE, GROUPING, table, "one thread")


def record_registration(folder: Path) -> None:
    """Write what a run of the preset `registration` found."""
    frame = _load_registrations(folder)
    _save_shown("registration-answers", answer_table(frame[frame["kind"] == "related"]), "registration")
    _save_shown("registration-trust", trust_table(frame), "registration")


def record_trust(folder: Path) -> None:
    """Write what a run of the preset `trust` found."""
    _save_shown("trust", calibration_table(_load_registrations(folder)), "trust")


def record_matches(folder: Path) -> None:
    """Write what a run of the preset `matches` found."""
    command, how = "cgroup benchmark run matches", "one thread"
    frame = load(folder, "matches")
    overview = overview_table(frame)
    rows = [[_strip(cell.text) for cell in row] for row in overview.rows]
    bold = [
        [f"**{text}**" if cell.best else text for text, cell in zip(*of_row, strict=True)]
        for of_row in zip(rows, overview.rows, strict=True)
    ]
    shown = pd.DataFrame(bold, columns=list(overview.headers))
    for name, sets in MATCHES.items():
        save(FOLDER / f"matches-{name}.csv", command, GROUPING, shown[["method", *sets]], how)
    timed = with_fewest_threads(frame[(frame["set"] == TIMED) & (frame["kind"] == "related")])
    groups = timed.groupby("method")
    cost = groups[["right", "f_score"]].mean().join(groups[["seconds", "mebibytes"]].median())
    cost = cost[cost["f_score"] >= LEAST_F].sort_values("seconds")
    table = pd.DataFrame(
        {
            "method": [method_cell(method).text for method in cost.index],
            "registered / mean F": [
                _strip(f"{a:.2f} / {b:.2f}") for a, b in zip(cost["right"], cost["f_score"], strict=True)
            ],
            "ms": [f"{1e3 * seconds:.3g}" for seconds in cost["seconds"]],
            "MiB, peak": [f"{mebibytes:.2g}" for mebibytes in cost["mebibytes"]],
        }
    )
    save(FOLDER / "rooms-cost.csv", command, GROUPING, table, how)


def _strip(text: str) -> str:
    """Leave out what shares have in common: the zero before the point, and those of 1."""
    return re.sub(r"0(\.\d\d)", r"\1", text.replace("1.00", "1"))


def _load_registrations(folder: Path) -> pd.DataFrame:
    frame = load(folder, "registration")
    return frame[frame["error"] == ""]


def _save_shown(name: str, table: Table, preset: str) -> None:
    rows = [[f"**{cell.text}**" if cell.best else cell.text for cell in row] for row in table.rows]
    shown = pd.DataFrame(rows, columns=list(table.headers))
    save(FOLDER / f"{name}.csv", f"cgroup benchmark run {preset}", REGISTRATION, shown, "two threads")


def record_peers(folder: Path) -> None:
    """Write what a run of ``make bench-peers`` found, as far as it went."""
    journal = Journal(folder / "results.jsonl")
    works = summaries(journal)
    others = median(record.get("others") or 0.0 for record in journal.runs.values())
    tables = {"growth": _table_of(growth(works))}
    for name, (n, shares) in PEERS_CASES.items():
        cases = [_table_of(case_table(works, n, share)) for share in shares]
        for case, share in zip(cases, shares, strict=True):
            case.insert(0, "right", f"{100 * share:g} %")
        tables[name] = pd.concat(cases)
    for name, table in tables.items():
        numbers = table.columns[table.columns.str.contains("thread")]
        measured = table[(table[numbers] != NOTHING).any(axis="columns")]
        if not measured.empty:
            code = (*GROUPING, "benches/peers")
            save(
                FOLDER / f"{name}.csv",
                "make bench-peers",
                code,
                measured,
                f"{others:.1f} of them at work for others",
            )


def _table_of(lines: Iterable[str]) -> pd.DataFrame:
    """Take a table of the report apart."""
    shown = [line.split("|")[1:-1] for line in "\n".join(lines).splitlines() if line[:1] == "|"]
    header, _, *rows = [[cell.strip() for cell in line] for line in shown]
    return pd.DataFrame(rows, columns=["program", *header[1:]])


RECORDS = {
    "registration": record_registration,
    "trust": record_trust,
    "matches": record_matches,
    "peers": record_peers,
}
"""Functions that take the records of a run, by the names of their commands."""


def list_outdated() -> list[str]:
    """Return a line for each file of measurements whose code has changed since."""
    lines: list[str] = []
    for path in sorted(FOLDER.glob("*.csv")):
        origin = load_origin(path)
        try:
            changes = origin.changes()
        except subprocess.CalledProcessError:
            lines.append(f"{path.stem}: this copy lacks its commit, {origin.commit}")
            continue
        if changes:
            lines.append(
                f"{path.stem}: {len(changes)} files changed since {origin.commit}, such as {changes[0]}; "
                f"measured by: {origin.command}"
            )
    return lines


def main(arguments: list[str]) -> int:
    """Do what is asked for."""
    match arguments:
        case ["measure", *folder] if len(folder) <= 1:
            measure_methods(Path(folder[0]) if folder else None)
            measure_options()
        case ["order"]:
            command = "python docs/figures/choose.py order"
            save(FOLDER / "order.csv", command, GROUPING, measure_order(), "any number of threads")
        case ["clouds"]:
            command = "python docs/figures/choose.py clouds"
            save(FOLDER / "large-clouds.csv", command, REGISTRATION, measure_clouds(), "two threads")
        case [name, folder] if name in RECORDS:
            RECORDS[name](Path(folder))
        case ["write"]:
            pass
        case ["check"]:
            sys.stdout.writelines(f"{line}\n" for line in list_outdated())
            return 0
        case ["verify"]:
            lines = list_changed(info.function.__name__ for info in METHOD_INFO.values())
            sys.stdout.writelines(f"{line}\n" for line in lines)
            return int(bool(lines))
        case _:
            sys.stderr.write(__doc__ or "")
            return 2
    write_tables()
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
