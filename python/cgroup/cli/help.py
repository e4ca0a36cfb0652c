"""How ``--help`` looks: plain text, aligned, at most 80 columns, options by topic, examples at the end."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import typer
from typer.core import TyperCommand, TyperGroup

from cgroup.cli.colors import paint
from cgroup.cli.wording import reworded_errors

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

_LAST = ("Output", "Options")
_WIDEST_NAME = 34
_KEEP = "\N{NO-BREAK SPACE}"


class _Help:
    """Writes the parts of a help text; what it writes into wraps and indents."""

    epilog: str | None
    help: str | None

    def get_help(self, ctx: Any) -> str:  # noqa: ANN401 - typer keeps the types to itself
        return cast("TyperCommand", super()).get_help(ctx).replace(_KEEP, " ")

    def format_usage(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        pieces = ["[OPTIONS]"]
        for param in self._params(ctx):
            if param.param_type_name == "argument":
                piece = param.metavar + ("..." if param.nargs != 1 else "")
                pieces.append(piece if param.required else f"[{piece}]")
            elif param.required:
                pieces.append(f"{param.opts[0]} {param.metavar}")
        if isinstance(self, TyperGroup):
            pieces += ["COMMAND", "..."]
        formatter.write_usage(ctx.command_path, " ".join(pieces), prefix=_heading("Usage: "))

    def format_help_text(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401, ARG002
        for paragraph in (self.help or "").split("\n\n"):
            formatter.write_paragraph()
            formatter.write_text(" ".join(paragraph.split()))

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        sections: dict[str, list[tuple[str, str]]] = {}
        if isinstance(self, TyperGroup):
            sections["Commands"] = list(self._list_commands(ctx))
        for param in self._params(ctx):
            is_argument = param.param_type_name == "argument"
            title = "Arguments" if is_argument else param.rich_help_panel or _LAST[-1]
            sections.setdefault(title, []).append((_name(param), _explanation(param)))
        for title in _LAST:
            if title in sections:
                sections[title] = sections.pop(title)
        for title, rows in sections.items():
            formatter.write_paragraph()
            formatter.write(_heading(f"{title}:") + "\n")
            formatter.indent()
            formatter.write_dl(rows, col_max=_WIDEST_NAME)
            formatter.dedent()

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401, ARG002
        if not self.epilog:
            return
        formatter.write_paragraph()
        title, _, rest = self.epilog.partition("\n")
        formatter.write("\n".join([_heading(title), rest.rstrip()]) + "\n")

    def _list_commands(self, ctx: Any) -> Iterable[tuple[str, str]]:  # noqa: ANN401
        group = cast("TyperGroup", self)
        for name in group.list_commands(ctx):
            command = group.get_command(ctx, name)
            if command is not None and not command.hidden:
                yield paint(name, fg="cyan"), (command.short_help or _first_sentence(command.help or ""))

    def _params(self, ctx: Any) -> Sequence[Any]:  # noqa: ANN401
        params = cast("TyperCommand", self).get_params(ctx)
        return [param for param in params if not getattr(param, "hidden", False)]


class Command(_Help, TyperCommand):
    """A command with such a help text; its errors speak of its options."""

    def invoke(self, ctx: Any) -> Any:  # noqa: ANN401
        """Run it."""
        with reworded_errors(ctx):
            return super().invoke(ctx)


class Group(_Help, TyperGroup):
    """A group of commands with such a help text."""


def make_app(**options: Any) -> typer.Typer:  # noqa: ANN401 - those of typer
    """Return an empty set of commands."""
    return typer.Typer(cls=Group, rich_markup_mode=None, pretty_exceptions_enable=False, **options)


def examples(*lines: str) -> str:
    """Return the end of a help text: commands as they are typed, comments above them."""
    return "\n".join(["Examples:", *(f"  {line}".rstrip() for line in lines)])


def _heading(text: str) -> str:
    return paint(text, bold=True, fg="green")


def _name(param: Any) -> str:  # noqa: ANN401
    if param.param_type_name == "argument":
        return paint(param.metavar + ("..." if param.nargs != 1 else ""), fg="cyan")
    names = paint(", ".join(param.opts), fg="cyan")
    return f"{names} {param.metavar}" if param.metavar and not param.is_flag else names


def _explanation(param: Any) -> str:  # noqa: ANN401
    default = _default(param)
    extra = "[required]" if param.required and param.param_type_name == "option" else default
    return f"{param.help or ''} {extra}".strip()


def _default(param: Any) -> str:  # noqa: ANN401
    shown, value = param.show_default, param.default
    if isinstance(shown, str):
        return f"[default:{_KEEP}{shown}]"
    if not shown or value is None or isinstance(value, bool) or callable(value):
        return ""
    return f"[default:{_KEEP}{value:g}]" if isinstance(value, float) else f"[default:{_KEEP}{value}]"


def _first_sentence(text: str) -> str:
    return " ".join(text.split("\n\n", maxsplit=1)[0].split()).rstrip(".")
