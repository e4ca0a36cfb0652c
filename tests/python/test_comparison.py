"""Several methods on the same correspondences."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import numpy as np
import pytest

from cgroup import METHODS, Correspondences
from cgroup.comparison import compare, find_correct, table, write_table
from cgroup.errors import InputError
from cgroup.evaluation import score_group

if TYPE_CHECKING:
    from pathlib import Path

POSE = np.eye(4)
POSE[:3, 3] = (1, 2, 3)


@pytest.fixture
def matches() -> Correspondences:
    """Sixty matches, forty of them correct."""
    rng = np.random.default_rng(0)
    source = rng.uniform(size=(60, 3))
    target = source + POSE[:3, 3]
    target[40:] = rng.uniform(size=(20, 3)) + 9
    return Correspondences(source, target, resolution=0.01)


def test_methods_are_named_as_they_begin(matches: Correspondences) -> None:
    begun: list[str] = []
    results = compare(matches, POSE, methods=["gc", "ransac"], progress=begun.append)
    assert begun == []
    assert next(results).method == "gc"
    assert begun == ["gc"]
    assert [result.method for result in results] == ["ransac"]
    assert begun == ["gc", "ransac"]


def test_correct_matches_may_be_given(matches: Correspondences) -> None:
    correct = find_correct(matches, POSE)
    assert correct.tolist() == [True] * 40 + [False] * 20
    (found,) = compare(matches, POSE, methods=["gtm"])
    (given,) = compare(matches, POSE, methods=["gtm"], correct=correct)
    assert found.score == given.score == score_group(found.grouping.mask, correct)
    (inverted,) = compare(matches, POSE, methods=["gtm"], correct=~correct)
    assert inverted.score.correct == 20
    assert inverted.score.selected_correct == found.score.selected - found.score.selected_correct


def test_tolerance_is_five_times_the_resolution(matches: Correspondences) -> None:
    moved = Correspondences(matches.source, matches.target + np.array([0.04, 0, 0]), resolution=0.01)
    assert find_correct(moved, POSE).sum() == 40
    assert find_correct(moved, POSE, tolerance=0.03).sum() == 0
    with pytest.raises(InputError, match="tolerance"):
        find_correct(Correspondences(matches.source, matches.target), POSE)


def test_what_exists_is_compared_by_default(matches: Correspondences) -> None:
    with pytest.raises(InputError, match="ss needs `similarity`"):
        next(compare(matches, POSE))
    assert next(iter(METHODS)) == "ss"


def test_table_as_csv(matches: Correspondences, tmp_path: Path) -> None:
    results = list(compare(matches, POSE, methods=["gc", "gtm"]))
    write_table(tmp_path / "table.csv", results)
    with (tmp_path / "table.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["method"] for row in rows] == ["gc", "gtm"]
    assert [float(row["f_score"]) for row in rows] == [row["f_score"] for row in table(results)]
