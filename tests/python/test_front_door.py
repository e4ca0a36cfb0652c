"""What a newcomer types first: names after a bare import, paths as clouds, names that other libraries use."""

import copy
import inspect
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cgroup
from cgroup import InputError
from cgroup.datasets import make_problem, standin_pair
from cgroup.io import read_cloud, write_cloud
from cgroup.registration import PreparedScan, prepare, register, register_many

PAIR = standin_pair(pixels=80)
PROBLEM = make_problem(np.random.default_rng(0), 300, inlier_ratio=0.3)
MATCHES = PROBLEM.correspondences()
LAZY = """
import sys, cgroup
assert not hasattr(cgroup, "registr")
heavy = ("cgroup.registration", "cgroup.io", "cgroup.features", "cgroup.plots", "matplotlib")
assert not [name for name in heavy if name in sys.modules], "loaded too early"
assert {"register", "read_cloud", "io", "features", "gtm"} <= set(dir(cgroup))
assert not {"annotations", "errors", "registry", "types", "interrupts"} & set(dir(cgroup))
assert cgroup.register.__name__ == "register" and cgroup.read_cloud is cgroup.io.read_cloud
assert cgroup.merge is cgroup.register_all is cgroup.scenes.register_all
names = {"Registration", "assess", "locate", "merge", "prepare", "recognize", "register_many"}
assert names <= set(dir(cgroup)) and all(callable(getattr(cgroup, name)) for name in names)
assert cgroup.comparison.compare and cgroup.nuisances and cgroup.pages
assert cgroup.features.resolution and cgroup.plots and cgroup.evaluation and cgroup.verification and cgroup.datasets
"""


def test_a_bare_import_has_what_people_look_for_and_loads_it_late() -> None:
    subprocess.run([sys.executable, "-c", LAZY], check=True, timeout=300)


@pytest.fixture(name="files")
def cloud_files(tmp_path: Path) -> tuple[Path, Path]:
    files = tmp_path / "source.ply", tmp_path / "target.ply"
    for file, cloud in zip(files, (PAIR.source, PAIR.target), strict=True):
        write_cloud(file, cloud)
    return files


@pytest.mark.parametrize("kind", [str, Path])
def test_paths_are_clouds(files: tuple[Path, Path], kind: type) -> None:
    source, target = (kind(file) for file in files)
    found = cgroup.register(source, target)
    np.testing.assert_array_equal(
        found.T_target_source, cgroup.register(PAIR.source, PAIR.target).T_target_source
    )
    assert len(cgroup.features.Cloud(source)) == len(PAIR.source.points)
    assert len(cgroup.registration.register_many([source, target])) == 1


@pytest.mark.parametrize("kind", [str, Path, read_cloud])
def test_a_cloud_in_place_of_normals_is_refused(
    files: tuple[Path, Path], kind: Callable[[Path], Any]
) -> None:
    points, normals = PAIR.source.points, kind(files[0])
    calls: list[Callable[[], object]] = [
        lambda: cgroup.features.fpfh(points, normals, radius=5),
        lambda: cgroup.register(cgroup.types.PointCloud(points, normals), PAIR.target),
    ]
    for call in calls:
        with pytest.raises(InputError, match=r"normals: got .*; give \(n,3\) real numbers, one normal"):
            call()


@pytest.mark.parametrize(
    ("option", "says"),
    [
        ("voxel_size", "there is no 'voxel_size' (did you mean 'voxel'?)"),
        ("leaf_size", "there is no 'leaf_size' (did you mean 'voxel'?)"),
        ("viewpont", "there is no 'viewpont' (did you mean 'viewpoint'?)"),
        (
            "max_correspondence_distance",
            "lc has no 'max_correspondence_distance' (did you mean 'tolerance'?)",
        ),
        ("frobnicate", "lc has no 'frobnicate'; it takes tolerance"),
    ],
)
def test_unknown_options_say_which_was_meant(option: str, says: str) -> None:
    with pytest.raises(InputError, match=re.escape(says)):
        cgroup.register(PAIR.source, PAIR.target, **{option: 1})


def test_an_attribute_of_other_libraries_leads_to_ours() -> None:
    done = register(PAIR.source, PAIR.target)
    for theirs, ours in {"transformation": "T_target_source", "converged": "ok"}.items():
        with pytest.raises(AttributeError, match=f"no '{theirs}'; did you mean '{ours}'"):
            getattr(done, theirs)
    assert not hasattr(done, "nothing")
    for same in (copy.copy(done), pickle.loads(pickle.dumps(done))):
        assert same.probability == done.probability


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), [0, 0, 0], np.zeros(3)])
def test_one_viewpoint_serves_both_clouds(place: Any) -> None:
    one = cgroup.register(PAIR.source, PAIR.target, viewpoint=place)
    other = cgroup.register(PAIR.source, PAIR.target, source_viewpoint=place, target_viewpoint=place)
    assert one.probability == other.probability
    mixed = cgroup.register(PAIR.source, PAIR.target, viewpoint=(1e3, 0, 0), source_viewpoint=place)
    assert mixed.probability != one.probability


def test_the_direction_of_view_stands_for_a_place_far_away() -> None:
    towards = PAIR.source.points.mean(axis=0) - PAIR.source_viewpoint
    done = cgroup.register(PAIR.source, PAIR.target, view_direction=towards)
    assert done.ok
    source = cgroup.registration.prepare(PAIR.source, view_direction=towards)
    center = PAIR.source.points.mean(axis=0)
    np.testing.assert_allclose(
        np.cross(center - source.viewpoint, towards) / np.linalg.norm(towards), 0, atol=1e-6 * np.ptp(center)
    )


SOURCE, TARGET = PROBLEM.source, PROBLEM.target


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: cgroup.gtm(SOURCE, TARGET, treshold=0.5), "gtm has no 'treshold' (did you mean 'threshold'?)"),  # type: ignore[call-arg]
        (lambda: cgroup.group(MATCHES, "gtm", treshold=0.5), "gtm has no 'treshold' (did you mean 'threshold'?)"),
        (lambda: cgroup.group(MATCHES, "ransac", max_iteration=9), "did you mean 'iterations'?"),
        (lambda: cgroup.group(MATCHES, resolution=1.0), "Correspondences(source, target, resolution=...)"),
        (lambda: cgroup.group_many([MATCHES], num_threads=1), "did you mean 'threads'?"),
        (lambda: prepare(PAIR.source, voxel_size=1.0), "prepare has no 'voxel_size' (did you mean 'voxel'?)"),  # type: ignore[call-arg]
        (lambda: register_many([PAIR.source, PAIR.target], viewpoint_s=1), "did you mean 'viewpoints'?"),
        (lambda: cgroup.gtm(SOURCE, TARGET, 0.5), "got 3 by position; gtm takes source, target so, and options by name"),  # type: ignore[misc]
        (lambda: cgroup.group(SOURCE, TARGET), 'group(Correspondences(source, target), "gtm"), or call gtm('),  # type: ignore[arg-type]
        (lambda: cgroup.gtm(np.ones((9, 4)), np.ones((9, 3))), "such as cloud[:, :3]"),
    ],
)  # fmt: skip
def test_wrong_calls_say_in_one_sentence_what_was_meant(call: Callable[[], Any], words: str) -> None:
    with pytest.raises(InputError) as caught:
        call()
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


FUNCTIONS = [
    function
    for room in (cgroup.methods, cgroup.features, cgroup.registration)
    for function in map(vars(room).get, room.__all__)
    if inspect.isfunction(function) and "options" not in inspect.signature(function).parameters
]


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.__name__)
def test_every_function_explains_wrong_calls(function: Callable[..., Any]) -> None:
    with pytest.raises(InputError, match=f"{function.__name__} has no 'nosuch'; it takes "):
        function(nosuch=1)
    assert pickle.loads(pickle.dumps(function)) is function


def test_errors_from_within_a_function_stay_what_they_are() -> None:
    def fail(_stage: str) -> None:
        raise TypeError("mine")

    with pytest.raises(TypeError, match="mine"):
        prepare(PAIR.source, progress=fail)


@pytest.mark.parametrize("share", [0.12, 0.16, 0.2])
def test_coarse_voxels_that_are_no_surface_are_passed_over(share: float) -> None:
    voxel = share * np.ptp(PAIR.source.points, axis=0).max()
    source, target = (prepare(cloud, voxel=voxel) for cloud in (PAIR.source, PAIR.target))
    assert min(len(source), len(target)) >= 20
    (done,) = register_many([target, source])
    assert done is None or done.voxel == voxel


@pytest.mark.parametrize("viewpoint", [None, PAIR.source_viewpoint])
def test_prepared_scans_can_be_pickled(viewpoint: tuple[float, float, float] | None) -> None:
    source = prepare(PAIR.source, viewpoint=viewpoint)
    again: PreparedScan = pickle.loads(pickle.dumps(source))
    assert repr(again) == repr(source)
    ones = [register(scan, PAIR.target, target_viewpoint=PAIR.target_viewpoint) for scan in (source, again)]
    for name in ("T_target_source", "covariance", "probability", "fitness"):
        np.testing.assert_array_equal(*(getattr(one, name) for one in ones))


def test_many_scans_share_a_viewpoint_or_a_direction() -> None:
    scans, place = [PAIR.source, PAIR.target], PAIR.source_viewpoint
    one, same = (
        register_many(scans, **given)[0] for given in ({"viewpoint": place}, {"viewpoints": 2 * [place]})
    )  # type: ignore[arg-type]
    assert one is not None
    assert same is not None
    assert one.probability == same.probability
    pair = standin_pair(seed=1, turn=60.0, pixels=80)
    towards, views = pair.source.points.mean(axis=0) - pair.source_viewpoint, [pair.source, pair.target]
    right, wrong = (register_many(views, view_direction=way)[0] for way in (towards, -towards))
    assert right is not None
    assert right.ok
    assert wrong is None or wrong.probability < right.probability
    with pytest.raises(InputError, match="viewpoint, view_direction, viewpoints: give one of them"):
        register_many(scans, viewpoint=place, viewpoints=2 * [place])


def test_digits_lost_far_from_the_origin_are_told() -> None:
    offset = np.array([500_000.0, 5_400_000.0, 300.0])
    source, target = PAIR.source.points, PAIR.target.points
    fine = register(source + offset, target + offset)
    coarse = register((source + offset).astype(np.float32), (target + offset).astype(np.float32))
    assert register(source.astype(np.float32), target.astype(np.float32)).notes == fine.notes == ()
    for name, note in zip(("source", "target"), coarse.notes, strict=True):
        assert note.startswith(
            f"{name}: coordinates of single precision lie 0.5 apart so far from the origin"
        )
    with pytest.raises(
        cgroup.NoConsensusError, match="lie 0.5 apart so far from the origin.*subtract an offset"
    ):
        register((source / 30 + offset).astype(np.float32), (target / 30 + offset).astype(np.float32))
