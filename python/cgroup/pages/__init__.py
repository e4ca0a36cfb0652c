"""Interactive pages for the browser, one self-contained HTML file each.

They need plotly (``cgroup[scans]``).
"""

from cgroup.pages.page import write_page
from cgroup.pages.places import location_page, recognition_page
from cgroup.pages.results import comparison_page, registration_page
from cgroup.pages.scans import scene_page

__all__ = [
    "comparison_page", "location_page", "recognition_page", "registration_page", "scene_page", "write_page",
]  # fmt: skip
