"""Errors that cgroup raises: each says what, got what, why, and what to do."""

from __future__ import annotations

from typing import Any


class CgroupError(Exception):
    """Base of every error that cgroup raises on purpose."""


class InputError(CgroupError, ValueError):
    """An argument or a file that can't be worked with; `docs/errors.md` has the rule for arguments."""


class OutOfMemoryError(CgroupError, MemoryError):
    """The system gave no memory for a block that the computation needs."""


class NoConsensusError(CgroupError, ValueError):
    """No pose: the group doesn't fix one, or the surfaces don't confirm any.

    Attributes
    ----------
    registration : cgroup.registration.Registration or None
        The best guess of `cgroup.registration.register`, which is more likely wrong than right.
    """

    registration: Any = None
