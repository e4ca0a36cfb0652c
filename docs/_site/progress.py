"""What a build says on the terminal: each stage as it begins, and how far it is."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from sphinx.application import Sphinx

_BEGUN = time.monotonic()
_PAGES = 50
"""Pages between two lines."""


def say(text: str) -> None:
    """Print a line behind the time that has passed."""
    minutes, seconds = divmod(int(time.monotonic() - _BEGUN), 60)
    sys.stdout.write(f"{minutes}:{seconds:02} {text}\n")
    sys.stdout.flush()


def name_example(_conf: object, path: str) -> None:
    """Name an example of the gallery before it runs."""
    say(f"gallery: {Path(path).name}")


def count_pages(app: Sphinx) -> None:
    """Count the pages that are read and written."""
    app.connect("source-read", _counter("read"))
    app.connect("html-page-context", _counter("written"))


def _counter(verb: str) -> Callable[..., None]:
    count = 0

    def add(*_: object) -> None:
        nonlocal count
        count += 1
        if count % _PAGES == 0:
            say(f"{count} pages {verb}")

    return add
