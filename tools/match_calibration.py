"""Calibration of `match_probabilities` by kind of data, that of ``CGROUP_DATA``.

A match is correct if its residual under the true pose is at most 5 resolutions. Each row has the numbers of
problems and matches, the share of correct matches, and the Brier score and the expected calibration error (10
bins) of each method's groups.
"""

from __future__ import annotations

import json
import os
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from cgroup import Correspondences, features, group, match_probabilities
from cgroup.benchmark.matching import _describe, match_both_ways, take_matches
from cgroup.datasets import Dataset, open_dataset
from cgroup.evaluation import correct_matches
from cgroup.io import read_cloud
from cgroup.registration import correspond
from cgroup.rigid import invert
from cgroup.types import PointCloud

METHODS = ("lc", "gtm", "ransac", "sc2pcr")
SCANS = {
    "airsim_blocks_20": 8,
    "kitti07_submaps_5": 4,
    "backpack_11": 5,
    "apc_box_f200_13": 5,
    "eth_facade_7": 3,
    "kinect_slambook_5": 4,
}
LEAST_OVERLAP = 0.25
BINS = 10

Problem = tuple[str, Correspondences, np.ndarray]


def some(items: list, count: int) -> list:
    """Return up to so many items, evenly spread over a list."""
    count = min(count, len(items))
    return [items[i * len(items) // count] for i in range(count)]


def dense(
    source: PointCloud, target: PointCloud, viewpoints: Sequence[features.Viewpoint] = (features.ORIGIN,) * 2
) -> Iterator[Correspondences]:
    """Yield mutual and nearest FPFH matches of voxels."""
    voxel = features.choose_voxel(source.points, target.points)
    described = [
        _describe(cloud, viewpoint, voxel, unit_length=False)
        for cloud, viewpoint in zip((source, target), viewpoints, strict=True)
    ]
    matches, mutual = match_both_ways(*described, 1, None)
    yield from (take_matches(matches, mutual), matches)


def problems() -> Iterator[Problem]:
    """Yield the kind, the matches and the true pose."""
    for name in ("corr", "corr-three"):
        dataset = open_dataset(name)
        for pair in map(dataset.load, dataset.pair_names()):
            yield "corr", pair.correspondences, pair.T_target_source
    stanford = open_dataset("stanford")
    for kind in ("bunny", "happy"):
        names = [name for name in stanford.pair_names() if name.startswith(kind)]
        for pair in map(stanford.load, some(names, 8)):
            views = pair.source_viewpoint, pair.target_viewpoint
            for matches in dense(pair.source, pair.target, views):
                yield kind, matches, pair.T_target_source
        yield from by_keypoints(kind, stanford, some(names, 5))
    rooms = open_dataset("3dmatch")
    for pair in map(rooms.load, some(list(rooms.pair_names()), 10)):
        for matches in dense(pair.source, pair.target, (pair.source_viewpoint, pair.target_viewpoint)):
            yield "rooms", matches, pair.T_target_source
    for kind, count in (("u3or", 8), ("b3r", 6)):
        dataset = open_dataset(kind)
        yield from by_keypoints(kind, dataset, some(list(dataset.pair_names()), count))
    for name, count in SCANS.items():
        yield from of_scans(Path(os.environ["CGROUP_DATA"]) / "scenes" / name, count)


def by_keypoints(kind: str, dataset: Dataset, names: list[str]) -> Iterator[Problem]:
    """Yield matches of the paper's front end."""
    for pair in map(dataset.load, names):
        views = {"source_viewpoint": pair.source_viewpoint, "target_viewpoint": pair.target_viewpoint}
        yield kind, correspond(pair.source, pair.target, normals=pair.normals, **views), pair.T_target_source


def overlap_of(entry: list | dict) -> tuple[int, int, float]:
    """Return two scans and their overlap; 1 where it is not listed."""
    if isinstance(entry, dict):
        return entry["i"], entry["j"], entry.get("overlap", 1.0)
    return int(entry[0]), int(entry[1]), entry[2]


def of_scans(folder: Path, count: int) -> Iterator[Problem]:
    """Yield matches of pairs of a set of scans."""
    known = json.loads((folder / "set.json").read_text(encoding="utf-8"))
    scans = known["scans"]
    pairs = [pair for pair in map(overlap_of, known["overlaps"]) if pair[2] >= LEAST_OVERLAP]
    for i, j, *_ in some(pairs, count):
        source, target = (read_cloud(folder / scans[k]["file"]) for k in (i, j))
        pose = invert(np.array(scans[j]["world_from_scan"])) @ np.array(scans[i]["world_from_scan"])
        for matches in dense(source, target):
            yield folder.name.split("_")[0], matches, pose


def calibration_error(probability: np.ndarray, right: np.ndarray) -> float:
    """Return the mean difference between probability and frequency, by bins."""
    bins = np.minimum((probability * BINS).astype(int), BINS - 1)
    differences = [abs((probability - right)[bins == k].sum()) for k in range(BINS)]
    return sum(differences) / len(right)


def main() -> None:
    """Print the table."""
    found = defaultdict(list)
    for kind, matches, pose in problems():
        limit = 5 * matches.resolution
        right = correct_matches(matches.source, matches.target, pose, tolerance=limit).astype(float)
        found[kind].append((right, [match_probabilities(matches, group(matches, name)) for name in METHODS]))
    for kind, rows in found.items():
        right = np.concatenate([row[0] for row in rows])
        cells = [f"{kind:9} {len(rows):3} {len(right):7,} {right.mean():.3f}"]
        for k in range(len(METHODS)):
            probability = np.concatenate([row[1][k] for row in rows])
            brier = ((probability - right) ** 2).mean()
            cells.append(f"{brier:.3f} / {calibration_error(probability, right):.3f}")
        print(" | ".join(cells))  # noqa: T201


if __name__ == "__main__":
    main()
