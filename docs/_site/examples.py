"""The gallery: what `examples` shows, run when the site is built."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst
from sphinx_gallery.sorting import ExplicitOrder

from _site.progress import name_example

_ORDER = (
    "register_two_scans.py",
    "register_real_scans.py",
    "compare_methods.py",
    "explain_a_dropped_match.py",
    "merge_views.py",
    "close_lidar_loops.py",
    "find_what_is_on_the_table.py",
    "*",
)

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


def copy(examples: Path, folder: Path) -> None:
    """Copy the examples: what they write then lands beside the copies."""
    for path in [*examples.rglob("*.py"), *examples.rglob("*.rst"), *examples.rglob("*.ipynb")]:
        copied = folder / path.relative_to(examples)
        if copied.exists() and copied.read_bytes() == path.read_bytes():
            continue
        copied.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, copied)


def gallery(folder: Path, name: str) -> dict[str, Any]:
    """Return the configuration of sphinx-gallery."""
    return {
        "examples_dirs": str(folder),
        "gallery_dirs": name,
        "filename_pattern": r"\.py$",
        "ignore_pattern": r"__init__\.py|/notebooks/",
        "image_scrapers": (scrape_figures,),
        "reset_modules": ("matplotlib", name_example),
        "capture_repr": ("_repr_html_",),
        "within_subsection_order": ExplicitOrder(_ORDER),
        "remove_config_comments": True,
        "show_memory": False,
        "write_computation_times": False,  # on pages that would load scripts from elsewhere
        "show_signature": False,
        "download_all_examples": False,
        "backreferences_dir": f"{name}/used",
        "doc_module": ("cgroup",),
    }


def scrape_figures(_block: object, variables: Mapping[str, Any], config: Mapping[str, Any]) -> str:
    """Save the figures that an example holds in variables; cgroup's are not known to pyplot."""
    seen = variables.setdefault("seen_figures", [])
    paths = []
    for value in list(variables["example_globals"].values()):
        if isinstance(value, Figure) and all(value is not figure for figure in seen):
            seen.append(value)
            path = next(variables["image_path_iterator"])
            value.savefig(path, dpi=150)
            paths.append(path)
    return figure_rst(paths, config["src_dir"])
