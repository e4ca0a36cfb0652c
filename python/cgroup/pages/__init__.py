"""Pages to look at in a browser: charts to turn, zoom and point at, in one HTML file that fetches nothing.

Needs plotly, which comes with the extra ``cgroup[scans]``.
"""

from cgroup.pages.page import chart_html, chart_text, page_html, write_page

__all__ = ["chart_html", "chart_text", "page_html", "write_page"]
