"""Configuration of the documentation site: `make docs`.

Pages are MyST Markdown, so that they read well on GitHub too. Everything that the site shows without network
lies in it: search, fonts, MathJax.
"""

from __future__ import annotations

import sys
from pathlib import Path

from numpydoc.xref import DEFAULT_LINKS

import cgroup

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS))

# Modules of this folder.
from _site import claims, examples, figures, links, mathjax, outside, progress, reference, tables  # noqa: E402

project = "cgroup"
author = "The cgroup developers"
copyright = f"2026, {author}"  # noqa: A001 - Sphinx's name
release = version = cgroup.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "numpydoc",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = [
    *("_generated/examples/*.*", "_generated/paper/*", "_generated/tables/*"),
    *("gallery/*.ipynb", "gallery/*.py"),
]
templates_path = ["_templates"]
suppress_warnings = ["config.cache"]

# Markdown.
myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
myst_html_meta = {
    "description": "Point cloud registration and 3D correspondence grouping in Python and Rust: poses of "
    "scans with the probability that each is correct, and the correct matches among many wrong ones.",
    "keywords": "point cloud registration, correspondence grouping, global registration, 3D matching, LiDAR, "
    "RANSAC, TEASER, FPFH, multiway registration, loop closure",
}
nb_execution_mode = "cache"
nb_execution_cache_path = str(DOCS.parent / "target" / "notebooks")
nb_execution_timeout = 120
nb_execution_raise_on_error = True
nb_merge_streams = True

# The interface. Types stand in the docstrings, where they are worded for people.
default_role = "autolink"
autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"  # but for the package's own types
numpydoc_xref_aliases = reference.types()
DEFAULT_LINKS.clear()  # into the manuals of Python and NumPy, which need the network
add_module_names = False

# Examples, pictures, tables and the pages of the interface are made when the site is built.
tables.write(DOCS)
claims.write(DOCS / "figures" / "measured", DOCS / "_generated" / "paper")
examples.copy(DOCS.parent / "examples", DOCS / "_generated" / "examples")
autosummary_generate = reference.write(DOCS / "reference")
sphinx_gallery_conf = examples.gallery(DOCS / "_generated" / "examples", "gallery")

# Appearance.
html_theme = "pydata_sphinx_theme"
html_title = "cgroup: point cloud registration"
html_static_path = ["_static", mathjax.path()]
html_css_files = ["site.css"]
html_favicon = "_static/favicon.svg"
html_show_sourcelink = False
html_theme_options = {
    "logo": {
        "text": f"cgroup {release}",
        "image_light": "_static/logo.svg",
        "image_dark": "_static/logo.svg",
    },
    "icon_links": [{"name": "GitHub", "url": links.REPOSITORY, "icon": "fa-brands fa-github"}],
    "header_links_before_dropdown": 7,
    "navbar_align": "left",
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "tango",
    "pygments_dark_style": "monokai",
}
html_sidebars = {"index": []}
html_context = {"default_mode": "auto"}
mathjax_path = mathjax.SCRIPT
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

# External links: `make linkcheck`.
linkcheck_ignore = [rf"{links.REPOSITORY}.*", r"https://cgroup-project\.github\.io.*"]
linkcheck_timeout = 20


def setup(app: object) -> None:
    """Make figures, send links out of the folder to the repository, count pages, check what they load."""
    app.connect("builder-inited", lambda _app: figures.make(DOCS))
    app.connect("source-read", links.rewrite)
    app.connect("autodoc-process-signature", reference.hide_private_parameters)
    app.connect("build-finished", outside.refuse)
    progress.count_pages(app)
