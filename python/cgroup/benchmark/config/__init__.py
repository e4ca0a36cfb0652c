"""What is to be run: experiments, methods and thresholds, read from TOML."""

from cgroup.benchmark.config.entries import METHOD_SETS, ExperimentEntry, MethodEntry, TimingEntry
from cgroup.benchmark.config.front import FrontEntry
from cgroup.benchmark.config.reading import (
    Config,
    parse_config,
    preset_names,
    read_config,
    replace_methods,
)
from cgroup.benchmark.config.registration import PairSetEntry, PipelineEntry, RegistrationEntry
from cgroup.benchmark.config.trials import GridEntry, TrialsEntry, TrialSetEntry

__all__ = [
    "METHOD_SETS",
    "Config",
    "ExperimentEntry",
    "FrontEntry",
    "GridEntry",
    "MethodEntry",
    "PairSetEntry",
    "PipelineEntry",
    "RegistrationEntry",
    "TimingEntry",
    "TrialSetEntry",
    "TrialsEntry",
    "parse_config",
    "preset_names",
    "read_config",
    "replace_methods",
]
