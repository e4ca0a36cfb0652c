"""What `register` can't work with: one sentence that says what to do, or an honest no; never a wrong pose."""

import contextlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from register_shapes import FloatArray, cylinder, moved, plane, sphere

from cgroup import features
from cgroup.datasets import standin_pair
from cgroup.errors import InputError, NoConsensusError
from cgroup.registration import DenseFront, PaperFront, prepare, register
from cgroup.rigid import apply
from interrupts import interrupt, posix_only
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
        ([], "source: got 0 points"),
        (np.empty((0, 3)), "source: got 0 points"),
        (SOURCE[:3], "source: got 3 points"),
        (SOURCE[:10], "source: got 10 points"),
        (SOURCE[::200][:20], "source: got 20 points"),
        (SOURCE.T, "source: got shape .*transpose it"),
        (SOURCE[:, :2], "source: got shape"),
        (3.0, "source: got shape"),
        (None, "source: got None; give .* an array"),
        ("scan.ply", "source: scan.ply: no such file"),
        (SOURCE.astype(complex), "source: got an array of complex128"),
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
        ({"voxel": -1}, "voxel: got -1"),
        ({"voxel": np.nan}, "voxel: got nan"),
        ({"voxel": np.inf}, "voxel: got inf"),
        ({"voxel": "2"}, "voxel: got '2'; give a number"),
        ({"voxel": 1000}, "source: .* fill 1 voxel of size 1000"),
        ({"voxel": 60}, "source: .*; 20 are needed: give .* a smaller `voxel`"),
        ({"voxel": 0.01}, "source: 0 of its .* voxels of 0.01 .* give a larger `voxel`"),
        ({"voxel": 1e-9}, "voxel: got .* give a larger voxel"),
        ({"voxel": 1e-300}, "voxel: got .* give a larger voxel"),
        ({"source_viewpoint": (0, 0)}, r"source_viewpoint: got \(0, 0\); give three finite numbers"),
        ({"target_viewpoint": (0, 0, np.nan)}, "target_viewpoint: got .*nan"),
        ({"target_viewpoint": (0, 0, 1e6)}, "target_viewpoint: got .* across; give the scanner's place"),
        ({"source_viewpoint": "here"}, "source_viewpoint: got 'here'; give an array"),
        ({"view_direction": (0, 0, 0)}, r"view_direction: got a zero vector; give .* such as \(0, 0, -1\)"),
        ({"view_direction": (0, 1)}, r"view_direction: got \(0, 1\); give three finite numbers"),
        ({"view_direction": (0, 0, 1), "viewpoint": (0, 0, 0)}, "viewpoint, view_direction: give one"),
        ({"axis": (0, 0, 0)}, r"axis: got a zero vector; give .* such as \(0, 0, 1\)"),
        ({"axis": (0, 1)}, r"axis: got \(0, 1\)"),
        ({"axis": (0, 0, np.nan)}, "axis: got"),
        ({"axis": "z"}, "axis: got"),
        ({"effort": "max"}, "effort: got 'max'; choose one of low, normal, high"),
        ({"effort": None}, "effort: got None"),
        ({"front": "fast"}, "front: got 'fast'; choose one of dense, paper"),
        ({"method": "icp"}, "method: got 'icp'; choose one of"),
        ({"frobnicate": 1}, "lc has no 'frobnicate'"),
        ({"threads": 0}, "threads: got 0"),
        ({"front": PaperFront(normals="mesh")}, "neither cloud has faces"),
    ],
)
def test_options_that_make_no_sense_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        register(SOURCE, TARGET, **options)


def test_so_many_voxels_that_matching_takes_long_are_refused() -> None:
    points = np.random.default_rng(0).uniform(size=(200_000, 3))
    with pytest.raises(
        InputError, match="source: 200000 points, .*; 100000 are allowed: give a larger `voxel`"
    ):
        register(points, points, voxel=0.01)


@pytest.mark.parametrize("radius", [0, -1, np.nan, "2"])
def test_radii_of_the_fronts_are_checked(radius: Any) -> None:
    with pytest.raises(InputError, match="support: got"):
        DenseFront(support=radius)
    with pytest.raises(InputError, match="harris_radius: got"):
        PaperFront(harris_radius=radius)
    for radii in ((2.7, radius), (radius,), radius):
        with pytest.raises(InputError, match="iss_radii: got"):
            PaperFront(iss_radii=radii)


@pytest.mark.parametrize("name", ["detector", "descriptor", "normals", "frames", "matching", "similarity"])
def test_words_of_the_papers_front_are_checked(name: str) -> None:
    with pytest.raises(InputError, match=f"{name}: got 'else'; choose one of"):
        PaperFront(**{name: "else"})


def test_prepare_names_its_own_arguments() -> None:
    with pytest.raises(InputError, match="cloud: got 3 points"):
        prepare(SOURCE[:3])
    with pytest.raises(InputError, match="^viewpoint: got"):
        prepare(SOURCE, viewpoint=(1, 2))


@pytest.mark.parametrize(
    ("scale", "error", "words"),
    [
        *(
            (scale, NoConsensusError, "if both show the same, scale one, or let `register` estimate `scale`")
            for scale in (2.54, 10, 1 / 12)
        ),
        (
            25.4,
            InputError,
            "target, source: .* across, no voxel suits both; give the same unit, or cut the larger",
        ),
    ],
)
def test_clouds_in_different_units_are_refused(scale: float, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        register(scale * SOURCE, TARGET)


@pytest.mark.parametrize("motion", [np.eye(4), random_motion(np.random.default_rng(1), 300.0)])
def test_a_cloud_lies_on_itself(motion: FloatArray) -> None:
    found = register(SOURCE, apply(motion, SOURCE))
    assert found.ok
    np.testing.assert_allclose(
        apply(found.T_target_source, SOURCE), apply(motion, SOURCE), atol=0.1 * found.voxel
    )


def test_a_raster_that_no_voxel_suits_is_registered() -> None:
    x, y = np.meshgrid(np.arange(70.0), np.arange(70.0))
    z = (
        5 * np.sin(0.13 * x) * np.cos(0.09 * y)
        + 0.002 * x * y
        + 8 * np.exp(-((x - 20) ** 2 + (y - 50) ** 2) / 90)
    )
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    target, _ = moved(points)
    found = register(points, target)
    np.testing.assert_allclose(apply(found.T_target_source, points), target, atol=0.2)


@pytest.mark.parametrize("seed", range(4))
def test_few_points_are_registered_or_refused(seed: int) -> None:
    rng = np.random.default_rng(seed)
    few = SOURCE[rng.choice(len(SOURCE), 300, replace=False)]
    target, _ = moved(few)
    try:
        found = register(few, target)
    except NoConsensusError:
        return
    np.testing.assert_allclose(apply(found.T_target_source, few), target, atol=found.voxel)


@pytest.mark.parametrize("count", [30, 50, 100, 180])
def test_few_points_are_refused_by_a_verdict_or_placed_right(count: int) -> None:
    few = SOURCE[np.random.default_rng(count).choice(len(SOURCE), count, replace=False)]
    target, _ = moved(few)
    try:
        found = register(few, target)
    except NoConsensusError:
        return
    np.testing.assert_allclose(apply(found.T_target_source, few), target, atol=found.voxel)


def test_too_few_points_are_refused() -> None:
    with pytest.raises(InputError, match="source: 21 points, .*; 20 are needed: give more points$"):
        register(SOURCE[:: len(SOURCE) // 21][:21], TARGET)


@pytest.mark.parametrize(
    ("shape", "motions"),
    [
        (lambda seed: plane(seed, noise=0), 3),
        (lambda seed: plane(seed, noise=0) + np.array([0.5 * seed, 0, 0]), 3),  # halves that share a third
        (sphere, 3),
        (cylinder, 2),
    ],
)
def test_what_fixes_no_pose_is_refused(shape: Callable[[int], FloatArray], motions: int) -> None:
    with pytest.raises(NoConsensusError, match="no pose that can be trusted") as caught:
        register(shape(0), moved(shape(1), 1)[0])
    best = caught.value.registration
    assert best is not None
    assert f"free to move in {motions} of six ways" in best.notes[0]


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


def test_advice_names_a_viewpoint_from_which_the_points_hide_each_other() -> None:
    other = standin_pair(seed=1, pixels=80)
    aside = [cloud.mean(axis=0) + np.array([0, np.ptp(cloud), 0]) for cloud in (SOURCE, other.target.points)]
    eyes = {"source_viewpoint": PAIR.source_viewpoint, "target_viewpoint": other.target_viewpoint}
    with pytest.raises(NoConsensusError, match="a viewpoint may be wrong"):
        register(SOURCE, other.target, **eyes)
    for name, place in zip(eyes, aside, strict=True):
        words = f"seen from {name}, points lie behind each other: give .* `view_direction`"
        with pytest.raises(NoConsensusError, match=words):
            register(SOURCE, other.target, **{**eyes, name: place})


@pytest.mark.parametrize("normals", [-features.normals(SOURCE), np.full_like(SOURCE, np.nan), 0 * SOURCE])
def test_normals_of_the_file_are_not_used(normals: FloatArray) -> None:
    plain, found = register(SOURCE, TARGET), register(replace(PAIR.source, normals=normals), TARGET)
    np.testing.assert_array_equal(found.T_target_source, plain.T_target_source)


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_normals_that_are_asked_for_must_be_directions(value: float) -> None:
    clouds = [
        replace(cloud, normals=np.full_like(cloud.points, value)) for cloud in (PAIR.source, PAIR.target)
    ]
    with pytest.raises(InputError, match="normals: all of those that came with the source are zero or NaN"):
        register(*clouds, front=PaperFront(normals="given"))


@pytest.mark.parametrize("strays", [[0.0, 0.0, 0.0], [0.0, 0.0, 5e3]])
def test_stray_points_do_no_harm(strays: list[float]) -> None:
    found = register(np.vstack([SOURCE, np.tile(strays, (500, 1))]), TARGET)
    assert np.abs(apply(found.T_target_source, SOURCE) - apply(TRUTH, SOURCE)).max() < found.voxel


@pytest.mark.parametrize(
    "make",
    [
        lambda rng, n: rng.uniform(size=(n, 3)),
        lambda rng, n: rng.normal(size=(n, 3)),
        lambda rng, n: plane(int(rng.integers(100)), n),
    ],
    ids=["box", "blob", "plane"],
)
@pytest.mark.parametrize("count", [100, 1000])
def test_clouds_without_a_shape_come_to_an_end(make: Callable[..., FloatArray], count: int) -> None:
    rng = np.random.default_rng(count)
    with contextlib.suppress(NoConsensusError, InputError):
        assert register(make(rng, count), make(rng, count)).ok


@posix_only
def test_control_c_is_heard() -> None:
    program = """
import numpy as np
from cgroup.registration import register
points = np.random.default_rng(0).uniform(size=(2_000_000, 3))
try:
    while True:
        register(points, points[::-1], voxel=0.04, progress=lambda stage: print(stage, flush=True))
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""
    assert interrupt(program, after="source voxels").endswith("interrupted\n")
