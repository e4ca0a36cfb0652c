"""Tables of measurements and of methods, which pages include: one Markdown file each."""

from __future__ import annotations

import importlib
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


def write(docs: Path) -> None:
    """Write docs/_generated/tables; leave files that are up to date."""
    sys.path.insert(0, str(docs / "figures"))
    folder = docs / "_generated" / "tables"
    folder.mkdir(parents=True, exist_ok=True)
    for name, table in importlib.import_module("method_figures.tables").included().items():
        page, text = folder / f"{name}.md", f"{table}\n"
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")
