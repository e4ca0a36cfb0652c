"""Errors of commands that were asked for JSON: an object in place of the result, besides the line of text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.cli.commands.register import registration_results
from cgroup.cli.show.json import Document, make_error, print_document
from cgroup.cli.streams import OutputError
from cgroup.errors import CgroupError, NoConsensusError

if TYPE_CHECKING:
    from collections.abc import Sequence

_ASKED = "--json"


def print_failure(arguments: Sequence[str], error: Exception, status: int, message: str) -> None:
    """Print the object of an error, if the arguments ask for JSON and the output can still be written.

    Parameters
    ----------
    arguments : sequence of str
        Of the command line.
    error : Exception
        What ended the command.
    status, message
        What it ends with, and what is said of it.
    """
    if _ASKED not in arguments or isinstance(error, OutputError):
        return
    known = isinstance(error, CgroupError)
    kind = type(error).__name__ if known else "UsageError" if status == 2 else "UnforeseenError"
    guess: Document = {}
    if isinstance(error, NoConsensusError) and error.registration is not None:
        guess = {"guess": registration_results(error.registration)}
    print_document(make_error(_command(arguments), kind, message, status, **guess))


def _command(arguments: Sequence[str]) -> str:
    """Return the words before the first option: the command, and what it was told first."""
    words: list[str] = []
    for word in arguments:
        if word.startswith("-"):
            break
        words.append(word)
    nested = words[:1] in (["benchmark"], ["results"])
    return " ".join(words[: 2 if nested else 1])
