"""The command line: reads files, calls the library, prints and writes results."""

import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Annotated

try:
    import typer

    from cgroup.cli.command import COMMANDS, examples, make_app

    _ORDER = "register merge locate apply recognize compare evaluate group features"  # of the help text
    for name in _ORDER.split():
        import_module(f"cgroup.cli.commands.{name}")
    from cgroup.cli.commands import benchmark
    from cgroup.cli.errors import TRACEBACK, explain, print_failure
    from cgroup.cli.process import guarded_output, write_error
    from cgroup.cli.terminal import print_line
except ModuleNotFoundError as missing:
    sys.stderr.write(f"cgroup: the command line needs {missing.name}; pip install 'cgroup[scans]'\n")
    raise SystemExit(2) from None

from cgroup import __version__
from cgroup._checks.quoting import escape
from cgroup._runtime import interrupts
from cgroup._runtime.interrupts import INTERRUPTED

app = make_app(
    name="cgroup",
    help="Point cloud registration and 3D correspondence grouping.",
    epilog=examples(
        "cgroup demo",
        "cgroup register source.ply target.ply",
        "cgroup merge scans/*.ply --out scene",
        "cgroup locate scan.ply --map building.ply",
        "cgroup apply out/source_on_target.txt source.laz",
        "cgroup compare source.ply target.ply --truth pose.txt",
        "cgroup group matches.txt --method lc --resolution 0.02",
        "cgroup COMMAND --help",
        f"# {TRACEBACK}=1 prints the traceback of an unexpected error",
    ),
    add_completion=True,
)
app.add_typer(COMMANDS)
app.add_typer(benchmark.app, name="benchmark")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit.

    Exit status: 0 done, 2 unusable input, 3 no reliable pose, 70 an unexpected error, 130 interrupted,
    141 standard output was closed by its reader.
    """
    try:
        status, message = _run(arguments)
    except KeyboardInterrupt:
        status, message = INTERRUPTED, ""
    if status == INTERRUPTED:  # also where typer has caught it
        # An interrupt within Python's own exec of a string would make the interpreter end by the signal,
        # unless another one comes to its end.
        exec("")  # noqa: S102
        message = "interrupted"
    if message:
        write_error(f"cgroup: {escape(message)}")
    raise SystemExit(status)


def _run(arguments: Sequence[str] | None) -> tuple[int, str]:
    """Run the command line; return the exit status and a message for standard error."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        with guarded_output():
            interrupts.raise_when_interrupted()
            try:
                return app(args=given, prog_name="cgroup", standalone_mode=False) or 0, ""
            except Exception as error:
                if interrupts.was_interrupted():
                    raise KeyboardInterrupt from error
                print_failure(given, error, *explain(error))
                raise
    except Exception as error:  # noqa: BLE001 - a user can do nothing with a traceback
        return explain(error)
    finally:
        interrupts.leave_when_interrupted()


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
