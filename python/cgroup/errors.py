"""Errors that cgroup raises: each names the argument, its value, the reason, and a remedy.

All of them are a `CgroupError`, so that one ``except`` catches them; `InputError` and `NoConsensusError` are
a `ValueError` too, `OutOfMemoryError` a `MemoryError`.
"""

from typing import Any

__all__ = ["CgroupError", "InputError", "NoConsensusError", "OutOfMemoryError"]


class CgroupError(Exception):
    """Base of every error that cgroup raises."""


class InputError(CgroupError, ValueError):
    """An argument or a file is invalid.

    Also a `ValueError`. The message names the argument, its value, and a remedy.

    Parameters
    ----------
    what : str
        The argument, or several, such as "nms_radius, voxel"; or the whole message, if no argument is at
        fault. The attribute `parameter` has its name, or None.
    got : object, optional
        Its value, as ``str()`` shows it.
    remedy : str, optional
        An instruction how to fix the call.

    Examples
    --------
    >>> import cgroup
    >>> cgroup.nnsr([0.5, 0.9], max_ratio=8)
    Traceback (most recent call last):
        ...
    cgroup.errors.InputError: max_ratio: got 8; give a number between 0 and 1
    >>> try:
    ...     cgroup.nnsr([0.5, 0.9], max_ratio=8)
    ... except cgroup.InputError as error:
    ...     print(error.parameter, error.got, error.remedy, sep=", ")
    max_ratio, 8, give a number between 0 and 1
    """

    def __init__(self, what: str, got: object = None, remedy: str | None = None) -> None:
        reasons = [*([] if got is None else [f"got {got}"]), *([] if remedy is None else [remedy])]
        self.parameter = what if reasons else None
        self.got = None if got is None else str(got)
        self.remedy = remedy
        super().__init__(f"{what}: {'; '.join(reasons)}" if reasons else what)


class OutOfMemoryError(CgroupError, MemoryError):
    """The system cannot provide the memory or threads that a computation needs.

    Also a `MemoryError`. The process continues: free memory, or give fewer points or threads, and call again.
    """


class NoConsensusError(CgroupError, ValueError):
    """No pose is determined by the group, or none is confirmed by the surfaces.

    Also a `ValueError`.

    Attributes
    ----------
    registration : cgroup.registration.Registration or None
        The best guess of `cgroup.registration.register`, which is probably wrong; None where no
        registration was asked for.

    Examples
    --------
    >>> import numpy as np
    >>> import cgroup
    >>> group = cgroup.gtm(np.eye(3)[:2], np.eye(3)[:2])
    >>> group.transform()
    Traceback (most recent call last):
        ...
    cgroup.errors.NoConsensusError: no consensus: the group has 2 correspondences; a rigid transform needs 3
    """

    registration: Any = None
