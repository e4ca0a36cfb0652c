"""Errors of the library in the terms of the command line: options in place of parameters.

A message of the library reads ``what: got this; do that``. Where `what` names parameters of the command,
its options stand in their place. In the rest, names of parameters stand between backticks, with a value
where one is advised: ```effort='high'``` becomes ``--effort high``.
"""

from __future__ import annotations

import re
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from cgroup.errors import InputError, NoConsensusError

if TYPE_CHECKING:
    from collections.abc import Generator, Mapping

    from cgroup.errors import CgroupError

_NAMES = re.compile(r"[A-Za-z_]\w*(, [A-Za-z_]\w*)*(?=: )")
_QUOTED = re.compile(r"`(?P<name>\w+)(?:=(?P<quote>['\"]?)(?P<value>[^`'\"]*)(?P=quote))?`")

_SET_BY = {"source_viewpoint": "viewpoint", "target_viewpoint": "viewpoint"}
"""Options that a more general one sets, where it is given alone."""

_IN_FILES = {"PointCloud": "file", "Correspondences": "a file"}
"""Objects of the library that the command line reads from files."""

_MISSING_LENGTH = "got nothing"
"""How the core begins where a length is known neither by itself nor by the resolution."""

_NEEDS_MEMORY = "max_memory"
"""The parameter that the core names where a computation needs more memory than it may take."""


@contextmanager
def reworded_errors(context: Any) -> Generator[None, None, None]:  # noqa: ANN401 - typer's
    """Reword what the library raises within a command."""
    try:
        yield
    except NoConsensusError as error:
        reworded = NoConsensusError(reword(error, context))
        reworded.registration = error.registration
        raise reworded from error
    except InputError as error:
        raise InputError(reword(error, context)) from error


def reword(error: CgroupError, context: Any) -> str:  # noqa: ANN401
    """Return the message of an error in terms of the command's options."""
    return in_options(str(error), _options_of(context))


def in_options(message: str, options: Mapping[str, str]) -> str:
    """Return a message with options in place of the parameters that it names.

    Parameters
    ----------
    message : str
        Of a `CgroupError`.
    options : mapping of str to str
        Option by parameter, of the command that met the error.

    Returns
    -------
    str
        The same statement.
    """
    heads = _NAMES.match(message)
    what, rest = ("", message) if heads is None else (heads[0], message[heads.end() :])
    names = what.split(", ")
    if rest.startswith(f": {_MISSING_LENGTH}; "):
        unknown = names[0] if names[0] in options else "resolution"
        return f"{unknown}: not known; {_advise_on_lengths(unknown, options)}"
    if what == _NEEDS_MEMORY:
        reason = rest.partition("; ")[2].replace("allow that many, or ", "")
        return f"not enough memory: {reason}"
    return ", ".join(options.get(name, name) for name in names) + _QUOTED.sub(
        lambda quoted: _unquote(quoted, options), rest
    )


def _advise_on_lengths(name: str, options: Mapping[str, str]) -> str:
    advice = f"give {options.get('resolution', '--resolution')}, the mean point spacing of the clouds"
    also = f", or {options[name]}, both" if name != "resolution" else ","
    return f"{advice}{also} in the file's unit"


def _unquote(quoted: re.Match[str], options: Mapping[str, str]) -> str:
    option = options.get(quoted["name"], _IN_FILES.get(quoted["name"]))
    if option is None:
        return quoted["name"]
    return option if quoted["value"] is None else f"{option} {quoted['value']}"


def _options_of(context: Any) -> dict[str, str]:  # noqa: ANN401
    """Return the options of a command by their parameters."""
    options = {
        param.name: param.opts[0] for param in context.command.params if param.param_type_name == "option"
    }
    for name, general in _SET_BY.items():
        if general in options and is_given(context, general) and not is_given(context, name):
            options[name] = options[general]
    options["T_target_source"] = options.get("truth", "pose")
    return options


def is_given(context: Any, name: str) -> bool:  # noqa: ANN401
    """Tell whether a parameter was given on the command line."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"
