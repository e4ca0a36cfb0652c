"""The paper's evaluation: problems and solvers configured and run, results kept and reported.

==============  ================================================================================
`config`        what is to be run, read from TOML: `read_config`, `parse_config`
`run`           `run` computes the results that a folder lacks, and continues after a stop
`tables`        results as tables of pandas: `load`
`report`        `write_report` makes one self-contained page of the results
`solver`        methods and ways to register, also one's own: `candidate`, `make_pipeline`, ...
`pipelines`     the built-in ways to register, and what one's own answers: `Answer`
`rankings`      means with intervals, and whether a difference could be chance: `rank_methods`
`claims`        what the paper says, and whether the results bear it out: `check_claims`
==============  ================================================================================

All of it needs the extra ``cgroup[bench]``. On the command line: ``cgroup benchmark``.
"""
