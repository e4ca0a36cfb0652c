"""Errors of the library in terms of the command line: options replace parameters.

An option replaces the parameter of an `InputError`, and parameters between backticks in its message:
```effort='high'``` becomes ``--effort high``.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from copy import copy
from typing import Any

from cgroup.errors import CgroupError, InputError, NoConsensusError

_SET_BY = {"source_viewpoint": "viewpoint", "target_viewpoint": "viewpoint", "front": "support"}
"""Parameters that another option sets if it is given alone."""

_IN_FILES = {"PointCloud": "file", "Correspondences": "a file", "PreparedMap.save": "--save-map"}
"""Objects of the library that are files on the command line."""


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
    options["cloud"] = options.get("map", "cloud")
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
