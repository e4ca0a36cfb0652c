"""The paper's evaluation and comparisons of methods: configured, run, stored and reported.

==============  ================================================================================
`config`        reads configurations from TOML: `read_config`, `parse_config`
`run`           `run` computes the missing results of a folder, and continues after a stop
`tables`        results as tables of pandas: `load`
`report`        `write_report` writes one self-contained page about the results
`pipelines`     built-in pipelines, and the answers of further ones: `Answer`, `SceneAnswer`
`stats`         means with intervals, and tests of differences: `rank_methods`
`paper.claims`  checks the paper's claims: `check_claims`
==============  ================================================================================

All modules need the extra ``cgroup[bench]``. On the command line: ``cgroup benchmark``.
"""
