"""Links between pages and to files of the repository, right both on GitHub and on the site."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

REPOSITORY = "https://github.com/cgroup-project/cgroup"

# Files outside docs/ that are pages of the site.
_PAGES = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
}
_LINK = re.compile(r"(?<=\]\()(?!https?:|#|mailto:|<)([^)\s#]+)(#[^)\s]*)?(?=\))")


def rewrite(app: Sphinx, docname: str, source: list[str]) -> None:
    """Send links that leave docs/ to the page of the site, or to the repository."""
    docs = Path(app.srcdir)
    page = Path(app.env.doc2path(docname))
    if page.suffix != ".md":
        return

    def replace(match: re.Match[str]) -> str:
        path, anchor = match[1], match[2] or ""
        return site_link(docs, page, path) + anchor

    source[0] = _LINK.sub(replace, source[0])


def site_link(docs: Path, page: Path, path: str) -> str:
    """Return the link from a page of the site that stands for the link of the file."""
    target = (page.parent / path).resolve()
    if target.is_relative_to(docs):
        return path
    name = str(target.relative_to(docs.parent))
    up = "../" * (len(page.relative_to(docs).parts) - 1)
    if name in _PAGES:
        return up + _PAGES[name]
    if target.parent == docs.parent / "examples" and target.suffix == ".py":
        return f"{up}gallery/{target.stem}.rst"
    return f"{REPOSITORY}/{'tree' if target.is_dir() else 'blob'}/main/{name}"
