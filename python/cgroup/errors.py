"""Errors that cgroup raises: each says what, got what, why, and what to do."""

from __future__ import annotations


class CgroupError(Exception):
    """Base of every error that cgroup raises on purpose."""


class InputError(CgroupError, ValueError):
    """An argument that can't be worked with."""


class NoConsensusError(CgroupError, ValueError):
    """The group is too small, or too degenerate, to fix a rigid transform."""
