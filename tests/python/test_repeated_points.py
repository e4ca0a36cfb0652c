"""Points that repeat change nothing in the front end: keypoints, normals, frames, descriptors, matches."""

from typing import Any

import numpy as np
from every_step import steps_of
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cgroup import features
from cgroup.datasets import standin_pair
from cgroup.registration import describe, detect, surface_normals

PAIR = standin_pair(pixels=36)
SCAN = np.vstack([PAIR.source.points, np.zeros((1, 3))])  # with the point of a missing return
FIELDS = ("descriptors", "points", "lrf", "resolution", "centroid")
PER_POINT = {"normals", "normals in a ball"}
ROWS = {"harris3d", "iss"}


@st.composite
def repetitions(draw: st.DrawFn) -> NDArray[np.int64]:
    """Rows of the scan, each at least once; the first of each in ascending order."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1), label="seed"))
    count = len(SCAN)
    times = np.ones(count, dtype=np.int64)
    kind = draw(st.sampled_from(["all", "some", "zeros", "one"]), label="repeated")
    most = draw(st.sampled_from([2, 3, 30]), label="times")
    if kind == "all":
        times[:] = most
    elif kind == "some":
        chosen = rng.uniform(size=count) < draw(st.floats(0.01, 0.99), label="share")
        times[chosen] = rng.integers(2, most + 1, chosen.sum())
    elif kind == "zeros":
        times[-1] = 1000
    else:
        times[rng.integers(count)] = 500
    if draw(st.booleans(), label="beside each other"):
        return np.repeat(np.arange(count), times)
    more = np.repeat(np.arange(count), times - 1)  # anywhere behind the first of each row
    places = np.concatenate([np.arange(count), more + rng.uniform(0.1, count, len(more))])
    return np.concatenate([np.arange(count), more])[np.argsort(places)]


def first_of(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.unique(rows, return_index=True)[1]


def signed_zeros(points: NDArray[Any], seed: int) -> NDArray[Any]:
    """Return the same places, some of whose zeros are -0."""
    negative = np.random.default_rng(seed).uniform(size=points.shape) < 0.5
    return np.where((points == 0) & negative, -0.0, points).astype(points.dtype)


@given(
    rows=repetitions(),
    dtype=st.sampled_from([np.float32, np.float64]),
    detector=st.sampled_from(["h3d", "iss"]),
)
@settings(max_examples=20)
def test_clouds_are_described_as_their_distinct_points(rows: Any, dtype: Any, detector: Any) -> None:
    scan = SCAN.astype(dtype)
    points, first = signed_zeros(scan[rows], 0), first_of(rows)
    np.testing.assert_array_equal(detect(points, detector=detector), first[detect(scan, detector=detector)])
    np.testing.assert_array_equal(surface_normals(points), surface_normals(scan)[rows])
    expected, found = describe(scan, detector=detector), describe(points, detector=detector)
    np.testing.assert_array_equal(found.indices, first[expected.indices])
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


@given(rows=repetitions(), as_cloud=st.booleans())
@settings(max_examples=20)
def test_every_step_gives_what_distinct_points_give(rows: Any, as_cloud: bool) -> None:
    points, first = SCAN[rows], first_of(rows)
    unit, normals = features.resolution(SCAN), features.normals(SCAN)
    keypoints = np.arange(0, len(SCAN), 7)
    faces = [[0, 1, 2]]
    expected = steps_of(SCAN, normals, unit=unit, rows=keypoints, faces=faces)
    cloud = features.Cloud(points) if as_cloud else points
    last = np.zeros(len(SCAN), dtype=np.int64)
    last[rows] = np.arange(len(rows))  # any of the points at a place stands for it
    found = steps_of(cloud, normals[rows], unit=unit, rows=last[keypoints], faces=faces)
    for name in expected.keys() - {"voxels", "mesh normals"}:
        usual, ours = expected[name](), found[name]()
        if name in PER_POINT:
            usual = usual[rows]
        elif name in ROWS:
            usual = first[usual]
        elif name == "drop_isolated":
            usual = last[usual]
        np.testing.assert_array_equal(ours, usual, err_msg=name)
    per_point = features.fpfh(cloud, normals[rows], radius=3 * unit)
    np.testing.assert_array_equal(per_point, features.fpfh(SCAN, normals, radius=3 * unit)[rows])
    assert features.choose_voxel(cloud, voxels=200) == features.choose_voxel(SCAN, voxels=200)
    for name, step in (("harris3d", features.harris3d), ("iss", features.iss)):
        np.testing.assert_array_equal(step(cloud), first[step(SCAN)], err_msg=name)


def test_a_place_has_the_first_normal_that_is_known() -> None:
    normals = features.normals(SCAN)
    points, twice = np.repeat(SCAN, 2, axis=0), np.repeat(normals, 2, axis=0)
    twice[::2] = np.nan
    unit = features.resolution(SCAN)
    usual = features.shot(SCAN, normals, [5], radius=9 * unit)
    np.testing.assert_array_equal(features.shot(points, twice, [10], radius=9 * unit), usual)
