"""The end of a command: its document is saved, and shown as text or JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cgroup.cli.saved_runs import check_run, save_run
from cgroup.cli.show.json import print_document
from cgroup.cli.show.terminal import print_line

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from cgroup.cli.show.json import Document

_INPUTS = ("source", "target", "correspondences", "models", "cloud")
_OUTPUTS = ("out", "html", "as_json", "save", "wide")


def options_of(context: Any) -> dict[str, Any]:  # noqa: ANN401 - typer's
    """List the options that shape a command's result, defaults included."""
    return {name: value for name, value in context.params.items() if name not in {*_INPUTS, *_OUTPUTS}}


def files_in(folder: Path, names: tuple[str, ...]) -> list[str]:
    """List files as a document does."""
    return [str(folder / name) for name in names]


class Ending:
    """Where a result goes besides its files; a name or file to save it by is looked at before work starts."""

    def __init__(self, *, as_json: bool, save: str | None = None) -> None:
        self._as_json = as_json
        self._save = None if save is None else check_run(save)

    def finish(self, document: Document, print_it: Callable[[Document], None]) -> None:
        """Save a document where that was asked for, and show it."""
        if self._save is not None:
            save_run(self._save, document)
        if self._as_json:
            print_document(document)
            return
        print_it(document)
        if self._save is not None:
            print_line(f"saved as {self._save.stem}; see: cgroup results")
