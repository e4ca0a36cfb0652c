"""Help texts with sections by topic and examples; errors of a command speak of its options."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar, cast

import typer
from typer.core import TyperCommand, TyperGroup

from cgroup.cli.show.colors import paint
from cgroup.cli.wording import reworded_errors

if TYPE_CHECKING:
    from collections.abc import Iterator

_Function = TypeVar("_Function", bound=Callable[..., Any])

_LAST = ("Output", "Options")
_WIDEST_NAME = 34
_KEEP = "\N{NO-BREAK SPACE}"


class _Help:
    """The parts of a help text that differ from typer's."""

    def get_help(self, ctx: Any) -> str:  # noqa: ANN401 - typer keeps the types to itself
        return cast("TyperCommand", super()).get_help(ctx).replace(_KEEP, " ")

    def collect_usage_pieces(self, ctx: Any) -> list[str]:  # noqa: ANN401
        pieces = ["[OPTIONS]"]
        for param in _params(self, ctx):
            if param.param_type_name == "argument":
                pieces.append(_name(param) if param.required else f"[{_name(param)}]")
            elif param.required:
                pieces.append(f"{param.opts[0]} {param.metavar}")
        return [*pieces, "COMMAND", "..."] if isinstance(self, TyperGroup) else pieces

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        sections: dict[str, list[tuple[str, str]]] = {}
        if isinstance(self, TyperGroup):
            sections["Commands"] = list(_list_commands(self, ctx))
        for param in _params(self, ctx):
            is_argument = param.param_type_name == "argument"
            title = "Arguments" if is_argument else param.rich_help_panel or _LAST[-1]
            sections.setdefault(title, []).append((_name(param), _explanation(param)))
        for title in _LAST:
            if title in sections:
                sections[title] = sections.pop(title)
        for title, rows in sections.items():
            with formatter.section(paint(title, bold=True, fg="green")):
                formatter.write_dl([(paint(name, fg="cyan"), text) for name, text in rows], _WIDEST_NAME)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401, ARG002
        title, _, lines = (cast("TyperCommand", self).epilog or "").partition("\n")
        formatter.write_paragraph()
        formatter.write(f"{paint(title, bold=True, fg='green')}\n{lines}\n")


class Command(_Help, TyperCommand):
    """A command whose errors speak of its options."""

    def invoke(self, ctx: Any) -> Any:  # noqa: ANN401
        """Run it."""
        with reworded_errors(ctx):
            return super().invoke(ctx)


class Group(_Help, TyperGroup):
    """A group of commands."""


def make_app(**options: Any) -> typer.Typer:  # noqa: ANN401 - those of typer
    """Return an empty set of commands."""
    return typer.Typer(cls=Group, rich_markup_mode=None, pretty_exceptions_enable=False, **options)


def examples(*lines: str) -> str:
    """Return the end of a help text: commands as they are typed, comments above them."""
    return "\n".join(["Examples:", *(f"  {line}".rstrip() for line in lines)])


def command(app: typer.Typer, name: str, *lines: str) -> Callable[[_Function], _Function]:
    """Make a function a command, with these examples in its help text."""
    return app.command(name, cls=Command, epilog=examples(*lines))


def _list_commands(group: TyperGroup, ctx: Any) -> Iterator[tuple[str, str]]:  # noqa: ANN401
    """List the commands of a group, each with its first sentence in full."""
    for name in group.list_commands(ctx):
        command = group.get_command(ctx, name)
        if command is not None and not command.hidden:
            yield name, command.get_short_help_str(limit=1000).rstrip(".")


def _params(command: Any, ctx: Any) -> list[Any]:  # noqa: ANN401
    return [param for param in command.get_params(ctx) if not param.hidden]


def _name(param: Any) -> str:  # noqa: ANN401
    if param.param_type_name == "argument":
        return param.metavar + ("..." if param.nargs != 1 else "")
    return " ".join(
        [", ".join(param.opts), *([param.metavar] if param.metavar and not param.is_flag else [])]
    )


def _explanation(param: Any) -> str:  # noqa: ANN401
    if param.required and param.param_type_name == "option":
        return f"{param.help} [required]"
    default = param.show_default if isinstance(param.show_default, str) else param.default
    if not param.show_default or default is None or isinstance(default, bool):
        return str(param.help)
    shown = f"{default:g}" if isinstance(default, float) else default
    return f"{param.help} [default:{_KEEP}{shown}]"
