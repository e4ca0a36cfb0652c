"""What a newcomer types first: names after a bare import, paths as clouds, names that other libraries use."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cgroup
from cgroup import InputError
from cgroup.datasets import standin_pair
from cgroup.io import read_cloud, write_cloud

PAIR = standin_pair(pixels=80)
LAZY = """
import sys, cgroup
heavy = ("cgroup.registration", "cgroup.io", "cgroup.features", "cgroup.plots", "matplotlib")
assert not [name for name in heavy if name in sys.modules], "loaded too early"
assert {"register", "read_cloud", "io", "features", "gtm"} <= set(dir(cgroup))
assert cgroup.register.__name__ == "register" and cgroup.read_cloud is cgroup.io.read_cloud
assert cgroup.features.resolution and cgroup.plots and cgroup.evaluation and cgroup.verification and cgroup.datasets
"""


def test_a_bare_import_has_what_people_look_for_and_loads_it_late() -> None:
    subprocess.run([sys.executable, "-c", LAZY], check=True, timeout=300)


def test_names_that_nobody_has_are_missing() -> None:
    with pytest.raises(AttributeError, match="module 'cgroup' has no attribute 'registr'"):
        _ = cgroup.registr  # type: ignore[attr-defined]


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


@pytest.mark.parametrize(
    ("cloud", "words"),
    [
        ("missing.ply", "source: missing.ply: no such file"),
        ("a scan", "source: a scan: unknown point"),
        ("", "dir"),
    ],
)
def test_paths_that_are_no_clouds(cloud: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        cgroup.register(cloud, PAIR.target)


@pytest.mark.parametrize("kind", [str, Path, read_cloud])
def test_a_cloud_in_place_of_normals_is_refused(
    files: tuple[Path, Path], kind: Callable[[Path], Any]
) -> None:
    points, normals, features = PAIR.source.points, kind(files[0]), cgroup.features
    calls: list[Callable[[], object]] = [
        lambda: features.fpfh(points, normals, radius=5),
        lambda: features.voxel_downsample(points, 5, normals=normals),
        lambda: features.harris3d(points, radius=5, normals=normals),
        lambda: cgroup.verification.Surface(points, normals, unit=5),
        lambda: cgroup.register(cgroup.types.PointCloud(points, normals), PAIR.target),
    ]
    for call in calls:
        with pytest.raises(
            InputError, match="normals: got .*; give \\(n,3\\) real numbers, one normal per point"
        ):
            call()


@pytest.mark.parametrize(
    ("option", "meant"),
    [
        ("voxel_size", "voxel"),
        ("num_threads", "threads"),
        ("max_correspondence_distance", "tolerance"),
        ("viewpont", "viewpoint"),
        ("mode", "modes"),
    ],
)
def test_unknown_options_say_which_was_meant(option: str, meant: str) -> None:
    with pytest.raises(InputError, match=f"lc has no '{option}' \\(did you mean '{meant}'\\?\\); it takes"):
        cgroup.register(PAIR.source, PAIR.target, **{option: 1})


def test_unknown_options_that_resemble_nothing() -> None:
    with pytest.raises(InputError, match="lc has no 'frobnicate'; it takes tolerance"):
        cgroup.register(PAIR.source, PAIR.target, frobnicate=1)


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
    assert done.probability > cgroup.register(PAIR.source, PAIR.target, view_direction=-towards).probability
    source = cgroup.registration.prepare(PAIR.source, view_direction=towards)
    center = PAIR.source.points.mean(axis=0)
    np.testing.assert_allclose(
        np.cross(center - source.viewpoint, towards) / np.linalg.norm(towards), 0, atol=1e-6 * np.ptp(center)
    )
