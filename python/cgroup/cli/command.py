"""Commands: their help with sections by topic and examples, and where their results go."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection
from functools import wraps
from inspect import Parameter, signature
from typing import Any, TypeVar, cast

import typer
from typer.core import TyperCommand, TyperGroup

from cgroup import __version__
from cgroup.cli.options import FRONT, JSON, OUTPUT, SAVE, VERBOSE, WIDE
from cgroup.cli.saved_runs import save_run
from cgroup.cli.show.json import make_document, print_document
from cgroup.cli.show.terminal import paint, print_line
from cgroup.cli.wording import reworded_errors
from cgroup.errors import NoConsensusError
from cgroup.io._files import digests_of_inputs, keeping_inputs

_Function = TypeVar("_Function", bound=Callable[..., Any])

_LAST = (OUTPUT, "Options")
_WIDEST_NAME = 34
_KEEP = "\N{NO-BREAK SPACE}"


class PrintedRefusalError(NoConsensusError):
    """A result that can't be trusted, though it is printed and written."""


class _Help:
    """The parts of a help text that differ from typer's."""

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
    """A command whose errors speak of its options."""

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


def examples(*lines: str) -> str:
    """Return the end of a help text: commands as they are typed, comments above them."""
    return "\n".join(["Examples:", *(f"  {line}".rstrip() for line in lines)])


def command(
    app: typer.Typer,
    name: str,
    *lines: str,
    show: Callable[..., None] = lambda _: None,
    takes: Collection[str] = (),
    saves: bool = False,
) -> Callable[[_Function], _Function]:
    """Make a function a command, with these examples in its help text.

    The function returns what its document says, or nothing where it has printed by itself. `show` prints the
    document; it gets what it has parameters for of the command's arguments and options. Parameters `wide` and
    `verbose` give the command options of these names. Every command has ``--json``; one that `saves` has
    ``--save``. Of the options in `FRONT`, the function gets those that it `takes` by keyword. A document with
    a `refusal` is printed and saved like others, and the command then ends with that sentence and exit
    status 3.
    """
    shown = list(signature(show).parameters)[1:]
    common: dict[str, tuple[Any, Any]] = {name: FRONT[name] for name in takes}
    common |= {"save": (str | None, SAVE)} if saves else {}
    common |= {"as_json": (bool, JSON), "context": (typer.Context, Parameter.empty)}
    common |= {name: (bool, kind) for name, kind in (("wide", WIDE), ("verbose", VERBOSE)) if name in shown}

    def decorate(function: _Function) -> _Function:
        parameters = signature(function, eval_str=True).parameters.values()
        own = {one.name: one for one in parameters if one.kind != Parameter.VAR_KEYWORD}
        more = [
            Parameter(option, Parameter.KEYWORD_ONLY, annotation=kind, default=described)
            for option, (kind, described) in common.items()
            if option not in own
        ]

        @wraps(function)
        def run(**given: Any) -> None:
            said = function(**{name: given[name] for name in (*own, *takes)})
            if said is None:
                return
            context, saved, refusal = given["context"], given.get("save"), said.pop("refusal", None)
            if "inputs" in said:
                options = {**_options_of(context), **said.pop("options", {})}
                said = {"inputs": said.pop("inputs"), "options": options, **said}
            document = make_document(context.command_path.partition(" ")[2], **said)
            if saved:
                save_run(saved, document)
            if given["as_json"]:
                print_document(document)
            else:
                show(document, **{name: given[name] for name in shown})
            if saved and not given["as_json"]:
                print_line(f"saved as {saved.stem}; see: cgroup results")
            if refusal is not None:
                raise PrintedRefusalError(refusal)

        taken = [*own.values(), *more]
        run.__annotations__ = {one.name: one.annotation for one in taken}
        vars(run)["__signature__"] = signature(function).replace(parameters=taken)
        app.command(name, cls=_Command, epilog=examples(*lines))(run)
        return function

    return decorate


def identify_run(context: Any) -> str:
    """Return a digest of all that the results of a command depend on: what it was given, and has read."""
    arguments = {one.name for one in context.command.params if one.param_type_name == "argument"}
    given = {name: value for name, value in context.params.items() if name in arguments}
    told = context.command_path, __version__, given, _options_of(context), sorted(digests_of_inputs().items())
    return hashlib.sha256(repr(told).encode(errors="surrogateescape")).hexdigest()


def _options_of(context: Any) -> dict[str, Any]:
    """List the options that shape a command's result, defaults included."""
    others = {
        param.name
        for param in context.command.params
        if param.param_type_name == "argument" or param.rich_help_panel == OUTPUT
    }
    return {name: value for name, value in context.params.items() if name not in others}
