"""
Your own method in the benchmark
================================

Add your own method, data set and nuisance to the benchmark.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from matplotlib.figure import Figure

from cgroup.benchmark import tables
from cgroup.benchmark.config import parse_config
from cgroup.benchmark.run import run
from cgroup.datasets import Dataset, MatchingPair, standin_pair
from cgroup.types import PointCloud

if TYPE_CHECKING:
    import pandas as pd

    from cgroup import Correspondences


def closest_descriptors(correspondences: Correspondences, *, share: float = 0.2) -> np.ndarray:
    """Select a fraction of the matches, those with the most similar descriptors: a method."""
    similarity = np.asarray(correspondences.similarity)
    return similarity >= np.quantile(similarity, 1 - share)


def holes(pair: MatchingPair, level: float, rng: np.random.Generator) -> MatchingPair:
    """Cut `level` round holes into the target: a nuisance."""
    points = pair.target.points
    for center in rng.choice(points, size=int(level)):
        points = points[np.linalg.norm(points - center, axis=1) > 8.0]
    return replace(pair, target=PointCloud(points))


class MyScans(Dataset):
    """Pairs of scans: a data set. They are generated here; `load` may also read files below `root`."""

    name: ClassVar = "my-scans"
    title: ClassVar = "My scans"
    role: ClassVar = "partial-partial"
    origin: ClassVar = "synthetic"
    protocols: ClassVar = ("precision>0.1", "rmse<=5pr")
    citation: ClassVar = "none"

    def __init__(self, root: Path | None = None) -> None:
        self.root = root

    def pair_names(self) -> list[str]:
        """Return the names of all pairs."""
        return ["first", "second"]

    def load(self, name: str) -> MatchingPair:
        """Return one pair."""
        self.check_name(name)
        made = standin_pair(seed=self.pair_names().index(name), pixels=100, turn=20)
        return replace(made, name=name)


def draw(means: pd.DataFrame) -> Figure:
    """Draw recall over the number of holes, a curve per method."""
    figure = Figure(figsize=(6, 3), layout="constrained")
    axes = figure.subplots()
    for method, rows in means.groupby("method"):
        axes.plot(rows["level"], rows["recall"], marker="o", label=method)
    axes.set(xlabel="holes", ylabel="recall", ylim=(0, 1))
    axes.legend(frameon=False)
    return figure


CONFIG = """
name = "mine"
methods = [
  "gtm",
  "gc",
  { name = "extend_benchmark:closest_descriptors", label = "closest", options = { share = 0.1 } },
]

[[experiment]]
id = "holes"
dataset = "extend_benchmark:MyScans"
nuisance = "extend_benchmark:holes"
levels = [0, 5, 10]
"""

# Worker processes import this file too, so run the benchmark in the main process only.
if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        run(parse_config(CONFIG), Path(folder), workers=2)
        frame = tables.load(Path(folder))
    means = tables.aggregate(frame, ["level", "method"])
    figure = draw(means)
    figure.savefig("holes.png")
    columns = ["level", "method", "pairs", "n", "precision", "recall", "ok:rmse<=5pr"]
    print(means[columns].to_string(index=False))
