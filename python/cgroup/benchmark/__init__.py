"""Running methods and judging what they select."""

from cgroup.benchmark.comparison import MethodResult, compare, table, write_table

__all__ = ["MethodResult", "compare", "table", "write_table"]
