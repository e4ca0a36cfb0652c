"""Poses of `register` on sets of scans below ``CGROUP_DATA``: `docs/figures/measured/scan-sets.csv`.

A set has up to 40 of its pairs, those with a listed overlap of 0.1 or more; all scans of a set without true
poses are unrelated. A pose is correct within 5 degrees, and with the centre of the source within 4 voxels
(or within the limits of the set). Each pair is registered without and with the viewpoint, each fourth one
also with its mirrored source. Errors are normalized squared errors (6 on average if the covariance is
exact) of accepted correct poses: those of pairs against the reference, and of triangles, whose three poses
compose to the identity.
"""

from __future__ import annotations

import csv
import json
import os
import sys
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

import numpy as np
from match_calibration import some

from cgroup import NoConsensusError, Registration, register
from cgroup.datasets.scan_sets import find_scan_set
from cgroup.rigid import apply, invert, rotation_error
from cgroup.rigid.se3 import adjoint, vector_of

SETS = {
    "stanford_views/bunny": "range views of a bunny",
    "stanford_views/happy_stand": "range views of a stand",
    "threedmatch/7-scenes-redkitchen": "fused depth frames of a room",
    "scenes/apc_box_f200_13": "depth frames of a box (F200)",
    "scenes/kinect_slambook_5": "depth frames of a room (Kinect)",
    "scenes/tabletop_osd_16": "depth frames of tables, unrelated",
    "scenes/eth_facade_7": "terrestrial scanner",
    "scenes/hokuyo_lpm_3": "tilting scanner outdoors",
    "scenes/sick_3dtk_3": "tilting scanner in a corridor",
    "scenes/vlp16_indoor_11": "16-beam LiDAR indoors",
    "scenes/backpack_11": "two 16-beam LiDARs in a hall",
    "scenes/nclt_loop_161": "32-beam LiDAR",
    "scenes/kitti07_submaps_5": "submaps of a 64-beam LiDAR",
    "scenes/als_mixedconifer_3": "airborne strips of a forest",
    "scenes/semi_terrain": "crops of terrain",
    "scenes/airsim_blocks_20": "simulated boxes",
}
NO_VIEWPOINT = {
    "stanford_views/bunny",
    "stanford_views/happy_stand",
    "threedmatch/7-scenes-redkitchen",
    "scenes/als_mixedconifer_3",
    "scenes/semi_terrain",
}
MOST_PAIRS = 40
MIRRORED = 4  # the source of each fourth pair is mirrored too
LEAST_OVERLAP = 0.1
MIRROR = np.diag([-1.0, 1.0, 1.0])
ORIGIN = np.zeros(3)
COLUMNS = (
    "scans", "pairs", "found / accepted / wrong accepted", "the same with viewpoints", "mirrored accepted",
    "error to the reference", "error of triangles",
)  # fmt: skip


@dataclass
class Counts:
    """Found, accepted correct and accepted wrong poses of one kind of runs."""

    runs: int = 0
    found: int = 0
    accepted: int = 0
    wrong: int = 0
    poses: dict[tuple[int, int], Registration] = field(default_factory=dict)
    errors: list[float] = field(default_factory=list)

    def add(self, pair: tuple[int, int], done: Registration | None, truth: np.ndarray | None) -> None:
        """Count one run; `truth` is the true pose if this pose is correct."""
        self.runs += 1
        if done is None:
            return
        right = truth is not None
        self.found += right
        self.wrong += done.ok and not right
        if truth is not None and done.ok:
            self.accepted += 1
            self.poses[pair] = done
            self.errors.append(normalized(truth @ invert(done.T_target_source), done.covariance))


def pairs_of(known: dict, count: int) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Return the related and the unrelated pairs of a set."""
    every = list(combinations(range(count), 2))
    if "none" in known.get("poses", ""):
        return [], some(every, MOST_PAIRS)
    listed = known.get("pairs") or [
        (each["i"], each["j"])
        for each in known.get("overlaps", [])
        if min(each["overlap_i"], each["overlap_j"]) >= LEAST_OVERLAP
    ]
    return some(as_pairs(listed) or every, MOST_PAIRS), as_pairs(known.get("unrelated_pairs", []))


def as_pairs(entries: list) -> list[tuple[int, int]]:
    """Return pairs of rows, listed as lists or as objects."""
    return [(each["i"], each["j"]) if isinstance(each, dict) else (each[0], each[1]) for each in entries]


def run(source: np.ndarray, target: np.ndarray, viewpoint: np.ndarray | None) -> Registration | None:
    """Return the pose, accepted or not; None without a proposal."""
    try:
        return register(source, target, viewpoint=viewpoint)
    except NoConsensusError as error:
        return error.registration


def is_correct(done: Registration, truth: np.ndarray, source: np.ndarray, limits: tuple) -> bool:
    """Return whether a pose is within the limits."""
    degrees, length = limits
    middle = source.mean(axis=0)[None]
    offset = np.linalg.norm(apply(done.T_target_source, middle) - apply(truth, middle))
    return rotation_error(done.T_target_source, truth) < degrees and offset < max(length, 4 * done.voxel)


def normalized(error: np.ndarray, covariance: np.ndarray) -> float:
    """Return the normalized squared error of a motion (4,4)."""
    motion = vector_of(error, ORIGIN)
    return float(motion @ np.linalg.solve(covariance, motion))


def triangles(poses: dict[tuple[int, int], Registration]) -> list[float]:
    """Return the normalized squared errors of the composed poses of three scans each."""
    errors = []
    for a, b, c in combinations(sorted({row for pair in poses for row in pair}), 3):
        if {(a, b), (b, c), (a, c)} <= poses.keys():
            first, second, direct = poses[a, b], poses[b, c], poses[a, c]
            moved = adjoint(second.T_target_source)
            covariance = second.covariance + moved @ first.covariance @ moved.T + direct.covariance
            loop = second.T_target_source @ first.T_target_source @ invert(direct.T_target_source)
            errors.append(normalized(loop, covariance))
    return errors


def measure(name: str) -> list[str]:
    """Return the row of one set."""
    path = Path(os.environ["CGROUP_DATA"]) / name / "set.json"
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    found = find_scan_set(name, None)()
    related, unrelated = pairs_of(known, len(found.scans))
    degrees, length = known.get("lim") or (5.0, 0.0)
    plain, seen, mirrored = Counts(), Counts(), Counts()
    viewpoints = [None] if name in NO_VIEWPOINT else [None, ORIGIN]
    for k, (i, j) in enumerate(related + unrelated):
        source, target = found.scans[i], found.scans[j]
        truth = invert(found.truth[j]) @ found.truth[i] if (i, j) in related else None
        for viewpoint in viewpoints:
            done = run(source, target, viewpoint)
            good = (
                done is not None and truth is not None and is_correct(done, truth, source, (degrees, length))
            )
            (plain if viewpoint is None else seen).add((i, j), done, truth if good else None)
            if k % MIRRORED == 0:
                mirrored.add((i, j), run(source @ MIRROR, target, viewpoint), None)
    loops = triangles(plain.poses)
    errors = [f"{np.mean(each):.1f} ({len(each)})" if each else "-" for each in (plain.errors, loops)]
    counts = [
        f"{each.found} / {each.accepted} / {each.wrong}" if each.runs else "-" for each in (plain, seen)
    ]
    return [SETS.get(name, name), str(plain.runs), *counts, f"{mirrored.wrong} of {mirrored.runs}", *errors]


def main(names: list[str]) -> None:
    """Print the table of some sets, or of all."""
    table = csv.writer(sys.stdout, lineterminator="\n")
    table.writerow(COLUMNS)
    for name in names or SETS:
        table.writerow(measure(name))
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
