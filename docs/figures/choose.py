"""Measure what the methods' pages and the chooser tell, and write it into them.

``python docs/figures/choose.py measure`` runs all methods on generated matches (choose.toml, some minutes on
one core) and all options of `method_figures.sweeps` (half a minute), and rewrites ``measured/*.csv``.
``python docs/figures/choose.py write`` makes the tables of the pages from these files.
"""

from __future__ import annotations

import csv
import sys
import tempfile
from datetime import datetime, timezone
from pathlib import Path

import cgroup
from cgroup.benchmark.config import read_config
from cgroup.benchmark.run import run
from cgroup.benchmark.tables import load
from method_figures.measure_options import COLUMNS, measure_all
from method_figures.measured import METHODS_CSV, OPTIONS_CSV
from method_figures.tables import write_tables

CONFIG = Path(__file__).with_suffix(".toml")
_KIND = ["set", "scene", "n", "inliers", "noise", "frames", "method"]


def measure_methods(folder: Path | None = None) -> None:
    """Run the configuration, unless a folder holds its records, and write means by kind of problem."""
    with tempfile.TemporaryDirectory() as made:
        where = folder or Path(made)
        if folder is None:
            run(read_config(CONFIG), where, workers=1)
        trials = load(where, "matches")
    # As they were asked for; views have as many as they have.
    for column, asked in (("n", "size"), ("inliers", "inliers"), ("noise", "noise")):
        trials[column] = trials[asked].fillna(0)
    trials["n"] = trials["n"].astype(int)
    for column in ("scene", "frames"):
        trials[column] = trials[column].fillna("")
    trials["milliseconds"] = 1000 * trials["seconds"]
    trials = trials[trials["skipped"] == ""]
    groups = trials.groupby(_KIND, sort=True)
    table = groups[["precision", "recall", "f_score", "right"]].mean().round(4)
    table["problems"] = groups.size()
    table["milliseconds"] = groups["milliseconds"].median().round(4)
    table["mebibytes"] = groups["mebibytes"].median().round(3)
    _write(METHODS_CSV, table.reset_index().to_csv(index=False))


def measure_options() -> None:
    """Measure all options."""
    with OPTIONS_CSV.open("w", encoding="utf-8", newline="") as file:
        file.write(_heading())
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(measure_all())


def _heading() -> str:
    day = datetime.now(tz=timezone.utc).date().isoformat()
    return f"# Measured by docs/figures/choose.py with cgroup {cgroup.__version__} on {day}, one thread.\n"


def _write(path: Path, text: str) -> None:
    path.write_text(_heading() + text, encoding="utf-8")


def main(arguments: list[str]) -> int:
    """Do what is asked for."""
    if arguments[:1] == ["measure"] and len(arguments) <= 2:
        measure_methods(Path(arguments[1]) if arguments[1:] else None)
        measure_options()
        write_tables()
    elif arguments == ["write"]:
        write_tables()
    else:
        sys.stderr.write(__doc__ or "")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
