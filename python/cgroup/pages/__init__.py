"""Pages to look at in a browser: charts to turn, zoom and point at, in one HTML file that fetches nothing.

Pages need plotly, which comes with ``cgroup[scans]``; recordings for the viewer Rerun need rerun-sdk
(``cgroup[rerun]``).
"""

from cgroup.pages.page import chart_html, chart_text, data_html, page_html, write_page
from cgroup.pages.recording import log_to_rerun
from cgroup.pages.results import comparison_page, registration_page

__all__ = [
    "chart_html",
    "chart_text",
    "comparison_page",
    "data_html",
    "log_to_rerun",
    "page_html",
    "registration_page",
    "write_page",
]
