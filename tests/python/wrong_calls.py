"""Wrong calls of public functions and methods: one for each error that they document.

For an `InputError` of the functions in `public_calls`, and for memory that is refused, there are tests of their
own.
"""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest import mock

import numpy as np
import pandas as pd

import cgroup
from cgroup import comparison, datasets, features, pages, plots, registration, registry, types
from cgroup.benchmark import config, pipelines, report, run, solver, stats, tables
from cgroup.benchmark.paper import claims, reading_tables, readings
from cgroup.benchmark.paper.evidence import Evidence
from cgroup.pages import page

if TYPE_CHECKING:
    from collections.abc import Callable

CLOUD = types.PointCloud(np.eye(3))
STONES = datasets.open_dataset("standin-full")
PROBLEM = datasets.make_problem(np.random.default_rng(0), 12)
PAIR = datasets.standin_pair(pixels=60)
UNRELATED = datasets.mirror(PAIR)
BARE = cgroup.Correspondences(PROBLEM.source, PROBLEM.target)
NOWHERE = Path("nowhere")
NO_READINGS = readings.judge_readings(pd.DataFrame(), pd.DataFrame(), [])
GENERATED = config.Config(
    name="wrong", methods=["gtm"], experiment=[{"id": "small", "dataset": "generated-matches"}]
)


def draw(figure: str, *, rows: int = 12, pose: np.ndarray | None = None) -> object:
    """Draw the problem with a mask of so many rows and a pose, the right ones by default."""
    mask = np.ones(rows, dtype=bool)
    given = {"correct": PROBLEM.inlier_mask, "masks": {"gtm": mask}} if "comp" in figure else {"mask": mask}
    given |= {"T_target_source": np.eye(4) if pose is None else pose, "title": ""}
    return getattr(plots, figure)(PROBLEM.source, PROBLEM.target, BARE, **given)


def find_open3d_missing() -> object:
    with mock.patch.dict(sys.modules, {"open3d": None}):
        return features.iss(PROBLEM.source, backend="open3d")


def find_plotly_missing() -> object:
    page._packed_plotly.cache_clear()
    with mock.patch.dict(sys.modules, {"plotly.offline": None}):
        return pages.page_html("", '<figure class="chart"></figure>')


WRONG_CALLS: dict[str, tuple[Callable[[], Any], ...]] = {
    "cgroup.Grouping.transform": (
        lambda: cgroup.nnsr([0.5]).transform(),
        lambda: cgroup.gtm(np.eye(3)[:2], np.eye(3)[:2]).transform(),
    ),
    "cgroup.Grouping.explain": (lambda: cgroup.nnsr([0.5]).explain(1),),
    "cgroup.Grouping.plot": (lambda: cgroup.nnsr([0.5]).plot(),),
    "cgroup.Correspondences.plot": (lambda: BARE.plot(T_target_source=np.eye(3)),),
    "cgroup.types.PointCloud.transformed": (lambda: CLOUD.transformed(2 * np.eye(4)),),
    "cgroup.registry.label_of": (lambda: registry.label_of("nonsense"),),
    "cgroup.features.iss": (find_open3d_missing,),
    "cgroup.registration.register": (lambda: registration.register(UNRELATED.source, UNRELATED.target),),
    "cgroup.registration.Registration.plot": (
        lambda: registration.register(PAIR.source, PAIR.target).plot(correct=[True]),
    ),
    "cgroup.registration.PreparedScan.resized": (
        lambda: registration.prepare(PAIR.source, voxel=6.0).resized(100),
    ),
    **{
        f"cgroup.datasets.Dataset.{name}": (partial(getattr(STONES, name), "nonsense"),)
        for name in ("load", "origin_of", "protocols_of", "subject_of", "check_name")
    },
    "cgroup.datasets.Dataset.measure_facts": (lambda: STONES.measure_facts("nonsense", bound=2),),
    "cgroup.datasets.MatchingProblem.subset": (lambda: PROBLEM.subset(np.array([12])),),
    "cgroup.datasets.data_root": (lambda: datasets.data_root(NOWHERE),),
    "cgroup.datasets.make_problem": (lambda: datasets.make_problem(np.random.default_rng(0), -1),),
    "cgroup.datasets.make_scene": (
        lambda: datasets.make_scene(
            np.random.default_rng(0), 9, inliers=0.5, noise=1, scene="nonsense", frames="good"
        ),
    ),
    "cgroup.datasets.open_dataset": (lambda: datasets.open_dataset("nonsense"),),
    "cgroup.datasets.standin_pair": (lambda: datasets.standin_pair(pixels=1),),
    "cgroup.comparison.compare": (lambda: list(comparison.compare(BARE, np.eye(4))),),
    "cgroup.comparison.find_correct": (lambda: comparison.find_correct(BARE, np.eye(4)),),
    "cgroup.comparison.write_table": (lambda: comparison.write_table("table.csv", []),),
    "cgroup.plots.comparison_figure": (
        lambda: draw("comparison_figure", pose=np.eye(3)),
        lambda: draw("comparison_figure", rows=3),
    ),
    "cgroup.plots.keypoints_figure": (
        lambda: plots.keypoints_figure(PROBLEM.source, {"h3d": np.array([12])}, title=""),
    ),
    "cgroup.plots.registration_figure": (
        lambda: draw("registration_figure", pose=np.eye(3)),
        lambda: draw("registration_figure", rows=13),
    ),
    **{
        f"cgroup.plots.{name}": (partial(getattr(plots, name), pd.DataFrame(columns), title="", **options),)
        for columns, options, names in (
            (
                {"method": ["gtm"]},
                {"xlabel": ""},
                ("inliers_figure", "registration_rate_figure", "scores_figure"),
            ),
            ({}, {"methods": ("gc", "gtm")}, ("pair_precision_figure",)),
            ({}, {}, ("pipelines_figure", "readings_figure", "trials_figure")),
        )
        for name in names
    },
    "cgroup.pages.chart_html": (lambda: pages.chart_html("a", 3, label="a"),),
    "cgroup.pages.comparison_page": (lambda: pages.comparison_page(CLOUD, CLOUD, BARE, [], np.eye(4)),),
    "cgroup.pages.log_to_rerun": (lambda: pages.log_to_rerun(CLOUD, CLOUD, BARE, cgroup.nnsr([0.5])),),
    "cgroup.pages.page_html": (find_plotly_missing,),
    "cgroup.pages.registration_page": (lambda: pages.registration_page(CLOUD, CLOUD, 3),),
    "cgroup.pages.write_page": (lambda: pages.write_page(NOWHERE / "page.html", ""),),
    "cgroup.benchmark.solver.Solver.group": (lambda: solver.candidate("", "lc", {}).group(BARE),),
    "cgroup.benchmark.solver.Solver.parameters": (
        lambda: solver.candidate("", "lc", {"tolerance_pr": 1}).parameters(0, None),
    ),
    "cgroup.benchmark.solver.Solver.register": (
        lambda: solver.make_pipeline("", "cgroup", {}).register(
            pipelines.Clouds(PROBLEM.source, PROBLEM.target, None, None, voxel=-1)
        ),
    ),
    "cgroup.benchmark.solver.candidate": (lambda: solver.candidate("", "nonsense", {}),),
    "cgroup.benchmark.solver.make_pipeline": (lambda: solver.make_pipeline("", "nonsense", {}),),
    **{
        f"cgroup.benchmark.config.{name}": (partial(getattr(config, name), nonsense=1),)
        for name in ("Config", *(name for name in config.__all__ if name.endswith("Entry")))
    },
    "cgroup.benchmark.config.parse_config": (lambda: config.parse_config("nonsense"),),
    "cgroup.benchmark.config.read_config": (lambda: config.read_config("nonsense"),),
    "cgroup.benchmark.config.replace_methods": (lambda: config.replace_methods(GENERATED, ["nonsense"]),),
    "cgroup.benchmark.run.run": (lambda: run.run(GENERATED, NOWHERE, workers=0),),
    "cgroup.benchmark.tables.aggregate": (
        lambda: tables.aggregate(pd.DataFrame(), ["method"], "nonsense"),
        lambda: tables.aggregate(pd.DataFrame(), ["method"]),
    ),
    "cgroup.benchmark.tables.exponents": (lambda: tables.exponents(pd.DataFrame()),),
    "cgroup.benchmark.tables.load_groups": (lambda: tables.load_groups(NOWHERE, "nonsense"),),
    "cgroup.benchmark.tables.load": (lambda: tables.load(NOWHERE),),
    "cgroup.benchmark.paper.readings.Reading": (partial(readings.Reading, nonsense=1),),
    "cgroup.benchmark.paper.readings.Question": (partial(readings.Question, nonsense=1),),
    "cgroup.benchmark.paper.readings.add_readings": (
        lambda: readings.add_readings(config.read_config("matches"), []),
        lambda: readings.add_readings(
            config.read_config("smoke"),
            [readings.Reading(name="wrong", label="", methods={"gtm": {"nonsense": 1}})],
        ),
    ),
    "cgroup.benchmark.paper.readings.judge_readings": (
        lambda: readings.judge_readings(pd.DataFrame(), pd.DataFrame(), [], resamples=0),
    ),
    "cgroup.benchmark.paper.readings.list_readings": (lambda: readings.list_readings(["nonsense"]),),
    "cgroup.benchmark.paper.reading_tables.write_readings": (
        lambda: reading_tables.write_readings(NOWHERE, NO_READINGS),
    ),
    "cgroup.benchmark.paper.claims.check_claims": (
        lambda: claims.check_claims(pd.DataFrame(), pd.DataFrame(), resamples=-1),
    ),
    "cgroup.benchmark.paper.claims.check_evidence": (
        lambda: claims.check_evidence(Evidence(pd.DataFrame(), pd.DataFrame()), seed=-1),
    ),
    "cgroup.benchmark.paper.claims.bootstrap_verdicts": (
        lambda: claims.bootstrap_verdicts(pd.DataFrame(), pd.DataFrame(), resamples=0),
    ),
    "cgroup.benchmark.stats.comparable": (lambda: stats.comparable(pd.DataFrame()),),
    "cgroup.benchmark.stats.rank_methods": (lambda: stats.rank_methods(pd.DataFrame()),),
    "cgroup.benchmark.stats.mcnemar": (lambda: stats.mcnemar([True, False], [True, True, False]),),
    "cgroup.benchmark.stats.signed_rank": (lambda: stats.signed_rank([1, 2], [1, 2, 3]),),
    "cgroup.benchmark.report.write_report": (lambda: report.write_report(NOWHERE),),
}
