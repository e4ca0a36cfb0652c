"""Pairs of clouds with a known pose."""

from cgroup.datasets.base import MatchingPair
from cgroup.datasets.standin import standin_pair

__all__ = ["MatchingPair", "standin_pair"]
