"""What a run has computed: kept in one SQLite file, read as tables."""

from cgroup.benchmark.records.growth import exponents
from cgroup.benchmark.records.means import aggregate
from cgroup.benchmark.records.registration_tables import load_registrations
from cgroup.benchmark.records.tables import (
    load,
    load_config,
    load_datasets,
    load_groups,
    load_machines,
    load_missing,
    load_timing,
    load_timing_skips,
)
from cgroup.benchmark.records.trial_tables import load_trials

__all__ = [
    "aggregate",
    "exponents",
    "load",
    "load_config",
    "load_datasets",
    "load_groups",
    "load_machines",
    "load_missing",
    "load_registrations",
    "load_timing",
    "load_timing_skips",
    "load_trials",
]
