"""What `register` can't work with: one sentence that says what to do, or an honest no; never a wrong pose."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from register_shapes import FloatArray, moved

from cgroup import features
from cgroup.datasets import standin_pair
from cgroup.errors import InputError, NoConsensusError
from cgroup.registration import PaperFront, register
from cgroup.rigid import apply
from strategies import random_motion

PAIR = standin_pair(pixels=80)
SOURCE, TARGET, TRUTH = PAIR.source.points, PAIR.target.points, PAIR.T_target_source


LINE = np.linspace(0, 100, 1000)[:, None] * np.array([1.0, 2.0, 0.5])


def with_row(row: Any, at: int = 5) -> FloatArray:
    points = SOURCE.copy()
    points[at] = row
    return points


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (np.empty((0, 3)), "source: got 0 points"),
        (SOURCE[::200][:20], "source: got 20 points"),
        (SOURCE[:: len(SOURCE) // 21][:21], "source: 21 points, .*; 20 are needed: give more points$"),
        (SOURCE.T, "source: got shape .*transpose it"),
        ("scan.ply", "source: scan.ply: no such file"),
        (np.ma.masked_less(SOURCE, 0), "source: got a masked array; drop its masked rows first"),
        (with_row(np.nan), r"source: got \[NaN, NaN, NaN\] in row 5"),
        (with_row([0, 0, np.inf]), "source: got .*inf.* in row 5"),
        (with_row([0, 0, 1e300]), "beyond 1e150"),
        (1000 * SOURCE, "source.* across; scale them to the same unit"),
        (np.ones((1000, 3)), "source: all its points coincide"),
        (np.repeat(SOURCE[:5], 100, axis=0), "source: got 5 distinct points; .* more than 20"),
        (LINE, "source: 0 of its .* voxels .* fix a plane; .* on a line"),
    ],
)
def test_clouds_that_make_no_sense_are_refused(source: Any, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        register(source, TARGET)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=words.replace("source", "target")):
        register(TARGET, source)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"voxel": 0}, "voxel: got 0"),
        ({"voxel": 1000}, "source: .* fill 1 voxel of size 1000"),
        ({"voxel": 60}, "source: .*; 20 are needed: give .* a smaller `voxel`"),
        ({"voxel": 0.01}, "source: 0 of its .* voxels of 0.01 .* give a larger `voxel`"),
        ({"voxel": 1e-9}, "voxel: got .* give a larger voxel"),
        ({"source_viewpoint": (0, 0)}, r"source_viewpoint: got \(0, 0\); give three finite numbers"),
        ({"target_viewpoint": (0, 0, np.nan)}, "target_viewpoint: got .*nan"),
        ({"target_viewpoint": (0, 0, 1e6)}, "target_viewpoint: got .* across; give the scanner's place"),
        ({"view_direction": (0, 0, 0)}, r"view_direction: got a zero vector; give .* such as \(0, 0, -1\)"),
        ({"view_direction": (0, 0, 1), "viewpoint": (0, 0, 0)}, "viewpoint, view_direction: give one"),
        ({"axis": (0, 0, 0)}, r"axis: got a zero vector; give .* such as \(0, 0, 1\)"),
        ({"axis": (0, 0, np.nan)}, "axis: got"),
        ({"effort": "max"}, "effort: got 'max'; choose one of low, normal, high"),
        ({"front": "fast"}, "front: got 'fast'; choose one of dense, paper"),
        ({"front": PaperFront(normals="mesh")}, "neither cloud has faces"),
    ],
)
def test_options_that_make_no_sense_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        register(SOURCE, TARGET, **options)


def test_so_many_voxels_that_matching_takes_long_are_refused() -> None:
    points = np.random.default_rng(0).uniform(size=(200_000, 3))
    with pytest.raises(InputError, match="source: 200000 points, .*; 100000 are allowed: give a larger"):
        register(points, points, voxel=0.01)


@pytest.mark.parametrize(
    ("scale", "error", "words"),
    [
        (2.54, NoConsensusError, "if both show the same, scale one, or let `register` estimate `scale`"),
        (1 / 12, NoConsensusError, "if both show the same, scale one, or let `register` estimate `scale`"),
        (25.4, InputError, "target, source: .* across, no voxel suits both; give the same unit, or cut"),
    ],
)
def test_clouds_in_different_units_are_refused(scale: float, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        register(scale * SOURCE, TARGET)


@pytest.mark.parametrize("motion", [np.eye(4), random_motion(np.random.default_rng(1), 300.0)])
def test_a_cloud_lies_on_itself(motion: FloatArray) -> None:
    target = apply(motion, SOURCE)
    found = register(SOURCE, target)
    np.testing.assert_allclose(apply(found.T_target_source, SOURCE), target, atol=0.1 * found.voxel)


def test_a_raster_that_no_voxel_suits_is_registered() -> None:
    x, y = np.meshgrid(np.arange(70.0), np.arange(70.0))
    hill = 8 * np.exp(-((x - 20) ** 2 + (y - 50) ** 2) / 90)
    z = 5 * np.sin(0.13 * x) * np.cos(0.09 * y) + 0.002 * x * y + hill
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    target, _ = moved(points)
    found = register(points, target)
    np.testing.assert_allclose(apply(found.T_target_source, points), target, atol=0.2)


@pytest.mark.parametrize("count", [30, 100, 180, 300])
def test_few_points_are_refused_by_a_verdict_or_placed_right(count: int) -> None:
    few = SOURCE[np.random.default_rng(count).choice(len(SOURCE), count, replace=False)]
    target, _ = moved(few)
    try:
        found = register(few, target)
    except NoConsensusError:
        return
    np.testing.assert_allclose(apply(found.T_target_source, few), target, atol=found.voxel)


@pytest.mark.parametrize(("share", "aside"), [(2.0, 0.0), (1.0, 0.0), (1.0, 300.0)])
@pytest.mark.parametrize("both", [False, True])
def test_a_wrong_viewpoint_never_makes_a_wrong_pose_right(share: float, aside: float, both: bool) -> None:
    behind = [tuple(share * cloud.mean(axis=0) + [aside, 0, 0]) for cloud in (SOURCE, TARGET)]
    try:
        found = register(
            SOURCE, TARGET, source_viewpoint=behind[0], target_viewpoint=behind[1] if both else (0, 0, 0)
        )
    except NoConsensusError:
        return
    assert np.abs(apply(found.T_target_source, SOURCE) - apply(TRUTH, SOURCE)).max() < found.voxel


def test_normals_of_the_file_are_not_used() -> None:
    plain = register(SOURCE, TARGET)
    for normals in (-features.normals(SOURCE), np.full_like(SOURCE, np.nan)):
        found = register(replace(PAIR.source, normals=normals), TARGET)
        np.testing.assert_array_equal(found.T_target_source, plain.T_target_source)
