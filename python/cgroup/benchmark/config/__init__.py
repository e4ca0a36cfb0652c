"""What is to be run: experiments, methods and thresholds, read from TOML."""

from cgroup.benchmark.config.entries import METHOD_SETS, ExperimentEntry, MethodEntry, TimingEntry
from cgroup.benchmark.config.reading import Config, parse_config, preset_names, read_config
from cgroup.benchmark.config.registration import PairSetEntry, PipelineEntry, RegistrationEntry

__all__ = [
    "METHOD_SETS",
    "Config",
    "ExperimentEntry",
    "MethodEntry",
    "PairSetEntry",
    "PipelineEntry",
    "RegistrationEntry",
    "TimingEntry",
    "parse_config",
    "preset_names",
    "read_config",
]
