"""Methods compared on one pair: as a document, and as text."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup.cli.show.json import Document
from cgroup.cli.show.numbers import milliseconds, show_value
from cgroup.cli.show.tables import Column, print_table
from cgroup.cli.show.terminal import print_clouds, print_facts, print_files, print_prose
from cgroup.comparison import table
from cgroup.evaluation.ground_truth import CORRECT_WITHIN
from cgroup.registry import label_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cgroup.comparison import MethodResult
    from cgroup.types import BoolArray, Correspondences, FloatArray

_COLUMNS = (
    Column("method", is_text=True),
    Column("selected", priority=1),
    Column("precision"),
    Column("recall"),
    Column("F"),
    Column("P > 0.1", priority=4),
    Column("registered"),
    Column("rot deg", priority=2),
    Column("off pr"),
    Column("ms"),
)
_HIGHER_IS_BETTER = {"precision": 2, "recall": 3, "f_score": 4}
_LOWER_IS_BETTER = {"rotation_error_deg": 7, "displacement_pr": 8}


def comparison_results(
    matches: Correspondences,
    correct: BoolArray,
    results: Sequence[MethodResult],
    *,
    T_target_source: FloatArray,
    inverse_correct: int | None,
    limits: tuple[float, float],
) -> Document:
    """List what a document says of methods compared on one pair."""
    pr = matches.resolution or np.nan
    rows: list[dict[str, Any]] = []
    for row, result in zip(table(results), results, strict=True):
        pose = {"displacement_pr": result.displacement / pr, "T_target_source": result.T_target_source}
        rows.append({**row, **pose})
    return {
        "resolution": pr,
        "matches": len(correct),
        "correct": int(np.count_nonzero(correct)),
        "correct_under_inverse": inverse_correct,
        "T_target_source": T_target_source,
        "methods": rows,
        "limits": {"max_rotation_deg": limits[0], "max_displacement_pr": limits[1]},
    }


def print_comparison(document: Document, *, wide: bool = False) -> None:
    """Print methods compared on one pair, from their document: the best F first."""
    results = document["results"]
    limits = results["limits"]
    print_clouds(document["inputs"])
    counted = say_correct(results["matches"], results["correct"])
    pr = show_value(results["resolution"], ".4g")
    print_facts(
        ("resolution", f"{pr} (mean point spacing, in the files' unit; 1 pr)"),
        ("matching", f"{counted}, that is within {CORRECT_WITHIN:g} pr of the true place"),
    )
    rows = sorted(results["methods"], key=lambda row: (-row["f_score"], row["milliseconds"]))
    print_table(_COLUMNS, [_cells(row) for row in rows], best=_find_best(rows), wide=wide)
    print_prose(
        f"Registered: the pose that the group fixes is off by at most {limits['max_rotation_deg']:g} "
        f"degrees, and by {limits['max_displacement_pr']:g} pr on average over the matched points. P > 0.1: "
        "the paper's criterion, which asks for no pose."
    )
    if results["correct_under_inverse"]:
        print_prose(
            f"Note: {results['correct_under_inverse']} matches would be correct under the inverse of this "
            "truth; it has to map the source into the target's frame."
        )
    print_files(document)


def say_correct(matches: int, correct: int) -> str:
    """Say how many of some matches are correct."""
    return f"{matches} matches, {correct} correct ({100 * correct / max(matches, 1):.1f} %)"


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    posed = row["T_target_source"] is not None
    return (
        label_of(row["method"]),
        str(row["selected"]),
        f"{row['precision']:.3f}",
        f"{row['recall']:.3f}",
        f"{row['f_score']:.3f}",
        "yes" if row["precision_above_0.1"] else "no",
        "yes" if row["registered"] else "no",
        f"{row['rotation_error_deg']:.2f}" if posed else "no pose",
        f"{row['displacement_pr']:.2f}" if posed else "no pose",
        milliseconds(row["milliseconds"]),
    )


def _find_best(rows: list[dict[str, Any]]) -> set[tuple[int, int]]:
    """Find the best cells of each column of quality; ties are all best."""
    best: set[tuple[int, int]] = set()
    for columns, pick in ((_HIGHER_IS_BETTER, max), (_LOWER_IS_BETTER, min)):
        for name, at in columns.items():
            values = [row[name] for row in rows if row[name] is not None]
            top = pick(values, default=None)
            best |= {(line, at) for line, row in enumerate(rows) if top is not None and row[name] == top}
    return best
