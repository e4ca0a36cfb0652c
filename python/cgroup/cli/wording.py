"""Errors of the library in the terms of the command line: options in place of parameters.

The command's option stands for the parameter of an `InputError`. In the rest of a message, parameters stand
between backticks, with a value where one is advised: ```effort='high'``` becomes ``--effort high``.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from cgroup.errors import CgroupError, InputError, NoConsensusError

if TYPE_CHECKING:
    from collections.abc import Generator, Mapping

_SET_BY = {"source_viewpoint": "viewpoint", "target_viewpoint": "viewpoint"}
"""Options that a more general one sets, where it is given alone."""

_IN_FILES = {"PointCloud": "file", "Correspondences": "a file"}
"""Objects of the library that the command line reads from files."""

_MISSING_LENGTH = "nothing"
"""What the core got where a length is known neither by itself nor by the resolution."""

_NEEDS_MEMORY = "max_memory"
"""The parameter that the core names where a computation needs more memory than it may take."""


@contextmanager
def reworded_errors(context: Any) -> Generator[None, None, None]:
    """Reword what the library raises within a command."""
    try:
        yield
    except (InputError, NoConsensusError) as error:
        raise reword(error, context) from error


def reword(error: CgroupError, context: Any) -> CgroupError:
    """Return an error in terms of the command's options."""
    return in_options(error, _options_of(context))


def in_options(error: CgroupError, options: Mapping[str, str]) -> CgroupError:
    """Return an error with options in place of the parameters that it names.

    Parameters
    ----------
    error : CgroupError
        As the library raised it.
    options : mapping of str to str
        Option by parameter, of the command that met the error.
    """
    if isinstance(error, NoConsensusError):
        reworded = NoConsensusError(_unquote(str(error), options))
        reworded.registration = error.registration
        return reworded
    if not isinstance(error, InputError) or error.parameter is None:
        return InputError(_unquote(str(error), options))
    if error.got == _MISSING_LENGTH:
        unknown = error.parameter if error.parameter in options else "resolution"
        return InputError(unknown, remedy=f"not known; {_advise_on_lengths(unknown, options)}")
    remedy = None if error.remedy is None else _unquote(error.remedy, options)
    if error.parameter == _NEEDS_MEMORY and remedy is not None:
        return InputError("not enough memory", remedy=remedy.replace("allow that many, or ", ""))
    named = ", ".join(options.get(name, name) for name in error.parameter.split(", "))
    got = None if error.got is None else _unquote(error.got, options)
    return InputError(named, got, remedy)


def _advise_on_lengths(name: str, options: Mapping[str, str]) -> str:
    advice = f"give {options.get('resolution', '--resolution')}, the mean point spacing of the clouds"
    also = f", or {options[name]}, both" if name != "resolution" else ","
    return f"{advice}{also} in the file's unit"


def _unquote(text: str, options: Mapping[str, str]) -> str:
    """Put options where parameters stand between backticks."""
    plain, *rest = text.split("`")
    if len(rest) % 2:
        return text  # a backtick of somebody else's
    return plain + "".join(
        _option_of(quoted, options) + after for quoted, after in zip(rest[::2], rest[1::2], strict=True)
    )


def _option_of(quoted: str, options: Mapping[str, str]) -> str:
    name, _, value = quoted.partition("=")
    option = options.get(name, _IN_FILES.get(name))
    if option is None:
        return name
    return " ".join(filter(None, (option, value.strip("'\""))))


def _options_of(context: Any) -> dict[str, str]:
    """Return the options of a command by their parameters."""
    options = {
        param.name: param.opts[0] for param in context.command.params if param.param_type_name == "option"
    }
    for name, general in _SET_BY.items():
        if general in options and is_given(context, general) and not is_given(context, name):
            options[name] = options[general]
    options["T_target_source"] = options.get("truth", "pose")
    return options


def is_given(context: Any, name: str) -> bool:
    """Tell whether a parameter was given on the command line."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"
