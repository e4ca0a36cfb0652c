"""Commands: help texts with sections by topic and examples, documents of results, exit statuses."""

import hashlib
from collections.abc import Callable, Collection
from functools import wraps
from inspect import Parameter, signature
from typing import Any, TypeVar, cast

import typer
from typer.core import TyperCommand, TyperGroup

from cgroup import __version__
from cgroup.cli.documents import Document, as_text, make_document
from cgroup.cli.errors import PrintedRefusalError, reworded_errors
from cgroup.cli.options import JSON, OUTPUT, SHARED, VERBOSE, WIDE
from cgroup.cli.terminal import paint, print_text
from cgroup.io.files import digests_of_inputs, keeping_inputs

_Function = TypeVar("_Function", bound=Callable[..., Any])

_PRINTING = {"wide": WIDE, "verbose": VERBOSE}
_LAST = (OUTPUT, "Options")
_WIDEST_NAME = 34
_KEEP = "\N{NO-BREAK SPACE}"


class _Help:
    """Changes to typer's help texts."""

    def get_help(self, ctx: Any) -> str:
        return cast("TyperCommand", super()).get_help(ctx).replace(_KEEP, " ")

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        pieces = ["[OPTIONS]"]
        for param in _params(self, ctx):
            if param.param_type_name == "argument":
                pieces.append(_name(param) if param.required else f"[{_name(param)}]")
            elif param.required:
                pieces.append(f"{param.opts[0]} {param.metavar}")
        return [*pieces, "COMMAND", "..."] if isinstance(self, TyperGroup) else pieces

    def format_options(self, ctx: Any, formatter: Any) -> None:
        sections: dict[str, list[tuple[str, str]]] = {}
        if isinstance(self, TyperGroup):
            # The first sentence of each in full.
            commands = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
            sections["Commands"] = [
                (name, command.get_short_help_str(limit=1000).rstrip("."))
                for name, command in commands
                if command
            ]
        for param in _params(self, ctx):
            is_argument = param.param_type_name == "argument"
            title = "Arguments" if is_argument else param.rich_help_panel or _LAST[-1]
            sections.setdefault(title, []).append((_name(param), _explanation(param)))
        for title in sorted(sections, key=lambda title: _LAST.index(title) if title in _LAST else -1):
            with formatter.section(paint(title, bold=True, fg="green")):
                formatter.write_dl(
                    [(paint(name, fg="cyan"), text) for name, text in sections[title]], _WIDEST_NAME
                )

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        title, _, lines = (cast("TyperCommand", self).epilog or "").partition("\n")
        formatter.write_paragraph()
        formatter.write(f"{paint(title, bold=True, fg='green')}\n{lines}\n")


class _Command(_Help, TyperCommand):
    """A command; its errors name options in place of parameters."""

    def invoke(self, ctx: Any) -> Any:
        with reworded_errors(ctx), keeping_inputs():
            return super().invoke(ctx)


class _Group(_Help, TyperGroup):
    """A group of commands."""


def _params(command: Any, ctx: Any) -> list[Any]:
    return [param for param in command.get_params(ctx) if not param.hidden]


def _name(param: Any) -> str:
    if param.param_type_name == "argument":
        return param.metavar + ("..." if param.nargs != 1 else "")
    value = f" {param.metavar}" if param.metavar and not param.is_flag else ""
    return ", ".join(param.opts) + value


def _explanation(param: Any) -> str:
    if param.required and param.param_type_name == "option":
        return f"{param.help} [required]"
    default = param.show_default if isinstance(param.show_default, str) else param.default
    if not param.show_default or default is None or isinstance(default, bool):
        return str(param.help)
    shown = f"{default:g}" if isinstance(default, float) else default
    return f"{param.help} [default:{_KEEP}{shown}]"


def make_app(**options: Any) -> typer.Typer:
    """Return an empty set of commands."""
    return typer.Typer(cls=_Group, rich_markup_mode=None, pretty_exceptions_enable=False, **options)


COMMANDS = make_app()


def examples(first: str, *others: str) -> str:
    """Return the examples of a help text: commands, below comments after an empty line."""
    spaced = [("\n" if line.startswith("#") else "") + f"  {line}".rstrip() for line in others]
    return "\n".join(["Examples:", f"  {first}", *spaced])


def command(
    name: str,
    *lines: str,
    show: Callable[..., None] = lambda _: None,
    takes: Collection[str] = (),
    app: typer.Typer = COMMANDS,
) -> Callable[[_Function], _Function]:
    """Make a function a command, with these examples in its help text.

    The function returns the parts of its document, or None if it has printed by itself. `show` prints the
    document; its further parameters are arguments and options of the command, which gets options ``--wide``
    and ``--verbose`` if `show` has parameters of these names. Every command has ``--json``. The function gets
    the options of `SHARED` that it `takes` by keyword. A document with a `refusal` is printed too, and the
    command ends with that sentence and exit status 3.
    """
    shown = list(signature(show).parameters)[1:]
    shared = {option: _parameter(option, *SHARED[option]) for option in takes}
    output = {option: _parameter(option, bool, _PRINTING[option]) for option in _PRINTING if option in shown}
    output["as_json"] = _parameter("as_json", bool, JSON)
    output["context"] = _parameter("context", typer.Context, Parameter.empty)

    def decorate(function: _Function) -> _Function:
        parameters = signature(function, eval_str=True).parameters.values()
        own = {one.name: one for one in parameters if one.kind != Parameter.VAR_KEYWORD}
        arguments = {name: one for name, one in own.items() if one.kind != Parameter.KEYWORD_ONLY}
        # Sections of the help text are in the order of their first options.
        taken = [*{**arguments, **shared, **own, **output, **own}.values()]

        @wraps(function)
        def run(**given: Any) -> None:
            parts = function(**{name: given[name] for name in (*own, *takes)})
            if parts is None:
                return
            refusal = parts.pop("refusal", None)
            document = _document(given["context"], parts)
            if given["as_json"]:
                print_text(as_text(document))
            else:
                show(document, **{name: given[name] for name in shown})
            if refusal is not None:
                raise PrintedRefusalError(refusal)

        run.__annotations__ = {one.name: one.annotation for one in taken}
        vars(run)["__signature__"] = signature(function).replace(parameters=taken)
        app.command(name, cls=_Command, epilog=examples(*lines))(run)
        return function

    return decorate


def _parameter(name: str, kind: Any, described: Any) -> Parameter:
    return Parameter(name, Parameter.KEYWORD_ONLY, annotation=kind, default=described)


def _document(context: Any, parts: Document) -> Document:
    """Make the document of a command; those with inputs list the options too."""
    if "inputs" in parts:
        options = {**_options_of(context), **parts.pop("options", {})}
        parts = {"inputs": parts.pop("inputs"), "options": options, **parts}
    return make_document(context.command_path.partition(" ")[2], **parts)


def identify_run(context: Any) -> str:
    """Return a digest of all inputs of a command's results: arguments, options, contents of files."""
    arguments = {one.name for one in context.command.params if one.param_type_name == "argument"}
    given = {name: value for name, value in context.params.items() if name in arguments}
    digests = sorted(digests_of_inputs().items())
    basis = context.command_path, __version__, given, _options_of(context), digests
    return hashlib.sha256(repr(basis).encode(errors="surrogateescape")).hexdigest()


def _options_of(context: Any) -> dict[str, Any]:
    """Return the options that a command's result depends on, defaults included."""
    others = {
        param.name
        for param in context.command.params
        if param.param_type_name == "argument" or param.rich_help_panel == OUTPUT
    }
    return {name: value for name, value in context.params.items() if name not in others}
