"""The command line: reads, calls the library, prints, writes. Nothing is computed here."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

try:
    import typer

    from cgroup.cli import benchmark, cloud, compare, matches, pair, recognize
    from cgroup.cli.terminal import INPUT_ERROR, INTERRUPTED, NO_CONSENSUS, print_line
except ModuleNotFoundError as missing:
    sys.stderr.write(f"cgroup: the command line needs {missing.name}; pip install 'cgroup[scans]'\n")
    raise SystemExit(2) from None

from cgroup import __version__
from cgroup.errors import CgroupError, NoConsensusError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import NoReturn

app = typer.Typer(
    name="cgroup",
    help="3D correspondence grouping: find the right matches between two scans among mostly wrong ones.",
    add_completion=False,
    pretty_exceptions_enable=False,
)
for commands in (pair, recognize, compare, cloud, matches):
    app.add_typer(commands.app)
app.add_typer(benchmark.app, name="benchmark")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit.

    Exit status: 0 done, 2 input that can't be worked with, 3 no pose that can be trusted, 130 interrupted.
    """
    try:
        status = app(args=arguments, prog_name="cgroup", standalone_mode=False)
    except (CgroupError, typer.TyperException) as error:
        message = error.format_message() if isinstance(error, typer.TyperException) else str(error)
        _fail(message, NO_CONSENSUS if isinstance(error, NoConsensusError) else INPUT_ERROR)
    except KeyboardInterrupt:
        status = INTERRUPTED
    if status == INTERRUPTED:
        _fail("interrupted", INTERRUPTED)
    raise SystemExit(status or 0)


@app.callback(invoke_without_command=True)
def _without_command(
    context: typer.Context,
    *,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if version:
        print_line(f"cgroup {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        sys.stdout.write(context.get_help())


def _fail(message: str, status: int) -> NoReturn:
    sys.stderr.write(f"cgroup: {' '.join(message.split())}\n")
    raise SystemExit(status)
