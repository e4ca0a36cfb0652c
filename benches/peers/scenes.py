"""Many scans, by cgroup and by what users would pick instead, one after the other on the same sets.

python -m peers.scenes SET... [--mirrored] [--solvers cgroup open3d kiss-matcher] [--seed 0]

A set is "stone:SEED" or a folder below $CGROUP_DATA, such as "scenes/eth_facade_7"; all that are named go
into one bag, shuffled, each scan in a random frame.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import TYPE_CHECKING

import numpy as np

from cgroup import features
from cgroup._runtime.progress import StageClock
from cgroup.benchmark.pipelines import scenes
from cgroup.datasets.scan_sets import load_scan_set
from cgroup.evaluation import ecdf, score_scene
from cgroup.evaluation.scenes import ROTATION_LIMITS, TRANSLATION_LIMITS

if TYPE_CHECKING:
    from collections.abc import Sequence

SOLVERS = {"cgroup": scenes.own, "open3d": scenes.open3d_multiway, "kiss-matcher": scenes.kiss_matcher_gnc}
_VOXELS = 4500  # that a scan is thinned to, about


def measure(names: Sequence[str], solvers: Sequence[str], seed: int, *, mirrored: bool) -> list[str]:
    """Run solvers on a bag; return a row of a table for each."""
    bag = load_scan_set(names, None, seed, mirrored=mirrored)
    voxel = features.choose_voxel(*(features.Cloud(points) for points in bag.scans), voxels=_VOXELS)
    rows: list[str] = []
    for name in solvers:
        begun = time.perf_counter()
        answer = SOLVERS[name](scenes.Scans(bag.scans, voxel, threads=2, seed=seed), StageClock())
        seconds = time.perf_counter() - begun
        score = score_scene(answer.poses, answer.components, bag.truth, bag.labels)
        turned, moved = score.rotation, score.translation
        joined = np.isfinite(turned)
        summary = [
            f"{np.median(values[joined]):.3g} / {values[joined].max():.3g}" if joined.any() else "-"
            for values in (turned, moved)
        ]
        shares = [
            " ".join(f"{100 * share:.0f}" for share in ecdf(errors, limits))
            for errors, limits in ((turned, ROTATION_LIMITS), (moved, TRANSLATION_LIMITS))
        ]
        cells = [
            name,
            f"{score.right} of {score.wanted}, {score.mixed} mixed",
            f"{score.placed} of {len(bag.scans)}",
            *summary,
            *shares,
            f"{answer.tried}",
            f"{seconds:.1f}",
        ]
        rows.append(f"| {' | '.join(cells)} |")
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sets", nargs="+")
    parser.add_argument("--solvers", nargs="+", default=list(SOLVERS), choices=list(SOLVERS))
    parser.add_argument("--mirrored", action="store_true", help="each place once more, mirrored")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    head = ["", "components right", "placed", "degrees, median / largest", "shift, median / largest"]
    head += [f"% within {', '.join(f'{limit:g}' for limit in ROTATION_LIMITS)} degrees"]
    head += [f"% within {', '.join(f'{limit:g}' for limit in TRANSLATION_LIMITS)}", "pairs tried", "s"]
    rows = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    rows += measure(given.sets, given.solvers, given.seed, mirrored=given.mirrored)
    sys.stdout.write("\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
