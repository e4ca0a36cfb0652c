"""``cgroup results``: list, show, compare and remove saved runs."""

from __future__ import annotations

from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from cgroup.cli import options
from cgroup.cli.commands.group import print_group
from cgroup.cli.commands.register import print_registration
from cgroup.cli.help import command, examples, make_app
from cgroup.cli.output import Ending
from cgroup.cli.saved_runs import folder_of_runs, load_run, names_of_runs, remove_runs
from cgroup.cli.show.comparison import print_comparison
from cgroup.cli.show.json import Document, make_document
from cgroup.cli.show.numbers import UNKNOWN, show_date
from cgroup.cli.show.runs import compare_runs, print_differences
from cgroup.cli.show.tables import Column, print_table
from cgroup.cli.show.terminal import print_facts, print_line, print_prose
from cgroup.errors import InputError
from cgroup.registry import label_of

if TYPE_CHECKING:
    from collections.abc import Generator

_COLUMNS = (
    Column("name", is_text=True),
    Column("command", is_text=True),
    Column("saved", is_text=True, priority=1),
    Column("inputs", is_text=True, priority=2),
    Column("result", is_text=True),
)

app = make_app(
    help="List, show and compare results that --save has kept.",
    epilog=examples(
        "cgroup register a.ply b.ply --save lc",
        "cgroup register a.ply b.ply --method gtm --save gtm",
        "cgroup results compare lc gtm",
    ),
)


@app.callback(invoke_without_command=True)
def _without_command(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        list_command(as_json=False, wide=False)


@command(app, "list", "cgroup results list")
def list_command(*, as_json: options.JsonOption = False, wide: options.WideOption = False) -> None:
    """List saved runs: in $CGROUP_RESULTS, or else the folder for data of the user."""
    folder = folder_of_runs()
    runs = [_summary(name) for name in names_of_runs()]
    document = make_document("results list", results={"folder": folder, "runs": runs})
    Ending(as_json=as_json).finish(document, partial(_print_list, wide=wide))


@command(app, "show", "cgroup results show gtm", "cgroup results show gtm --json")
def show_command(
    run: options.RunArgument, *, as_json: options.JsonOption = False, wide: options.WideOption = False
) -> None:
    """Show a saved run as it was shown when it ended."""
    with _readable(run):
        Ending(as_json=as_json).finish(load_run(run), partial(_print_run, wide=wide))


@command(
    app, "compare", "cgroup results compare shot rcs", "cgroup results compare before.json after.json --wide"
)
def compare_command(
    runs: options.RunsArgument, *, as_json: options.JsonOption = False, wide: options.WideOption = False
) -> None:
    """Show saved runs of one command side by side: results, and by what the poses differ."""
    if len(runs) < 2:
        message = f"NAME: got {len(runs)} run; give two or more to be compared"
        raise InputError(message)
    documents = [load_run(run) for run in runs]
    with _readable(", ".join(runs)):
        compared = make_document("results compare", results=compare_runs(runs, documents))
        Ending(as_json=as_json).finish(compared, partial(print_differences, wide=wide))


@command(app, "remove", "cgroup results remove gtm lc")
def remove_command(runs: options.RunsArgument, *, as_json: options.JsonOption = False) -> None:
    """Delete saved runs."""
    files = remove_runs(runs)
    document = make_document("results remove", files=files)
    Ending(as_json=as_json).finish(
        document, lambda _: print_line(f"removed {', '.join(str(file) for file in files)}")
    )


@contextmanager
def _readable(name: str) -> Generator[None, None, None]:
    """Raise `InputError` for a file that is laid out as a saved run, but lacks what belongs into one."""
    try:
        yield
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, InputError):
            raise
        message = f"{name}: not as --save writes it ({type(error).__name__}: {error}); remove it"
        raise InputError(message) from error


def _summary(name: str) -> Document:
    """List what the table of saved runs shows of one; a file that can't be read is shown as such."""
    try:
        run = load_run(name)
        with _readable(name):
            files = [Path(one["file"]).name for one in run["inputs"]]
            return {
                "name": name,
                "command": run["command"],
                "date": run["saved"]["date"],
                "inputs": files,
                "result": _say_result(run),
                "error": None,
            }
    except InputError as error:
        unknown = {"command": None, "date": None, "inputs": [], "result": None}
        return {"name": name, **unknown, "error": str(error)}


def _say_result(run: Document) -> str:
    found = run["results"]
    if run["command"] == "register":
        return f"probability {found['probability']:.3f}, overlap {100 * found['fitness']:.0f} %"
    if run["command"] == "group":
        return f"{found['selected']} of {run['inputs'][0]['matches']} by {label_of(run['options']['method'])}"
    best = max(found["methods"], key=lambda row: row["f_score"])
    registered = sum(row["registered"] for row in found["methods"])
    return f"{registered} of {len(found['methods'])} registered, best F {best['f_score']:.3f}"


def _print_list(document: Document, *, wide: bool) -> None:
    runs, folder = document["results"]["runs"], document["results"]["folder"]
    if not runs:
        print_prose(f"no saved runs in {folder}; keep one: cgroup register SOURCE TARGET --save NAME")
        return
    rows = [
        (
            run["name"],
            run["command"] or UNKNOWN,
            show_date(run["date"]),
            ", ".join(run["inputs"]) or UNKNOWN,
            run["result"] or f"can't be read: cgroup results show {run['name']}",
        )
        for run in runs
    ]
    print_table(_COLUMNS, rows, wide=wide)


def _print_run(document: Document, *, wide: bool) -> None:
    saved = document["saved"]
    print_facts(
        ("command", f"cgroup {document['command']}, version {document['cgroup_version']}"),
        ("saved", f"{saved['date']}, {saved['machine']}"),
    )
    if document["command"] == "register":
        print_registration(document)
    elif document["command"] == "group":
        print_group(document)
    else:
        print_comparison(document, wide=wide)
