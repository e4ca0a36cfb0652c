"""Interactive pages for the browser, one self-contained HTML file each.

Pages need plotly (``cgroup[scans]``); recordings for the viewer Rerun need rerun-sdk (``cgroup[rerun]``).
"""

from cgroup.pages.page import write_page
from cgroup.pages.recording import log_to_rerun
from cgroup.pages.results import comparison_page, registration_page
from cgroup.pages.scans import scene_page

__all__ = [
    "comparison_page",
    "log_to_rerun",
    "registration_page",
    "scene_page",
    "write_page",
]
