"""Running a configuration: correspond, group, score, then take times."""

from cgroup.benchmark.run.pipeline import Summary, run

__all__ = ["Summary", "run"]
