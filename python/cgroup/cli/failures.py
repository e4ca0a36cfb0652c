"""How commands fail: an exit status, a line of text, and with ``--json`` an object in place of the result."""

from __future__ import annotations

import os
import traceback
from collections.abc import Sequence

import typer

from cgroup.cli.command import PrintedRefusalError
from cgroup.cli.commands.register import RefusedPoseError
from cgroup.cli.show.json import Document, make_document, print_document
from cgroup.cli.streams import OutputError, write_error
from cgroup.errors import CgroupError, InputError, NoConsensusError

INPUT_ERROR = 2
NO_CONSENSUS = 3
UNFORESEEN = 70
OUTPUT_CLOSED = 141
"""Exit statuses, besides that of an interrupt, `cgroup._runtime.interrupts.INTERRUPTED`."""

TRACEBACK = "CGROUP_TRACEBACK"
"""Environment variable that asks for the traceback of errors that nobody foresaw."""

_NESTED = ("benchmark", "results")


def explain(error: Exception) -> tuple[int, str]:
    """Return the exit status of an error, and a sentence."""
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
            message = f"not enough memory ({message or 'the system says no more'}); give less data"
        case ImportError() if "failed to map" in message:  # of a library that is loaded late
            message = f"not enough memory ({message}); allow the process more"
        case OSError():
            message = f"{error.filename or 'the system'}: {error.strerror or message}"
        case _:
            status, message = UNFORESEEN, _ask_for_report(error)
    return status, message


def _ask_for_report(error: Exception) -> str:
    how = f"with what {TRACEBACK}=1 in the environment shows"
    if os.environ.get(TRACEBACK):
        write_error("".join(traceback.format_exception(error)).rstrip())
        how = "with the lines above"
    what = f"unforeseen {type(error).__name__} ({' '.join(str(error).split())})"
    return f"{what}; this is an error of cgroup: please report it {how}"


def print_failure(arguments: Sequence[str], error: Exception, status: int, message: str) -> None:
    """Print the object of an error, if the arguments ask for JSON and the output can still be written."""
    if "--json" not in arguments or isinstance(error, OutputError | PrintedRefusalError):
        return
    if isinstance(error, CgroupError):
        kind = (NoConsensusError if isinstance(error, RefusedPoseError) else type(error)).__name__
    else:
        kind = "UsageError" if status == INPUT_ERROR else "UnforeseenError"
    words = list(arguments[: next(at for at, word in enumerate(arguments) if word.startswith("-"))])
    command = " ".join(words[: 2 if words[:1] and words[0] in _NESTED else 1])
    extra = {"guess": error.guess} if isinstance(error, RefusedPoseError) else {}
    said: Document = {"kind": kind, "message": message, "exit_status": status}
    if isinstance(error, InputError):
        said |= {"parameter": error.parameter, "got": error.got, "remedy": error.remedy}
    print_document(make_document(command, error=said, **extra))
