"""Makes the README's links absolute, as PyPI's page needs them: `python tools/absolute_links.py README.md`.

The hosted workflow that builds the wheels runs it in its copy. In the repository links stay relative, so that
they work in every branch and without network.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

REPOSITORY = "https://github.com/cgroup-project/cgroup"
SITE = "https://cgroup-project.github.io/cgroup"
FILES = "https://raw.githubusercontent.com/cgroup-project/cgroup/main"

_LINK = re.compile(
    r"(?P<image>!?)\[(?P<text>[^\]]*)\]\((?!https?:|#|mailto:)(?P<path>[^)\s#]+)(?P<anchor>#[^)\s]*)?\)"
)


def make_absolute(text: str, root: Path) -> str:
    """Return Markdown that stands in `root` with pages of the site, pictures and files by their addresses."""
    return _LINK.sub(lambda link: _absolute(link, root), text)


def _absolute(link: re.Match[str], root: Path) -> str:
    path = link["path"]
    if link["image"]:
        address = f"{FILES}/{path}"
    elif path.startswith("docs/") and path.endswith(".md"):
        address = f"{SITE}/{path.removeprefix('docs/').removesuffix('.md')}.html"
    else:
        address = f"{REPOSITORY}/{'tree' if (root / path).is_dir() else 'blob'}/main/{path}"
    return f"{link['image']}[{link['text']}]({address}{link['anchor'] or ''})"


if __name__ == "__main__":
    readme = Path(sys.argv[1])
    absolute = make_absolute(readme.read_text(encoding="utf-8"), readme.resolve().parent)
    readme.write_text(absolute, encoding="utf-8")
