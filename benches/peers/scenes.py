"""Many scans, by cgroup and by what users would pick instead, one after the other on the same sets.

python -m peers.scenes SET... [--mirrored] [--solvers cgroup open3d kiss-matcher] [--seed 0]

A set is "stone:SEED" (generated, in mm) or a folder below $CGROUP_DATA (in m), such as "scenes/eth_facade_7";
all that are named go into one bag, shuffled, each scan in a random frame.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from typing import TYPE_CHECKING

import numpy as np

from cgroup import features
from cgroup._runtime.progress import StageClock
from cgroup.evaluation import ecdf, score_scene
from cgroup.evaluation.scenes import ROTATION_LIMITS, TRANSLATION_LIMITS
from peers import scene_solvers
from peers.scan_sets import load_scan_set

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

SOLVERS = {
    "cgroup": scene_solvers.own,
    "open3d": scene_solvers.open3d_multiway,
    "kiss-matcher": scene_solvers.kiss_matcher_gnc,
}
_NEEDED = {"open3d": ("open3d",), "kiss-matcher": ("kiss_matcher", "gtsam")}
_VOXELS = 4500  # that a scan is thinned to, about


def measure(names: Sequence[str], solvers: Sequence[str], seed: int, *, mirrored: bool) -> Iterator[str]:
    """Run solvers on a bag; give a row of a table for each as soon as it is done."""
    bag = load_scan_set(names, None, seed, mirrored=mirrored)
    voxel = features.choose_voxel(*(features.Cloud(points) for points in bag.scans), voxels=_VOXELS)
    described = " + ".join(names) + (", mirrored too" if mirrored else "")
    for name in solvers:
        begun = time.perf_counter()
        answer = SOLVERS[name](scene_solvers.Scans(bag.scans, voxel, threads=2, seed=seed), StageClock())
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
            described,
            name,
            f"{score.right} of {score.wanted}, {score.mixed} mixed",
            f"{score.placed} of {len(bag.scans)}",
            *summary,
            *shares,
            f"{answer.tried}",
            f"{seconds:.1f}",
        ]
        yield f"| {' | '.join(cells)} |"


def load_libraries(solvers: Sequence[str]) -> None:
    """Import what solvers need, before the clock starts."""
    for module in ("cgroup.scenes", *(module for name in solvers for module in _NEEDED.get(name, ()))):
        importlib.import_module(module)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sets", nargs="+")
    parser.add_argument("--solvers", nargs="+", default=list(SOLVERS), choices=list(SOLVERS))
    parser.add_argument("--mirrored", action="store_true", help="each place once more, mirrored")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    try:
        load_libraries(given.solvers)
    except ModuleNotFoundError as error:
        parser.error(f"{error.name} isn't installed; pip install 'cgroup[peers]', or leave its solver out")
    head = ["set", "solver", "components right", "placed", "degrees, median / largest of those joined"]
    head += ["shift, median / largest of those joined"]
    head += [f"% within {', '.join(f'{limit:g}' for limit in ROTATION_LIMITS)} degrees"]
    head += [f"% within {', '.join(f'{limit:g}' for limit in TRANSLATION_LIMITS)}", "pairs tried", "s"]
    sys.stdout.write(f"| {' | '.join(head)} |\n|{'---|' * len(head)}\n")
    for row in measure(given.sets, given.solvers, given.seed, mirrored=given.mirrored):
        sys.stdout.write(f"{row}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
