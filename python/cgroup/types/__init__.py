"""Inputs and outputs of grouping methods, and point clouds."""

from cgroup._checks.arrays import BoolArray, FloatArray, IndexArray, RealArray
from cgroup.types.fields import OPTIONAL_FIELDS, Correspondences
from cgroup.types.grouping import Agreement, Grouping, Rule
from cgroup.types.point_cloud import AnyCloud, PointCloud

__all__ = [
    "OPTIONAL_FIELDS", "Agreement", "AnyCloud", "BoolArray", "Correspondences", "FloatArray", "Grouping",
    "IndexArray", "PointCloud", "RealArray", "Rule",
]  # fmt: skip
