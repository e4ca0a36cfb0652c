"""Data sets: pairs of clouds, or of matched points, with a true pose."""

from cgroup.datasets.base import (
    CorrespondencePair,
    Dataset,
    MatchingPair,
    UnrelatedPair,
    mirror,
    mix,
    mixed_names,
)
from cgroup.datasets.file_datasets import data_root
from cgroup.datasets.generated.stones import standin_pair
from cgroup.datasets.generated_matches import make_scene
from cgroup.datasets.matching_problems import MatchingProblem, make_problem
from cgroup.datasets.registry import DATASETS, open_dataset

__all__ = [
    "DATASETS", "CorrespondencePair", "Dataset", "MatchingPair", "MatchingProblem", "UnrelatedPair",
    "data_root", "make_problem", "make_scene", "mirror", "mix", "mixed_names", "open_dataset", "standin_pair",
]  # fmt: skip
