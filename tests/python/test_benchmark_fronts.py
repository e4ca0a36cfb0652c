"""Other front ends in experiments: each field changes what it says, and nothing else."""

import functools
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

import benchmark_fakes
from benchmark_runs import CLOUDS, contents, serial
from cgroup import Correspondences, features
from cgroup.benchmark import matching, tables
from cgroup.benchmark.config import parse_config
from cgroup.benchmark.entries import ExperimentEntry, FrontEntry
from cgroup.benchmark.matching import match_by_front
from cgroup.benchmark.paper.evidence import Evidence
from cgroup.benchmark.plan import make_plan
from cgroup.benchmark.problem import Problem
from cgroup.benchmark.report.sections import _describe_front
from cgroup.benchmark.results import Matched
from cgroup.features import SUPPORT_RADIUS
from cgroup.registration import DescribedCloud, correspond, describe
from reference import matching as reference_matching

CLOUD_DATA, MESH_DATA = "benchmark_fakes:Clouds", "benchmark_fakes:Meshes"


def make_case(dataset: str = CLOUD_DATA, combination: str = "C1", **fields: Any) -> Problem:
    """Pair a in an experiment."""
    return Problem("experiment", dataset, "a", matches=combination, **fields)


def match_case(dataset: str = CLOUD_DATA, front: dict[str, Any] | None = None, **case: Any) -> Matched:
    """Record of the first stage for the pair a, by a front."""
    asked = make_case(dataset, **case)
    changes = FrontEntry(**(front or {})).changes(asked.detector, asked.nuisance)
    record = matching.match_problem(replace(asked, front=changes), None)
    assert not isinstance(record, str)
    return record


def find_matches(*args: Any, **kwargs: Any) -> Correspondences:
    return match_case(*args, **kwargs).matches


def assert_equal(one: Correspondences, other: Correspondences) -> None:
    assert_equal_but(one, other)


def assert_equal_but(one: Correspondences, other: Correspondences, *changed: str) -> None:
    """Compare all fields, bit by bit; those that are said to be changed must be."""
    for name in (field.name for field in fields(Correspondences)):
        values = [np.asarray(getattr(each, name), dtype=float) for each in (one, other)]  # NaN for None
        assert np.array_equal(*values, equal_nan=True) != (name in changed), name


@functools.cache
def load_clouds() -> Any:
    return benchmark_fakes.Clouds().load("a")


@pytest.mark.parametrize("combination", ["C1", "C2", "C6"])
@pytest.mark.parametrize("nms_radius", [None, 1.3])
def test_the_default_front_is_correspond(combination, nms_radius):
    pair = load_clouds()
    case = make_case(combination=combination, nms_radius=nms_radius)
    record = matching.match_problem(case, None)
    assert not isinstance(record, str)
    matches = correspond(
        pair.source,
        pair.target,
        detector=case.detector,  # pyright: ignore[reportArgumentType]
        descriptor=case.descriptor,  # pyright: ignore[reportArgumentType]
        nms_radius=nms_radius,
    )
    assert_equal(record.matches, matches)
    assert_equal(match_by_front(case, matching.add_normals(pair, "pca"), pair), record.matches)


def describe_pair(resolution: float | None, **options: Any) -> tuple[DescribedCloud, DescribedCloud]:
    pair = load_clouds()
    source, target = (
        describe(cloud, resolution=resolution, **options) for cloud in (pair.source, pair.target)
    )
    return source, target


def test_mutual_matches_are_those_of_the_reference():
    usual, mutual = find_matches(), find_matches(front={"matching": "mutual"})
    source, target = describe_pair(usual.resolution)
    expected = reference_matching.match(
        source.descriptors.astype(float), target.descriptors.astype(float), mutual=True
    )
    assert 3 < len(expected) < len(usual)
    np.testing.assert_array_equal(mutual.source, source.points[[row[0] for row in expected]])
    np.testing.assert_array_equal(mutual.target, target.points[[row[1] for row in expected]])
    np.testing.assert_allclose(mutual.ratio, [row[6] for row in expected], atol=1e-6)
    np.testing.assert_allclose(mutual.similarity, [row[5] for row in expected], atol=1e-6)
    kept = {tuple(point) for point in mutual.source}
    chosen = np.array([tuple(point) in kept for point in usual.source])
    for name in ("similarity", "ratio", "source_lrf", "target_lrf"):
        np.testing.assert_array_equal(getattr(mutual, name), getattr(usual, name)[chosen])


@pytest.mark.parametrize("nuisance", [{}, {"nuisance": "benchmark_fakes:noise", "level": 0.1}])
def test_normals(nuisance):
    pair = benchmark_fakes.Meshes().load("a")
    if nuisance:
        case = make_case(MESH_DATA, **nuisance)
        pair = benchmark_fakes.noise(pair, 0.1, case.rng("nuisance"))
    mesh = find_matches(MESH_DATA, **nuisance)
    pca = find_matches(MESH_DATA, {"normals": "pca"}, **nuisance)
    assert_equal(mesh, correspond(pair.source, pair.target, normals="mesh"))
    assert_equal(pca, correspond(pair.source, pair.target, normals="pca"))
    assert not np.array_equal(mesh.target, pca.target)
    assert_equal(find_matches(MESH_DATA, {"normals": "mesh"}, **nuisance), mesh)


@pytest.mark.parametrize("combination", ["C1", "C2"])
def test_frames(combination):
    usual = find_matches(combination=combination)
    toldi = find_matches(front={"frames": "toldi"}, combination=combination)
    assert_equal_but(usual, toldi, "source_lrf", "target_lrf")
    pair = load_clouds()
    assert usual.resolution is not None
    for name, cloud in (("source", pair.source), ("target", pair.target)):
        rows = {tuple(point): row for row, point in enumerate(cloud.points)}
        keypoints = [rows[tuple(point)] for point in getattr(toldi, name)]
        expected = features.toldi_lrf(cloud.points, keypoints, radius=SUPPORT_RADIUS * usual.resolution)
        np.testing.assert_array_equal(getattr(toldi, f"{name}_lrf"), expected)


@pytest.mark.parametrize(
    ("front", "combination", "sweep"),
    [
        ({"harris_radius": 3.5}, "C1", None),
        ({"harris_radius": 3.5}, "C1", 1.5),
        ({"iss_radii": (4, 3)}, "C4", None),
        ({"iss_radii": (4, 3)}, "C4", 1.5),
    ],
)
def test_radii_of_detectors(front, combination, sweep):
    found = find_matches(front=front, combination=combination, nms_radius=sweep)
    pr = found.resolution
    assert pr is not None
    cloud = load_clouds().source
    if combination == "C1":
        keypoints = features.harris3d(cloud.points, radius=3.5 * pr, nms_radius=(sweep or 3.5) * pr)
    else:
        keypoints = features.iss(cloud.points, salient_radius=4 * pr, nms_radius=(sweep or 3) * pr)
    keypoints = features.drop_isolated(cloud.points, keypoints, radius=SUPPORT_RADIUS * pr)
    np.testing.assert_array_equal(found.source, cloud.points[keypoints])
    usual = find_matches(combination=combination, nms_radius=sweep)
    assert not np.array_equal(usual.source, found.source)


def test_resolution():
    noise = {"nuisance": "benchmark_fakes:noise", "level": 0.8}
    pair = load_clouds()
    noisy = benchmark_fakes.noise(pair, 0.8, make_case(**noise).rng("nuisance"))
    before = [features.resolution(cloud.points) for cloud in (pair.source, pair.target)]
    source, target = (features.resolution(cloud.points) for cloud in (noisy.source, noisy.target))
    expected = {
        "pair": (source + target) / 2,
        "undisturbed": sum(before) / 2,
        "source": source,
        "target": target,
    }
    assert len(set(expected.values())) == len(expected)
    for name, pr in expected.items():
        found = match_case(front={"resolution": name}, **noise)
        assert found.pr == found.matches.resolution == pr
        assert_equal(found.matches, correspond(noisy.source, noisy.target, resolution=pr))


@pytest.mark.parametrize("combination", ["C2", "C3"])
def test_raw_similarity(combination):
    usual = find_matches(combination=combination)
    raw = find_matches(front={"similarity": "raw"}, combination=combination)
    assert_equal_but(usual, raw, "similarity")
    descriptor = make_case(combination=combination).descriptor
    source, target = describe_pair(usual.resolution, descriptor=descriptor)
    rows = {tuple(point): row for row, point in enumerate(target.points)}
    partners = [rows[tuple(point)] for point in usual.target]
    misses = source.descriptors.astype(float) - target.descriptors[partners]
    np.testing.assert_allclose(raw.similarity, 1 - np.linalg.norm(misses, axis=1), atol=1e-6)


def list_fronts(**entry: Any) -> dict[str, str]:
    """What the cases of an experiment change, by combination."""
    experiment = ExperimentEntry(id="x", dataset=CLOUD_DATA, pairs=1, **entry)  # pyright: ignore[reportArgumentType]
    config = parse_config(CLOUDS).model_copy(update={"experiment": (experiment,)})
    [planned] = make_plan(config, None).sets
    return {case.matches: case.front for case in planned.problems}


def test_what_changes_nothing_for_a_case_is_left_out():
    both = ["C1", "C4"]
    assert list_fronts(combinations=both) == {"C1": "", "C4": ""}
    assert list_fronts(combinations=both, front={"harris_radius": 3, "iss_radii": [6, 4]}) == {
        "C1": '{"harris_radius": 3.0}',
        "C4": '{"iss_radii": [6.0, 4.0]}',
    }
    assert list_fronts(combinations=both, front={"harris_radius": 3})["C4"] == ""
    assert list_fronts(front={"resolution": "undisturbed"}) == {"C1": ""}
    noisy = {"nuisance": "benchmark_fakes:noise", "levels": [0.1]}
    undisturbed = list_fronts(front={"resolution": "undisturbed"}, **noisy)
    assert undisturbed == {"C1": '{"resolution": "undisturbed"}'}
    assert list_fronts(front={"similarity": "raw", "matching": "mutual", "frames": "shot"}) == {
        "C1": '{"matching": "mutual", "similarity": "raw"}'
    }


MUTUAL = (
    CLOUDS + CLOUDS.partition("methods")[2].partition("\n")[2].replace('"noise"', '"noise / mutual"', 1)
).rstrip() + '\nfront = { matching = "mutual" }\n'


def test_a_run_with_a_front_goes_on_and_keeps_the_default_apart(tmp_path):
    serial(CLOUDS, tmp_path)
    before = set(map(repr, contents(tmp_path)))
    assert serial(MUTUAL, tmp_path).counts["experiment"] == (16, 0, 16)
    assert before <= set(map(repr, contents(tmp_path)))
    frame = tables.load(tmp_path)
    usual, mutual = (frame[frame["experiments"] == (name,)] for name in ("noise", "noise / mutual"))
    assert (len(usual), len(mutual), len(frame)) == (8, 8, 16)
    assert set(usual["front"]) == {""}
    assert set(mutual["front"]) == {'{"matching": "mutual"}'}
    assert (mutual["n"].to_numpy() < usual["n"].to_numpy()).all()
    titles = [_describe_front(sample) for sample in Evidence(frame, pd.DataFrame()).further_samples()]
    assert titles == ["; front end: matching mutual"]
    serial(CLOUDS, tmp_path)
    assert set(tables.load(tmp_path)["front"]) == {""}
