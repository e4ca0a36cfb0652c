"""3DHV: where a match votes, and how far that is from the fullest bin."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup._show import words

if TYPE_CHECKING:
    from cgroup._checks.array_types import FloatArray, IndexArray
    from cgroup._explain.facts import Facts
    from cgroup._runtime.run import Run

_FLAT = 1e-9
"""Share of the target's bounding box below which an axis of the votes has one bin."""


def explain_vote(facts: Facts, run: Run, i: int) -> tuple[str, str]:
    """Return why a match was kept or dropped, and what would have kept it."""
    votes = _votes(facts, run)
    if not np.isfinite(votes[i]).all():
        return "it lacks a local frame, so that it casts no vote", ""
    if run.options["variant"] == "pcl":
        return _in_hough_space(facts, run, votes, i), ""
    return _on_the_grid(facts, run, votes, i)


def _votes(facts: Facts, run: Run) -> FloatArray:
    """(n,3) where each match expects the source's centroid, Eq. (14) to (16); NaN without frames."""
    assert facts.points is not None and run.frames is not None  # noqa: PT018, S101 - 3DHV has both
    source, target = facts.points
    frames = run.frames.source_lrf, run.frames.target_lrf
    assert frames[0] is not None and frames[1] is not None  # noqa: PT018, S101 - likewise
    given = run.frames.source_centroid
    centroid = source.mean(axis=0) if given is None else given.astype(np.float64)
    local = np.einsum("iab,ib->ia", frames[0].astype(np.float64), centroid - source)
    return np.einsum("iba,ib->ia", frames[1].astype(np.float64), local) + target - target.mean(axis=0)


def _on_the_grid(facts: Facts, run: Run, votes: FloatArray, i: int) -> tuple[str, str]:
    cells, peak, most = _bins(facts, run, votes)
    own = int(np.count_nonzero((cells == cells[i]).all(axis=1)))
    steps = np.abs(cells[i] - peak)
    neighbors = int(run.options["neighbors"])
    reach = {0: "the fullest bin", 6: "the fullest bin and the six that share a side with it"}.get(
        neighbors, "the fullest bin and the 26 around it"
    )
    where = "in the fullest bin" if not steps.any() else f"in a bin {_steps(steps)} away from the fullest"
    count = f"its bin has {own} of the votes, the fullest {most}"
    reason = f"it votes for a place of the source's centroid {where}: {count}"
    if facts.grouping.mask[i]:
        return reason, ""
    return reason, f"with a vote in {reach}"


def _bins(facts: Facts, run: Run, votes: FloatArray) -> tuple[IndexArray, IndexArray, int]:
    """(n,3) bins, the fullest one, and how many votes that has; -1 where there is no vote."""
    assert facts.points is not None  # noqa: S101 - 3DHV has points
    cast = np.isfinite(votes).all(axis=1)
    low, extent = votes[cast].min(axis=0), np.ptp(votes[cast], axis=0)
    size, bins = run.options["bin_size"], int(run.options["bins"])
    if size is None:
        flat = extent <= _FLAT * float(np.linalg.norm(np.ptp(facts.points[1], axis=0)))
        side, last = np.where(flat, np.inf, extent / bins), np.full(3, bins - 1.0)
    else:
        side, last = np.full(3, float(size)), np.floor(extent / float(size))
    cells = np.full(votes.shape, -1, dtype=np.int64)
    cells[cast] = np.clip(np.floor((votes[cast] - low) / side), 0, last).astype(np.int64)
    backwards, counts = np.unique(cells[cast][:, ::-1], axis=0, return_counts=True)
    fullest = int(np.argmax(counts))  # of equal ones the lowest, x fastest
    return cells, backwards[fullest, ::-1], int(counts[fullest])


def _steps(steps: IndexArray) -> str:
    parts = [f"{step} along {axis}" for step, axis in zip(steps, "xyz", strict=True) if step]
    return " and ".join([", ".join(parts[:-1]), parts[-1]]) if len(parts) > 1 else parts[0]


def _in_hough_space(facts: Facts, run: Run, votes: FloatArray, i: int) -> str:
    """As in PCL: the voters of each local maximum are filtered by RANSAC, and the largest set wins."""
    mask, size = facts.grouping.mask, float(run.options["bin_size"])
    if not mask.any():
        return "no maximum of the votes has voters whom one pose fits"
    off = words.length(float(np.linalg.norm(votes[i] - votes[mask].mean(axis=0))), facts.resolution)
    bins = words.length(size, facts.resolution)
    place = f"it votes {off} from the group's mean vote (bins of {bins})"
    if mask[i]:
        return f"{place}, for the winning maximum, and the RANSAC filter left it"
    return f"{place}: not for the winning maximum, or the RANSAC filter of its voters removed it"
