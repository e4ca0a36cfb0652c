"""The front end against the NumPy reference, under rigid motions, and on input that is hardly any."""

import sys
from fractions import Fraction

import numpy as np
import pytest
from every_step import steps_of
from hypothesis import given, settings
from hypothesis import strategies as st

from cgroup import CgroupError, InputError, features
from reference import fpfh, harris3d, iss, lfsh, matching, rcs, shot, shot_lrf, voxels
from reference import normals as planes
from strategies import random_motion

seeds = st.integers(0, 2**32 - 1)

ratios = st.floats(0.3, 1.2).filter(lambda ratio: ratio != 1)
"""Of eigenvalues; at 1 rounding decides between equal ones."""


def surface(seed, count=160):
    """Points at random places of a bumpy patch of about 10 x 10; resolution about 0.4."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(-5, 5, size=(2, count))
    a, b, c, d = rng.uniform(0.3, 1.2, size=4)
    return np.column_stack([u, v, a * np.sin(b * u + v) + c * np.cos(d * v)])


class TestAgainstReference:
    @given(seed=seeds, ignore_zero=st.booleans())
    def test_resolution(self, seed, ignore_zero):
        points = surface(seed, 50)
        points[7] = points[3]
        distances = np.linalg.norm(points[:, None] - points, axis=2)
        nearest = np.where(distances > 0, distances, np.inf).min(axis=1)
        expected = np.delete(nearest, [3, 7] if ignore_zero else [7]).mean()
        assert features.resolution(points, ignore_zero=ignore_zero) == pytest.approx(expected, rel=1e-12)

    @given(seed=seeds, neighbors=st.none() | st.integers(3, 40), radius=st.none() | st.floats(0.5, 20))
    def test_normals(self, seed, neighbors, radius):
        points = surface(seed)
        viewpoint = tuple(np.random.default_rng(seed).normal(scale=9, size=3))
        options = {"neighbors": neighbors, "radius": radius, "viewpoint": viewpoint}
        ours = features.normals(points, **options)
        np.testing.assert_allclose(ours, planes.normals(points, **options), atol=1e-6)

    @given(
        seed=seeds,
        options=st.fixed_dictionaries(
            {
                "radius": st.floats(0.6, 3),
                "nms_radius": st.none() | st.floats(0.5, 4),
                "response": st.sampled_from(["harris", "noble", "lowe", "tomasi", "curvature"]),
                "break_ties": st.booleans(),
            }
        ),
        threshold=st.sampled_from([0.0, 1e-6, 1e-3]),
        given_normals=st.booleans(),
    )
    def test_harris3d(self, seed, options, threshold, given_normals):
        points = surface(seed)
        options["normals"] = features.normals(points) if given_normals else None
        if given_normals:
            options["normals"][::17] = np.nan
        # Off the grid that responses are rounded to, and far above rounding errors.
        ours = features.harris3d(points, threshold=threshold + 1.3e-9, **options)
        radius, break_ties = options.pop("nms_radius") or options["radius"], options.pop("break_ties")
        scores = harris3d.responses(points, **options)
        theirs = harris3d.harris3d(
            points, scores, nms_radius=radius, threshold=threshold + 1.3e-9, break_ties=break_ties
        )
        odd = np.setxor1d(ours, theirs).astype(int)
        assert all(is_tie(points, scores, i, radius, 1.1 * 2**-28) for i in odd)

    @given(
        seed=seeds,
        nms=st.floats(0.5, 3),
        options=st.fixed_dictionaries(
            {
                "salient_radius": st.floats(0.8, 3),
                "gamma_21": ratios,
                "gamma_32": ratios,
                "min_neighbors": st.integers(1, 12),
                "density_weight": st.booleans(),
                "covariance": st.sampled_from(["point", "mean"]),
            }
        ),
    )
    def test_iss(self, seed, nms, options):
        points = surface(seed)
        ours = features.iss(points, nms_radius=nms, **options)
        scores = iss.saliencies(points, **options)
        theirs = iss.iss(points, scores, nms_radius=nms, min_neighbors=options["min_neighbors"])
        rounding = (
            1e-15 * len(points) * options["salient_radius"] ** 2
        )  # of an eigenvalue: that of the largest
        differ = np.setxor1d(ours, theirs).astype(int)
        assert all(is_tie(points, scores, i, nms, rounding) for i in differ)

    @pytest.mark.parametrize(
        ("step", "reference"),
        [
            (features.shot_lrf, shot_lrf.shot_lrf),
            (features.toldi_lrf, shot_lrf.toldi_lrf),
            (features.lfsh, lfsh.lfsh),
            (features.rcs, rcs.rcs),
        ],
    )
    @given(seed=seeds, radius=st.floats(0.5, 15))
    def test_frames_and_small_descriptors(self, step, reference, seed, radius):
        points = surface(seed)
        normals = features.normals(points, viewpoint=(0, 0, 50))
        normals[::13] = np.nan
        keypoints = np.arange(0, len(points), 7)
        given_normals = [normals] if step is features.lfsh else []
        theirs = [reference(points, *given_normals, i, radius=radius) for i in keypoints]
        np.testing.assert_allclose(step(points, *given_normals, keypoints, radius=radius), theirs, atol=1e-6)

    @given(seed=seeds, radius=st.floats(0.5, 15), pcl_compat=st.booleans(), own_frames=st.booleans())
    def test_shot(self, seed, radius, pcl_compat, own_frames):
        points = surface(seed)
        normals = features.normals(points, viewpoint=(0, 0, 50))
        normals[::13] = np.nan
        keypoints = np.arange(0, len(points), 23)
        options = {"radius": radius, "pcl_compat": pcl_compat}
        frames = None if own_frames else features.toldi_lrf(points, keypoints, radius=radius)
        ours = features.shot(points, normals, keypoints, lrf=frames, **options)
        each = [None] * len(keypoints) if own_frames else frames
        theirs = [
            shot.shot(points, normals, i, lrf=frame, **options)
            for i, frame in zip(keypoints, each, strict=True)
        ]
        assert ours.dtype == np.float32
        assert ours.shape == (len(keypoints), 352)
        np.testing.assert_allclose(ours, theirs, atol=1e-6)

    @given(
        seed=seeds,
        options=st.fixed_dictionaries(
            {
                "radius": st.floats(0.3, 8),
                "max_neighbors": st.none() | st.integers(1, 60),
                "convention": st.sampled_from(["open3d", "pcl"]),
            }
        ),
    )
    @settings(max_examples=30)
    def test_fpfh(self, seed, options):
        points = surface(seed, 90)
        points[7] = points[3]
        # Shaken, as which of two equal normals is closer to a line would be a matter of rounding.
        normals = features.normals(points, viewpoint=(0, 0, 50))
        normals += np.random.default_rng(seed).normal(scale=0.05, size=normals.shape)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        normals[::13] = np.nan
        ours = features.fpfh(points, normals, **options)
        distinct = np.delete(np.arange(len(points)), 7)  # points that coincide count once
        theirs = fpfh.fpfh(points[distinct], normals[distinct], **options)
        theirs = np.insert(theirs, 7, theirs[3], axis=0)
        assert ours.dtype == np.float32
        np.testing.assert_allclose(ours, theirs, atol=2e-3)
        keypoints = np.arange(0, len(points), 7)
        np.testing.assert_array_equal(features.fpfh(points, normals, keypoints, **options), ours[keypoints])

    @given(seed=seeds, count=st.integers(1, 200), voxel=st.floats(0.05, 30))
    def test_voxel_downsample(self, seed, count, voxel):
        points = surface(seed, count)
        normals = np.random.default_rng(seed).normal(size=(count, 3))
        normals[::11] = np.nan
        ours = features.voxel_downsample(points, voxel, normals=normals)
        means, directions, indices = voxels.voxel_downsample(points, normals, voxel)
        assert ours.indices.tolist() == indices
        np.testing.assert_allclose(ours.points, means, atol=1e-12)
        np.testing.assert_allclose(ours.normals, directions, atol=1e-9)
        alone = features.voxel_downsample(features.Cloud(points), voxel)
        assert alone.normals is None
        np.testing.assert_array_equal(alone.points, ours.points)

    @given(
        seed=seeds, counts=st.lists(st.integers(30, 300), min_size=1, max_size=3), voxels=st.integers(5, 100)
    )
    def test_choose_voxel(self, seed, counts, voxels):
        clouds = [surface(seed + i, count) for i, count in enumerate(counts)]
        size = features.choose_voxel(*clouds, voxels=voxels)
        widest = max(np.linalg.norm(np.ptp(cloud, axis=0)) for cloud in clouds)
        step = 16 * np.log2(size / widest)
        assert step == pytest.approx(round(step), abs=1e-9)
        assert features.choose_voxel(*(1000 * cloud for cloud in clouds), voxels=voxels) == pytest.approx(
            1000 * size
        )

        def total(size):
            return sum(len(features.voxel_downsample(cloud, size)) for cloud in clouds)

        most = min(voxels * len(clouds), sum(counts) // 2)
        assert total(size) <= most < total(size / 2 ** (1 / 16))

    @given(
        seed=seeds,
        sizes=st.tuples(st.integers(0, 40), st.integers(0, 40), st.integers(1, 40)),
        k=st.integers(1, 5),
        mutual=st.booleans(),
        max_distance=st.none() | st.floats(0.1, 5),
        levels=st.sampled_from([2, 5, 2**20]),
    )
    def test_match(self, seed, sizes, k, mutual, max_distance, levels):
        rng = np.random.default_rng(seed)
        rows, columns, length = sizes
        source = rng.integers(levels, size=(rows, length)) * (1.0 if levels < 9 else 3 / levels)
        target = rng.integers(levels, size=(columns, length)) * (1.0 if levels < 9 else 3 / levels)
        source[rng.uniform(size=rows) < 0.1, 0] = np.nan
        target[rng.uniform(size=columns) < 0.1, -1] = np.nan
        options = {"k": k, "mutual": mutual, "max_distance": max_distance}
        ours = features.match(source, target, **options)
        theirs = matching.match(source, target, **options)
        columns = [np.array(column) for column in zip(*theirs, strict=True)] or [np.empty(0)] * 8
        assert ours.source_indices.tolist() == columns[0].tolist()
        assert ours.target_indices.tolist() == columns[1].tolist()
        assert ours.rank.tolist() == columns[2].tolist()
        assert ours.is_mutual.tolist() == columns[7].tolist()
        names = ("distance", "second_distance", "similarity", "ratio")
        for name, column in zip(names, columns[3:7], strict=True):
            np.testing.assert_allclose(getattr(ours, name), column, rtol=1e-12, atol=1e-12, err_msg=name)


def is_tie(points, scores, i, radius, step=0.0):
    """Whether a rival's score is so near that rounding decides: cliques of points have the same ball."""
    near = np.linalg.norm(points - points[i], axis=1) < radius
    near[i] = False
    rivals = scores[near]
    return np.any(np.abs(rivals - scores[i]) <= step + 1e-9 * abs(scores[i]))


class TestRigidMotion:
    """A rigid motion of the cloud leaves keypoints and descriptors as they are."""

    @given(seed=seeds, moved_by=seeds, scale=st.floats(1e-3, 1e3))
    def test_keypoints(self, seed, moved_by, scale):
        points = surface(seed)
        motion = random_motion(np.random.default_rng(moved_by), 100)
        rotation, shift = motion[:3, :3], motion[:3, 3]
        moved = scale * (points @ rotation.T + shift)
        before = features.harris3d(points, radius=1.5, threshold=1e-6)
        after = features.harris3d(moved, radius=1.5 * scale, threshold=1e-6)
        assert before.tolist() == after.tolist()
        before = features.iss(points, salient_radius=1.5, nms_radius=1.1)
        after = features.iss(moved, salient_radius=1.5 * scale, nms_radius=1.1 * scale)
        assert before.tolist() == after.tolist()


class TestPromises:
    def test_threads_change_nothing(self):
        points = surface(5, 3000)
        normals = features.normals(points)
        keypoints = features.iss(points)

        faces = np.arange(len(points)).reshape(-1, 3)

        def run(threads):
            steps = steps_of(points, normals, unit=0.5, rows=keypoints, faces=faces, threads=threads)
            results = {name: step() for name, step in steps.items()}
            results["iss of a count"] = features.iss(points, threads=threads, count=100)
            results["match"] = features.match(
                results["shot"], results["shot"][::-1], threads=threads
            ).distance
            return {name: np.asarray(result).tobytes() for name, result in results.items()}

        assert run(1) == run(2) == run(5)

    def test_input_is_left_alone_and_any_layout_will_do(self):
        points = surface(6)
        expected = features.iss(points)
        points.flags.writeable = False
        wide = np.zeros((len(points), 6))
        wide[:, ::2] = points
        for same in (points, np.asfortranarray(points), wide[:, ::2], points.tolist()):
            assert features.iss(same).tolist() == expected.tolist()
        single = points.astype(np.float32)
        assert features.iss(single).tolist() == features.iss(single.astype(float)).tolist()

    @pytest.mark.parametrize("step", [features.harris3d, features.iss])
    @pytest.mark.parametrize("count", [5, 20, 60])
    def test_count_is_met(self, step, count):
        assert abs(len(step(surface(7, 4000), count=count)) - count) <= max(1, 0.1 * count)

    def test_drop_isolated(self):
        points = np.vstack([surface(8, 500), [[50.0, 0.0, 0.0], [50.1, 0.0, 0.0]]])
        keypoints = np.array([501, 3, 77, 500])
        kept = features.drop_isolated(points, keypoints, resolution=0.2)
        assert kept.tolist() == [3, 77]
        kept = features.drop_isolated(points, keypoints, radius=0.5, min_points=2)
        assert kept.tolist() == keypoints.tolist()

    def test_mesh_normals(self):
        u, v = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9), indexing="ij")
        points = np.column_stack([u.ravel(), v.ravel(), 0.3 * np.sin(5 * u.ravel())])
        first = (np.arange(8)[:, None] * 9 + np.arange(8)).ravel()
        faces = np.vstack([first[:, None] + corners for corners in ([0, 9, 1], [1, 9, 10])])
        expected = planes.mesh_normals(points, faces)
        np.testing.assert_allclose(features.mesh_normals(points, faces), expected, atol=1e-12)
        faces[::5] = faces[::5, ::-1]
        np.testing.assert_allclose(features.mesh_normals(points, faces), expected, atol=1e-12)


GRID = np.array([[x, y, 0.0] for x in range(10) for y in range(10)])
DEGENERATE = {
    "coincident": np.ones((40, 3)),
    "line": np.column_stack([np.arange(40.0), np.zeros((40, 2))]),
    "plane": GRID,
    "two": np.array([[0.0, 0, 0], [1, 0, 0]]),
    "one": np.zeros((1, 3)),
    "duplicates": np.repeat(GRID, 3, axis=0),
    "far away": GRID + 1e8,
    "tiny": GRID * 1e-12,
    "outlier": np.vstack([GRID, [[1e9, 1e9, 1e9]]]),
}


@pytest.mark.parametrize("name", DEGENERATE)
@pytest.mark.parametrize("reach", [0.4, 3.0, 1e3])
def test_degenerate_clouds_have_defined_results(name, reach):
    points = DEGENERATE[name]
    radius = reach * (1e-12 if name == "tiny" else 1.0)
    rows = np.arange(len(points))
    normals = features.normals(points, radius=radius)
    lengths = np.linalg.norm(normals, axis=1)
    assert np.all(np.isnan(lengths) | (np.abs(lengths - 1) < 1e-12))
    assert np.isnan(features.normals(points, neighbors=2)).all()
    for found in (
        features.harris3d(points, radius=radius),
        features.iss(points, salient_radius=radius, nms_radius=radius),
        features.drop_isolated(points, rows, radius=radius, min_points=1),
    ):
        assert np.all(np.diff(found) > 0)
        assert np.isin(found, rows).all()
    for frames in (features.shot_lrf, features.toldi_lrf):
        axes = frames(points, rows, radius=radius)
        valid = axes[~np.isnan(axes).any(axis=(1, 2))]
        np.testing.assert_allclose(
            valid @ valid.transpose(0, 2, 1), np.tile(np.eye(3), (len(valid), 1, 1)), atol=1e-9
        )
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    for table in (
        features.shot(points, up, rows, radius=radius),
        features.lfsh(points, up, rows, radius=radius),
        features.rcs(points, rows, radius=radius),
        features.fpfh(points, up, radius=radius),
        features.fpfh(points, up, radius=radius, max_neighbors=None, convention="pcl"),
    ):
        complete = np.isfinite(table).all(axis=1)
        assert np.isnan(table[~complete]).all()
        assert len(features.match(table, table)) == np.count_nonzero(complete)


def test_no_points_and_no_keypoints():
    nothing, points = np.empty((0, 3)), surface(1)
    found = {
        (0, 3): [features.normals(nothing), features.mesh_normals(nothing, [])],
        (0,): [features.harris3d(nothing), features.iss(nothing), features.drop_isolated(nothing, [])],
        (0, 3, 3): [step(points, [], radius=1) for step in (features.shot_lrf, features.toldi_lrf)],
        (0, 352): [features.shot(points, points, [], radius=1)],
        (0, 30): [features.lfsh(points, points, [], radius=1)],
        (0, 72): [features.rcs(points, [], radius=1)],
        (0, 33): [features.fpfh(nothing, nothing, radius=1), features.fpfh(points, points, [], radius=1)],
    }
    assert all(array.shape == shape for shape, arrays in found.items() for array in arrays)
    assert len(features.voxel_downsample(nothing, 1)) == 0
    assert len(features.match(np.empty((0, 5)), np.empty((0, 5)))) == 0
    with pytest.raises(InputError, match="two points"):
        features.resolution(nothing)


@given(
    seed=seeds,
    largest=st.integers(-400, 1000),
    smaller=st.lists(st.integers(-538, -530) | st.integers(-1000, 0), max_size=2),
)
@settings(max_examples=60)
def test_descriptors_of_any_size_find_their_nearest_or_are_refused(seed, largest, smaller):
    rng = np.random.default_rng(seed)
    exponents = [largest, *(max(largest + step, -1060) for step in smaller)]

    def draw(rows):
        return np.ldexp(rng.normal(size=(rows, 3)), rng.choice(exponents, (rows, 1)))

    source, target = draw(9), draw(7)
    refusal = None
    try:
        matches = features.match(source, target)
    except InputError as error:
        refusal = str(error)
    if refusal:
        assert "very different size" in refusal
        assert smaller, "descriptors of one size can be compared"
        return
    exact = [
        [sum((Fraction(a) - Fraction(b)) ** 2 for a, b in zip(f, g, strict=True)) for g in target]
        for f in source
    ]
    assert matches.source_indices.tolist() == list(range(9))
    for squares, found, distance in zip(exact, matches.target_indices, matches.distance, strict=True):
        assert squares[found] <= min(squares) * (1 + Fraction(1, 10**12))
        assert abs(Fraction(distance) ** 2 - squares[found]) <= Fraction(1, 10**9) * squares[found]


BAD_POINTS = surface(2)
BAD_POINTS[5, 1] = np.nan
GOOD_POINTS = surface(2)
UP = np.tile([0.0, 0.0, 1.0], (len(GOOD_POINTS), 1))


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: features.resolution(BAD_POINTS), "points.*row 5"),
        (lambda: features.normals(GOOD_POINTS.T), "transpose"),
        (lambda: features.normals(GOOD_POINTS, neighbors=0), "neighbors: got 0"),
        (lambda: features.normals(GOOD_POINTS, radius=0), "radius"),
        (lambda: features.mesh_normals(GOOD_POINTS, [[0, 1, 160]]), "faces.*row 0"),
        (lambda: features.mesh_normals(GOOD_POINTS, [[0, 1]]), "faces"),
        (lambda: features.harris3d(GOOD_POINTS, radius=-1), "radius: got -1"),
        (lambda: features.harris3d(GOOD_POINTS, response="moravec"), "response.*harris"),
        (lambda: features.harris3d(GOOD_POINTS, normals=UP[1:]), "normals: got 159 rows"),
        (lambda: features.harris3d(GOOD_POINTS, threshold=np.nan), "threshold"),
        (lambda: features.harris3d(GOOD_POINTS, count=0), "count: got 0"),
        (lambda: features.harris3d(GOOD_POINTS, resolution=0), "resolution: got 0"),
        (lambda: features.harris3d(np.ones((9, 3))), "9 points that all coincide"),
        (lambda: features.iss(GOOD_POINTS, gamma_21=0), "gamma_21"),
        (lambda: features.iss(GOOD_POINTS, min_neighbors=0), "min_neighbors"),
        (lambda: features.iss(GOOD_POINTS, covariance="median"), "covariance.*mean"),
        (lambda: features.shot(GOOD_POINTS, UP, [0, 160], radius=1), "keypoints: got index 160 in row 1"),
        (lambda: features.shot(GOOD_POINTS, UP, [-1], radius=1), "keypoints: got index -1"),
        (
            lambda: features.shot(GOOD_POINTS, UP, np.array([2**63], np.uint64), radius=1),
            "keypoints: got index 9",
        ),
        (lambda: features.shot(GOOD_POINTS, UP[1:], [0], radius=1), "normals: got 159 rows"),
        (lambda: features.shot(GOOD_POINTS, UP, [0], radius=np.inf), "radius"),
        (lambda: features.shot(GOOD_POINTS, UP, [0], radius=1, lrf=np.eye(3)), "lrf"),
        (lambda: features.fpfh(GOOD_POINTS, UP[1:], radius=1), "normals: got 159 rows"),
        (lambda: features.fpfh(GOOD_POINTS, UP, radius=0), "radius"),
        (lambda: features.fpfh(GOOD_POINTS, UP, radius=1, max_neighbors=0), "max_neighbors: got 0"),
        (lambda: features.fpfh(GOOD_POINTS, UP, radius=1, convention="itk"), "convention.*pcl"),
        (lambda: features.voxel_downsample(GOOD_POINTS, 0), "voxel: got 0"),
        (lambda: features.voxel_downsample(GOOD_POINTS, 1e-30), "larger voxel"),
        (lambda: features.voxel_downsample(GOOD_POINTS, 1, normals=UP[1:]), "normals: got 159 rows"),
        (features.choose_voxel, "clouds: got none"),
        (lambda: features.choose_voxel(GOOD_POINTS, voxels=0), "voxels: got 0"),
        (lambda: features.choose_voxel(np.ones((5, 3))), "coincide"),
        (lambda: features.match([[1.0]], [[1.0, 2.0]]), "target"),
        (lambda: features.match([1.0], [[1.0]]), "source"),
        (lambda: features.match([[1.0]], [[1.0]], max_distance=0), "max_distance"),
        (lambda: features.match([[1.0]], [[1.0]], k=0), "k: got 0"),
        (lambda: features.match([[1e-200]], [[1.0], [2e-200]]), "very different size"),
    ],
)
def test_bad_input_is_explained(call, says):
    with pytest.raises(InputError, match=says):
        call()


def test_missing_open3d_is_explained(monkeypatch):
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(CgroupError, match=r"cgroup\[open3d\].*libegl1 libgl1 libx11-6.*libgomp1"):
        features.iss(GOOD_POINTS, backend="open3d")
