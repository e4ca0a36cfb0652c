"""The paper's evaluation: configured, planned, run, kept in records, and reported.

==============  ================================================================================
`config`        what is to be run, read from TOML: `read_config`, `parse_config`
`run`           `run` computes what a configuration asks for, and continues where it was stopped
`records`       what has been computed, as tables of pandas: `load`, `load_trials`, ...
`report`        `write_report` makes one self-contained page of the records
`candidates`    grouping methods that take part, also one's own: `candidate`
`pipelines`     ways to register that take part, also one's own: `make_pipeline`, `Answer`
`rankings`      means with intervals, and whether a difference could be chance: `rank_methods`
`claims`        what the paper says, and whether the records bear it out: `check_claims`
==============  ================================================================================

All of it needs the extra ``cgroup[bench]``. On the command line: ``cgroup benchmark``.
"""
