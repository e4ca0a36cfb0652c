"""Errors of commands: their exit status and message, in terms of options, and as an object for ``--json``.

An option replaces the parameter of an `InputError`, and parameters between backticks in its message:
```effort='high'``` becomes ``--effort high``.
"""

import os
import traceback
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy
from typing import Any

import typer

from cgroup.cli.documents import Document, as_text, make_document
from cgroup.cli.process import OutputError, write_error
from cgroup.cli.terminal import print_text
from cgroup.errors import CgroupError, InputError, NoConsensusError

INPUT_ERROR = 2
NO_CONSENSUS = 3
UNFORESEEN = 70
OUTPUT_CLOSED = 141
"""Exit statuses, besides that of an interrupt, `cgroup._runtime.interrupts.INTERRUPTED`."""

TRACEBACK = "CGROUP_TRACEBACK"  # environment variable: print the traceback of unexpected errors

# Parameters that another option sets if it is given alone.
_SET_BY = {"source_viewpoint": "viewpoint", "target_viewpoint": "viewpoint", "front": "support"}

# Objects of the library that are files on the command line.
_IN_FILES = {"PointCloud": "file", "Correspondences": "a file", "PreparedMap.save": "--save-map"}


class PrintedRefusalError(NoConsensusError):
    """An unreliable result, which is printed and written nevertheless."""


class RefusedPoseError(NoConsensusError):
    """No reliable pose; `guess` describes the best one, as in a document."""

    def __init__(self, message: str, guess: Document | None = None) -> None:  # a copy has it set
        super().__init__(message)
        self.guess = guess


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
    print_text(as_text(make_document(command, error=described, **extra)))


@contextmanager
def reworded_errors(context: Any) -> Generator[None, None, None]:
    """Reword errors that the library raises within a command."""
    try:
        yield
    except (InputError, NoConsensusError) as error:
        raise reword(error, context) from error


def reword(error: CgroupError, context: Any) -> CgroupError:
    """Return an error in terms of the command's options."""
    options = {
        param.name: param.opts[0] for param in context.command.params if param.param_type_name == "option"
    }
    for name, other in _SET_BY.items():
        if other in options and is_given(context, other) and not is_given(context, name):
            options[name] = options[other]
    options["T_target_source"] = options.get("truth", "pose")
    options |= {"cloud": options.get("map", "cloud"), "keep": options.get("out", "keep")}
    return in_options(error, options)


def in_options(error: CgroupError, options: Mapping[str, str]) -> CgroupError:
    """Return an error with options in place of parameters; `options` are by parameter."""
    if isinstance(error, NoConsensusError):
        reworded = copy(error)
        reworded.args = (_unquote(str(error), options),)
        return reworded
    if not isinstance(error, InputError) or error.parameter is None:
        return InputError(_unquote(str(error), options))
    if error.got == "nothing":  # of a length that follows from no resolution either
        unknown = error.parameter if error.parameter in options else "resolution"
        also = f", or {options[unknown]}, both" if unknown != "resolution" else ","
        resolution = options.get("resolution", "--resolution")
        advice = f"give {resolution}, the mean point spacing of the clouds (cgroup describe prints it)"
        return InputError(unknown, remedy=f"not known; {advice}{also} in the file's unit")
    remedy = None if error.remedy is None else _unquote(error.remedy, options)
    if error.parameter == "max_memory" and remedy is not None:
        return InputError("not enough memory", remedy=remedy.replace("allow that many, or ", ""))
    named = ", ".join(options.get(name, name) for name in error.parameter.split(", "))
    got = None if error.got is None else _unquote(error.got, options)
    return InputError(named, got, remedy)


def _unquote(text: str, options: Mapping[str, str]) -> str:
    """Replace parameters between backticks by options."""
    parts = text.split("`")
    if len(parts) % 2 == 0:
        return text  # a backtick in a name
    for at in range(1, len(parts), 2):
        name, _, value = parts[at].partition("=")
        option = options.get(name, _IN_FILES.get(name))
        parts[at] = name if option is None else " ".join(filter(None, (option, value.strip("'\""))))
    return "".join(parts)


def is_given(context: Any, name: str) -> bool:
    """Whether a parameter was given on the command line."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"
