"""Pages load nothing from elsewhere: who reads them tells nobody, and they work without network."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING

from sphinx.errors import ExtensionError

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_LINKS_THAT_LOAD_NOTHING = {"alternate", "author", "canonical", "index", "license", "next", "prev", "search"}


def refuse(app: Sphinx, failure: Exception | None) -> None:
    """End the build where a page loads something from elsewhere."""
    if failure is None and app.builder.format == "html":
        folder = Path(app.outdir)
        pages = {path: loaded(path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.html"))}
        found = [f"{path.relative_to(folder)}: {url}" for path, urls in pages.items() for url in urls]
        if found:
            raise ExtensionError("Pages load from elsewhere:\n" + "\n".join(found))


def loaded(page: str) -> list[str]:
    """Return the addresses elsewhere that a browser asks for when it opens a page."""
    parser = _Parser()
    parser.feed(page)
    return [url for url in parser.loaded if re.match(r"(https?:)?//", url)]


class _Parser(HTMLParser):
    """Collects what a page loads: scripts, styles, images, frames."""

    def __init__(self) -> None:
        super().__init__()
        self.loaded: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attrs}
        names = ["src", "poster", "data"] if tag != "link" else ["href"]
        if tag == "link" and values.get("rel", "").lower() in _LINKS_THAT_LOAD_NOTHING:
            return
        self.loaded += [values[name] for name in names if name in values]
        self.loaded += [part.split()[0] for part in values.get("srcset", "").split(",") if part.strip()]
        self.loaded += re.findall(r"""url\(["']?([^"')]+)""", values.get("style", ""))

    def handle_data(self, data: str) -> None:
        if self.lasttag == "style":
            self.loaded += re.findall(r"""(?:url\(|@import\s)\s*["']?([^"')\s]+)""", data)
