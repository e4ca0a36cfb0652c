"""What a run has computed: kept in one SQLite file, read as tables."""

from cgroup.benchmark.records.growth import exponents
from cgroup.benchmark.records.means import aggregate
from cgroup.benchmark.records.progress import load_counts, load_failures, load_missing
from cgroup.benchmark.records.reading import check
from cgroup.benchmark.records.registration_tables import load_registrations
from cgroup.benchmark.records.tables import (
    load,
    load_config,
    load_datasets,
    load_groups,
    load_machines,
    load_timing,
    load_timing_skips,
)
from cgroup.benchmark.records.trial_tables import load_trials

__all__ = [
    "aggregate",
    "check",
    "exponents",
    "load",
    "load_config",
    "load_counts",
    "load_datasets",
    "load_failures",
    "load_groups",
    "load_machines",
    "load_missing",
    "load_registrations",
    "load_timing",
    "load_timing_skips",
    "load_trials",
]
