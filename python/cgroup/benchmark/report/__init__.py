"""A self-contained page about a run, with figures, tables, and the claims of the paper."""

from cgroup.benchmark.report.page import write_report

__all__ = ["write_report"]
