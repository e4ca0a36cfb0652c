"""Wrong calls of public functions and methods, beyond those of `public_calls`. Each takes the function."""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pandas as pd
from colmap_files import make_views, write_model
from placed_scenes import known_scene

import cgroup
from cgroup import datasets, io, registration, types
from cgroup.benchmark import config
from cgroup.scenes import PoseGraph, prepare_map

CLOUD = types.PointCloud(np.eye(3))
SCENE = known_scene()
STONES = datasets.open_dataset("standin-full")
PROBLEM = datasets.make_problem(np.random.default_rng(0), 12)
PAIR = datasets.standin_pair(pixels=60)
PLACE = prepare_map(PAIR.target)
DONE = registration.register(PAIR.source, PAIR.target)
with tempfile.TemporaryDirectory() as _folder:
    MODEL = io.read_colmap(write_model(Path(_folder) / "sparse", make_views(), "txt"))
UNRELATED = datasets.mirror(PAIR)
BARE = cgroup.Correspondences(PROBLEM.source, PROBLEM.target)
NOWHERE = Path("nowhere")
FAR = np.array([[1.0, 0, 0, 1e6], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
GENERATED = config.Config(
    name="wrong", methods=["gtm"], experiment=[{"id": "small", "dataset": "generated-matches"}]
)


def given(*arguments: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Call a function with these arguments."""
    return lambda function: function(*arguments, **options)


def drawn(**masks: Any) -> Callable[..., Any]:
    """Draw the problem with masks of the wrong length."""
    return given(PROBLEM.source, PROBLEM.target, BARE, **masks, T_target_source=np.eye(4), title="")


def find_open3d_missing(iss: Callable[..., Any]) -> object:
    with mock.patch.dict(sys.modules, {"open3d": None}):
        return iss(PROBLEM.source, backend="open3d")


WRONG_CALLS: dict[str, list[Callable[[Any], Any]]] = {
    "cgroup.Grouping.transform": [given(cgroup.nnsr([0.5])), given(cgroup.gtm(np.eye(3)[:2], np.eye(3)[:2]))],
    "cgroup.Grouping.explain": [given(cgroup.nnsr([0.5]), 1)],
    "cgroup.Grouping.plot": [given(cgroup.nnsr([0.5]))],
    "cgroup.match_probabilities": [given(BARE, cgroup.nnsr([0.5]))],
    "cgroup.group_motions": [given(BARE, most=0)],
    "cgroup.certify": [given(BARE, cgroup.ransac(BARE.source, BARE.target, tolerance=1e-9), tolerance=1.0)],
    "cgroup.Correspondences.plot": [given(BARE, T_target_source=np.eye(3))],
    "cgroup.io.ColmapModel.transformed": [given(MODEL, np.eye(4), 0)],
    "cgroup.types.PointCloud.transformed": [given(CLOUD, 2 * np.eye(4))],
    "cgroup.types.PointCloud.select": [given(CLOUD, [True])],
    "cgroup.types.PointCloud.crop": [given(CLOUD, np.ones(3), np.zeros(3))],
    "cgroup.registry.label_of": [given("nonsense")],
    "cgroup.features.iss": [find_open3d_missing],
    "cgroup.targets.fit_targets": [
        given(np.eye(3), np.eye(3), names="aba"),
        given(np.eye(2, 3), np.eye(2, 3)),
    ],
    "cgroup.registration.register": [given(UNRELATED.source, UNRELATED.target)],
    "cgroup.registration.assess": [
        given(PAIR.source, PAIR.target, np.diag([1.0, -1, -1, 1]), axis=(0, 0, 1), effort="low", voxel=9.0),
    ],
    "cgroup.registration.refine": [given(PAIR.source, PAIR.target, np.diag([1.0, -1, -1, 1]))],
    "cgroup.registration.Registration.plot": [given(DONE, correct=[True])],
    "cgroup.registration.Registration.place": [given(DONE, np.zeros(3))],
    "cgroup.registration.Registration.merged": [given(DONE, np.zeros(3), PAIR.target)],
    "cgroup.registration.Registration.covariance_in": [given(DONE, "ceres")],
    "cgroup.scenes.register_all": [given([CLOUD])],
    "cgroup.scenes.false_joins": [given(SCENE)],
    "cgroup.scenes.prepare_map": [given(CLOUD, voxel=-1)],
    "cgroup.scenes.locate": [given(CLOUD, CLOUD)],
    "cgroup.scenes.assess_in_map": [given(CLOUD, CLOUD, np.eye(4)), given(PAIR.source, PLACE, FAR)],
    "cgroup.scenes.PreparedMap.add": [given(PLACE, np.zeros((3, 3)))],
    "cgroup.scenes.PreparedMap.save": [given(PLACE, Path(__file__).parent)],
    "cgroup.scenes.PreparedMap.load": [given(Path(__file__).parent)],
    "cgroup.scenes.Scene.add": [given(SCENE, CLOUD)],
    "cgroup.scenes.Scene.merged": [given(SCENE, component=2), given(SCENE, voxel=-1)],
    "cgroup.scenes.Scene.plot": [given(SCENE, component=2)],
    "cgroup.scenes.Scene.write": [given(SCENE, "poses.txt")],
    **{
        f"cgroup.datasets.Dataset.{name}": [lambda _, name=name: getattr(STONES, name)("nonsense")]
        for name in ("load", "origin_of", "protocols_of", "subject_of", "check_name")
    },
    "cgroup.datasets.MatchingProblem.subset": [given(PROBLEM, np.array([12]))],
    "cgroup.datasets.data_root": [given(NOWHERE)],
    "cgroup.datasets.make_problem": [given(np.random.default_rng(0), -1)],
    "cgroup.datasets.make_scene": [
        given(np.random.default_rng(0), 9, inliers=0.5, noise=1, scene="nonsense", frames="good"),
    ],
    "cgroup.datasets.open_dataset": [given("nonsense")],
    "cgroup.datasets.standin_pair": [given(pixels=1)],
    "cgroup.comparison.compare": [lambda compare: list(compare(BARE, np.eye(4)))],
    "cgroup.comparison.find_correct": [given(BARE, np.eye(4))],
    "cgroup.comparison.write_table": [given("table.csv", [])],
    "cgroup.io.merge_files": [given([], [], "merged.las"), given(["scan.ply"], [np.eye(4)], "merged.ply")],
    "cgroup.io.transform_file": [given("scan.vtk", np.eye(4), "moved.vtk")],
    "cgroup.plots.comparison_figure": [drawn(correct=PROBLEM.inlier_mask, masks={"gtm": np.ones(3, bool)})],
    "cgroup.plots.keypoints_figure": [given(PROBLEM.source, {"h3d": np.array([12])}, title="")],
    "cgroup.plots.registration_figure": [drawn(mask=np.ones(13, bool))],
    "cgroup.pages.comparison_page": [given(CLOUD, CLOUD, BARE, [], np.eye(4))],
    "cgroup.pages.location_page": [given(CLOUD, PLACE, []), given(CLOUD, CLOUD, [DONE])],
    "cgroup.pages.recognition_page": [given({}, CLOUD, [("a", DONE)]), given(CLOUD, CLOUD, [])],
    "cgroup.pages.registration_page": [given(CLOUD, CLOUD, 3)],
    "cgroup.pages.scene_page": [given(PAIR)],
    "cgroup.pages.write_page": [given(NOWHERE / "page.html", "")],
    "cgroup.benchmark.config.Config": [given(nonsense=1)],
    "cgroup.benchmark.config.parse_config": [given("nonsense")],
    "cgroup.benchmark.config.read_config": [given("nonsense")],
    "cgroup.benchmark.run.run": [given(GENERATED, NOWHERE, workers=0)],
    "cgroup.benchmark.tables.aggregate": [
        given(pd.DataFrame(), ["method"], "nonsense"),
        given(pd.DataFrame(), ["method"]),
    ],
    "cgroup.benchmark.tables.exponents": [given(pd.DataFrame())],
    "cgroup.benchmark.tables.load_groups": [given(NOWHERE, "nonsense")],
    "cgroup.benchmark.tables.load": [given(NOWHERE)],
    "cgroup.scenes.PoseGraph": [given([np.ones((4, 4))], [], [], [])],
    "cgroup.scenes.PoseGraph.read": [given(PoseGraph, NOWHERE)],
    "cgroup.scenes.PoseGraph.write": [given(PoseGraph([], [], [], []), "graph.txt")],
    "cgroup.scenes.PoseGraph.optimize": [given(PoseGraph([], [], [], []), start="nonsense")],
    "cgroup.scenes.PoseGraph.covariance": [given(PoseGraph([], [], [], []), 0)],
    "cgroup.benchmark.stats.rank_methods": [given(pd.DataFrame())],
    "cgroup.benchmark.report.write_report": [given(NOWHERE)],
}
