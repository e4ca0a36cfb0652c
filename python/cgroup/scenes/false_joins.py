"""Estimated number of scans that a scene joins by chance, from mirrored scans."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_count, as_instance
from cgroup._runtime.memory import report_refused_memory
from cgroup._runtime.progress import as_stage_function
from cgroup.errors import InputError
from cgroup.fronts.scan import mirror_image
from cgroup.registration.pairwise import FalseAccepts, Preparation, count_false_accepts
from cgroup.scenes.scene import Scene
from cgroup.scenes.workers import open_workers


@report_refused_memory()
@explain_wrong_calls
def false_joins(
    scene: Scene, *, scans: int = 10, threads: int | None = None, progress: Callable[[str], Any] | None = None
) -> FalseAccepts:
    """Estimate how many of the joined scans of a scene are wrong.

    Mirrored copies of its scans are added to the scene, one at a time, as by `Scene.add`. None belongs to it,
    so about as many scans are joined wrongly as copies would be: by pairs, by agreement, or by unions. A scan
    that is its own mirror image joins rightly; leave such scenes out. `threads` and `progress` are as for
    `register_all`.

    Parameters
    ----------
    scene : Scene
        Made by `register_all`. It does not change.
    scans : int
        Number of mirrored scans, spread over the rows; all if the scene has fewer. Each takes as long as
        adding a scan.

    Returns
    -------
    FalseAccepts
        Number of mirrored scans, how many of their originals are joined, and how many of them would be.

    Raises
    ------
    InputError
        For a scene that was created by hand.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.scenes import false_joins, register_all
    >>> views = [standin_pair(seed=1, turn=turn, pixels=60) for turn in (40, 80)]
    >>> scene = register_all([views[0].source, views[0].target, views[1].target])
    >>> found = false_joins(scene)
    >>> found.accepted, found.decoys
    (3, 0)
    """
    if as_instance("scene", scene, Scene).made is None:
        raise InputError("scene", "one that was created by hand", "make it by `register_all`")
    building, rows, _ = scene.made
    count = min(as_count("scans", scans, 1), len(rows))
    begin = as_stage_function(progress)
    sizes = {row: len(part) for part in scene.components for row in part}
    joined: list[bool] = []
    wrong: list[bool] = []
    for number, row in enumerate(np.linspace(0, len(rows) - 1, count).round().astype(int).tolist()):
        begin(f"mirrored scan {number + 1} of {count}")
        scan = building.scans[row]
        image, eye = mirror_image(scan.scan, scan.viewpoint, building.axis)
        shared = Preparation(scan.voxel, scan.front, 1)
        mirrored = shared.prepare(image, eye, by_frames=scan.by_frames).begin()
        with open_workers([*building.scans, mirrored], threads) as call:
            grown = building.grown(mirrored, call)
            grown.join()
        wrong.append(grown.joins_last)
        joined.append(sizes[rows[row]] > 1)
    return count_false_accepts(joined, wrong)
