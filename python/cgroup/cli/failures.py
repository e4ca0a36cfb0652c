"""Failures of commands: exit status, a line of text, and with ``--json`` an object instead of the result."""

from __future__ import annotations

import os
import traceback
from collections.abc import Sequence

import typer

from cgroup.cli.command import PrintedRefusalError, RefusedPoseError
from cgroup.cli.show.json import Document, make_document, print_document
from cgroup.cli.streams import OutputError, write_error
from cgroup.errors import CgroupError, InputError, NoConsensusError

INPUT_ERROR = 2
NO_CONSENSUS = 3
UNFORESEEN = 70
OUTPUT_CLOSED = 141
"""Exit statuses, besides that of an interrupt, `cgroup._runtime.interrupts.INTERRUPTED`."""

TRACEBACK = "CGROUP_TRACEBACK"
"""Environment variable: print the traceback of unexpected errors."""


def explain(error: Exception) -> tuple[int, str]:
    """Return the exit status of an error, and its message."""
    status, message = INPUT_ERROR, str(error)
    match error:
        case OutputError(is_closed=True):
            status, message = OUTPUT_CLOSED, ""
        case typer.TyperException():
            message = " ".join(error.format_message().split()).replace("Value error, ", "")
        case NoConsensusError():
            status = NO_CONSENSUS
        case CgroupError() | OutputError():
            pass
        case MemoryError():
            message = f"not enough memory ({message or 'no further details'}); use less data"
        case ImportError() if "failed to map" in message:  # of a library that is loaded late
            message = f"not enough memory ({message}); allow the process more"
        case OSError():
            message = f"{error.filename or 'the system'}: {error.strerror or message}"
        case _:
            status, message = UNFORESEEN, _ask_for_report(error)
    return status, message


def _ask_for_report(error: Exception) -> str:
    how = f"with the traceback that {TRACEBACK}=1 prints"
    if os.environ.get(TRACEBACK):
        write_error("".join(traceback.format_exception(error)).rstrip())
        how = "with the lines above"
    summary = f"unexpected {type(error).__name__} ({' '.join(str(error).split())})"
    return f"{summary}; this is a bug in cgroup: please report it {how}"


def print_failure(arguments: Sequence[str], error: Exception, status: int, message: str) -> None:
    """Print the object of an error if JSON is wanted and standard output is still writable."""
    if "--json" not in arguments or isinstance(error, OutputError | PrintedRefusalError):
        return
    if isinstance(error, CgroupError):
        kind = (NoConsensusError if isinstance(error, RefusedPoseError) else type(error)).__name__
    else:
        kind = "UsageError" if status == INPUT_ERROR else "UnforeseenError"
    words = list(arguments[: next(at for at, word in enumerate(arguments) if word.startswith("-"))])
    command = " ".join(words[: 2 if words[:1] == ["benchmark"] else 1])
    extra = {"guess": error.guess} if isinstance(error, RefusedPoseError) else {}
    described: Document = {"kind": kind, "message": message, "exit_status": status}
    if isinstance(error, InputError):
        described |= {"parameter": error.parameter, "got": error.got, "remedy": error.remedy}
    print_document(make_document(command, error=described, **extra))
