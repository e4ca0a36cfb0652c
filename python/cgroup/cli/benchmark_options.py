"""What the commands of ``cgroup benchmark`` share."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from cgroup.cli.options import OUTPUT
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Generator

OutOption = Annotated[
    Path,
    typer.Option(
        metavar="FOLDER",
        help="Folder of the records and everything made from them.",
        rich_help_panel=OUTPUT,
    ),
]
DataOption = Annotated[
    Path | None,
    typer.Option(metavar="FOLDER", help="Folder with the data sets.", show_default="$CGROUP_DATA"),
]
FormatOption = Annotated[
    Literal["table", "markdown"],
    typer.Option(metavar="table|markdown", help="How to print them.", rich_help_panel=OUTPUT),
]
ResamplesOption = Annotated[
    int,
    typer.Option(
        min=0,
        metavar="COUNT",
        help="How often the pairs are drawn anew, to tell how sure each verdict is; 0: not at all.",
    ),
]
RetryOption = Annotated[bool, typer.Option("--retry-failed", help="Try again what failed.")]
DEFAULT_OUT = Path("benchmark")


@contextmanager
def needs_extra() -> Generator[None, None, None]:
    """Say which extra is missing, where a library of the benchmark is."""
    try:
        yield
    except ModuleNotFoundError as missing:
        if missing.name is None or missing.name.startswith("cgroup"):
            raise
        message = f"the benchmark needs {missing.name}; pip install 'cgroup[bench]'"
        raise InputError(message) from missing
