"""Poses from surveyed targets: least squares, blunders, doubts, and their files."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from command_lines import run
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cgroup import InputError, TargetFit, fit_targets
from cgroup.datasets import standin_pair
from cgroup.io import read_targets, read_transform, write_cloud
from cgroup.rigid.se3 import about, deviations_at, vector_of


def survey(rng, count, *, blunder=0.0, site=None, sd=None, utm=False, flat=False):
    """Targets of a site in two frames, the true pose, and the row of the blunder."""
    site = rng.uniform(20, 200) if site is None else site
    sd = rng.uniform(0.002, 0.005) if sd is None else sd
    source = rng.uniform(-0.5, 0.5, (count, 3)) * [site, site, site / 4]
    if flat:
        source[:, 2] = rng.normal(0, 0.02, count)
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([*rng.normal(0, 0.05, 2), rng.uniform(-3, 3)]).as_matrix()
    pose[:3, 3] = rng.uniform(-100, 100, 3) + (np.array([5e5, 5.3e6, 300]) if utm else 0)
    target = source @ pose[:3, :3].T + pose[:3, 3] + rng.normal(0, sd, (count, 3))
    row = int(rng.integers(count))
    way = rng.normal(size=3)
    target[row] += blunder * way / np.linalg.norm(way)
    return source + rng.normal(0, sd, (count, 3)), target, pose, row


def is_within_two_deviations(fit: TargetFit, target: np.ndarray, true: np.ndarray) -> bool:
    middle = target.mean(axis=0)
    error = vector_of(true @ np.linalg.inv(fit.pose), middle)
    degrees, length = deviations_at(fit.covariance, middle)
    turn, shift = np.degrees(np.linalg.norm(error[:3])), np.linalg.norm(error[3:])
    return bool(turn < 2 * degrees and shift < 2 * length)


KINDS = [{}, {"utm": True}, {"flat": True}, {"utm": True, "flat": True}]


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_a_blunder_is_named_and_the_pose_is_within_two_deviations(kind):
    rng = np.random.default_rng(7)
    named = within = 0
    for _ in range(60):
        source, target, pose, row = survey(rng, rng.integers(4, 31), blunder=0.5, **kind)
        fit = fit_targets(source, target)
        is_named = np.flatnonzero(fit.is_blunder).tolist() == [row]
        assert is_named or not fit.ok
        named += is_named
        within += is_within_two_deviations(fit, target, pose)
    assert named >= 59
    assert within >= 57


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_without_a_blunder_none_is_named(kind):
    rng = np.random.default_rng(8)
    jobs = [survey(rng, rng.integers(4, 31), **kind) for _ in range(60)]
    fits = [fit_targets(source, target) for source, target, _, _ in jobs]
    assert not any(fit.is_blunder.any() for fit in fits)
    assert sum(fit.ok for fit in fits) >= 58
    assert sum(map(is_within_two_deviations, fits, *[*zip(*jobs, strict=True)][1:3])) >= 57


@pytest.mark.parametrize("flat", [False, True])
def test_of_four_targets_a_blunder_is_named_or_doubted(flat):
    rng = np.random.default_rng(9)
    named = {None: 0, 0.005: 0}
    for _ in range(100):
        source, target, _, row = survey(rng, 4, blunder=0.5, sd=0.0035, flat=flat)
        for sigma in named:
            fit = fit_targets(source, target, sigma=sigma)
            assert not fit.ok or np.flatnonzero(fit.is_blunder).tolist() == [row]
            named[sigma] += bool(fit.is_blunder[row])
    assert named[None] >= 85
    assert named[0.005] >= 98


def test_a_blunder_that_every_triangle_explains_is_not_named():
    square = np.array([[0, 0, 0], [50, 0, 0], [50, 50, 0], [0, 50, 0.0]])
    lifted = square + np.random.default_rng(0).normal(0, 0.003, (4, 3))
    lifted[2, 2] += 0.5
    fit = fit_targets(square, lifted, sigma=0.004)
    assert not fit.ok
    assert not fit.is_blunder.any()
    assert "a blunder exists that cannot be named: it is among 1, 2, 3, 4" in fit.notes


def test_several_blunders_are_named():
    rng = np.random.default_rng(10)
    for _ in range(20):
        source, target, _, _ = survey(rng, 12, sd=0.003)
        rows = rng.choice(12, 3, replace=False)
        target[rows] += rng.choice([-1, 1], (3, 3)) * rng.uniform(0.2, 0.6, (3, 3))
        assert np.flatnonzero(fit_targets(source, target).is_blunder).tolist() == sorted(rows)


def test_the_covariance_is_that_of_the_errors():
    rng = np.random.default_rng(11)
    source, target, pose, _ = survey(rng, 8, site=60, sd=0.0)
    middle, distances = target.mean(axis=0), []
    for _ in range(400):
        fit = fit_targets(source, target + rng.normal(0, 0.005, target.shape), sigma=0.005)
        error, change = vector_of(pose @ np.linalg.inv(fit.pose), middle), about(middle)
        distances.append(error @ np.linalg.solve(change @ fit.covariance @ change.T, error))
    assert 4.8 < np.mean(distances) < 6.6  # 6 for a known sigma


def test_doubts_are_noted():
    rng = np.random.default_rng(12)
    source, target, _, _ = survey(rng, 8, site=60, sd=0.003)
    three = fit_targets(source[:3], target[:3])
    assert not three.ok
    assert "three targets have no redundancy in which a blunder could be named" in three.notes
    assert np.isnan(three.leave_one_out).all()
    assert fit_targets(source[:3], target[:3], sigma=0.005).ok
    for changed, note in [
        (source[:, [1, 0, 2]], "one file has x and y swapped"),
        (source / 0.3048, "the units differ: the target's distances are 0.30"),
        (source * 1.01, "the units differ: the target's distances are 0.990"),
    ]:
        fit = fit_targets(changed, target)
        assert not fit.ok
        assert any(note in one for one in fit.notes)
    assert "the residuals are larger than sigma explains" in fit_targets(source, target, sigma=1e-4).notes
    line = np.array([[0, 0, 0], [10, 0, 0.01], [20, 0.01, 0], [30, 0, 0], [40, -0.01, 0]])
    fit = fit_targets(line, line + rng.normal(0, 0.005, line.shape))
    assert any("almost on one line" in note for note in fit.notes)
    exact = fit_targets(source, source + np.array([5e5, 5e6, 0]))
    assert exact.ok
    assert exact.sigma < 1e-8


def test_targets_are_matched_by_name():
    points = {
        name: np.array(place, float)
        for name, place in {
            "a": (0, 0, 0),
            "b": (9, 0, 0),
            "c": (0, 9, 0),
            "d": (0, 0, 9),
            "e": (5, 5, 5),
        }.items()
    }
    moved = {name: points[name] + 1 for name in "dcbae"} | {"f": np.zeros(3)}
    fit = fit_targets(points | {"g": np.ones(3)}, moved)
    assert fit.names == [*"abcde"]
    assert fit.notes == ("only in the source: g", "only in the target: f")
    np.testing.assert_allclose(fit.pose[:3, 3], 1)


SQUARE = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]


@pytest.mark.parametrize(
    ("source", "target", "options", "message"),
    [
        (SQUARE[:2], SQUARE[:2], {}, "2 and 2 targets"),
        (SQUARE, SQUARE[:3], {}, "4 and 3 targets"),
        (SQUARE, SQUARE, {"names": "abca"}, "3 for 4 targets"),
        (SQUARE, SQUARE, {"sigma": 0.0}, "sigma"),
        (SQUARE, SQUARE, {"sigma": 1e300}, "sigma: got 1e300"),
        (SQUARE, 1e151 * np.array(SQUARE), {}, "target: .* beyond 1e150"),
        (1e-160 * np.array(SQUARE), SQUARE, {}, "source: .* use a smaller unit"),
        (SQUARE, SQUARE + np.array([1e14, 0, 0]), {"sigma": 1e145}, "source, target, sigma: .* in one unit"),
        (SQUARE, [*SQUARE[:3], [1, np.nan, 0]], {}, "isn't finite in row 3"),
        ([[0, 0, k] for k in range(5)], [[0, 0, k] for k in range(5)], {}, "on one line"),
        ([[1, 2, 3]] * 4, SQUARE, {}, "on one line"),
        (
            {"a": [0, 0, 0], "b": [1, 0, 0]},
            {"A": [0, 0, 0], "b": [1, 0, 0]},
            {},
            "source: a, b; target: A, b",
        ),
        (np.random.default_rng(0).normal(size=(1001, 3)), np.zeros((1001, 3)), {}, "three to 1000"),
    ],
)
def test_wrong_targets_are_refused(source, target, options, message):
    with pytest.raises(InputError, match=message):
        fit_targets(source, target, **options)


@pytest.mark.parametrize("size", [1e-50, 1e-20, 1e20, 1e120])
@pytest.mark.parametrize("sigma", [None, 1e-250, 1e-3])
def test_results_follow_the_unit(size, sigma):
    source, target, _, row = survey(np.random.default_rng(13), 8, blunder=0.5, site=60)
    plain = fit_targets(source, target, sigma=sigma)
    scaled = fit_targets(size * source, size * target, sigma=None if sigma is None else sigma * size)
    assert scaled.is_blunder[row]
    np.testing.assert_array_equal(scaled.is_used, plain.is_used)
    np.testing.assert_allclose(scaled.pose[:3, :3], plain.pose[:3, :3], rtol=0, atol=1e-12)
    for name in ("residuals", "leave_one_out", "sigma"):
        np.testing.assert_allclose(getattr(scaled, name) / size, getattr(plain, name), rtol=1e-8, atol=1e-12)
    units = np.repeat([1, size], 3)
    np.testing.assert_allclose(
        scaled.covariance / units[:, None] / units, plain.covariance, rtol=1e-7, atol=0
    )


NAMES = st.text("abcÄ-_.0123456789 ", min_size=1, max_size=8).map(str.strip).filter(bool)
NUMBERS = st.floats(-1e7, 1e7).map(lambda value: round(value, 3))


@settings(max_examples=60)
@given(
    st.dictionaries(NAMES, st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=5),
    st.sampled_from(";\t,"),
    st.booleans(),
    st.booleans(),
    st.sampled_from(["", "x", "BM 7"]),
)
def test_files_of_targets_are_read(tmp_path_factory, rows, separator, is_comma, has_head, code):
    is_comma = is_comma and separator != ","
    file = tmp_path_factory.mktemp("targets") / "t.csv"
    lines = [["Punkt", "Rechtswert", "Hochwert", "Höhe"]] if has_head else []
    lines += [
        [name, *(repr(value).replace(".", "," if is_comma else ".") for value in row), code]
        for name, row in rows.items()
    ]
    file.write_text("".join(separator.join(line) + "\n" for line in lines), encoding="utf-8")
    found = read_targets(file)
    assert [*found] == [*rows]
    np.testing.assert_array_equal([*found.values()], [*rows.values()])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("T1;1;2;3\n\nT1;1;2;3\n", "line 3: the target T1 is listed twice"),
        ("# names\nT1 1 nan 3\n", "line 2: the target T1 has a coordinate that isn't finite"),
        ("T1;1;2\n", "line 1: a target is a name, x, y and z"),
        ("T 1 1.0 2.0 3.0\n", "line 1: five columns"),
        ("T1,1,5,2,5,3,5\n", "line 1: its commas may be decimal ones"),
        ("T1;1,5;2;3\nT2;1.5;2;3\n", "line 2"),
        ("T1 one 2 3\nT2 1 2 3\n", "line 1"),
        ("x y z\n", "line 1"),
        ("", "empty"),
        ("\0\1;\2;;\n", "line 1"),
    ],
)
def test_wrong_files_of_targets_are_refused(tmp_path, content, message):
    (tmp_path / "t.csv").write_text(content)
    with pytest.raises(InputError, match=message):
        read_targets(tmp_path / "t.csv")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder of two clouds and of their surveyed targets, one of them a blunder."""
    folder = tmp_path_factory.mktemp("site")
    pair, rng = standin_pair(pixels=60), np.random.default_rng(0)
    write_cloud(folder / "a.ply", pair.source)
    write_cloud(folder / "b.ply", pair.target)
    source = rng.uniform(-80, 80, (7, 3))
    target = source @ pair.T_target_source[:3, :3].T + pair.T_target_source[:3, 3]
    target += rng.normal(0, 0.02, target.shape)
    target[2, 0] += 5
    for name, points in (("scan.csv", source), ("site.csv", target)):
        rows = (
            f"T{row};" + ";".join(f"{value:.4f}".replace(".", ",") for value in point) + "\n"
            for row, point in enumerate(points)
        )
        (folder / name).write_text("name;x;y;z\n" + "".join(rows))
    return folder, pair.T_target_source


def test_group_writes_the_pose_and_the_report(site, tmp_path, capsys):
    folder, true = site
    given = ["group", "--targets", folder / "scan.csv", folder / "site.csv", "--out", tmp_path]
    status, out, err = run(capsys, *given, "--html")
    assert (status, err) == (0, "")
    assert "T2 is a blunder: " in out
    assert np.abs(read_transform(tmp_path / "scan_on_site.txt") - true).max() < 0.1
    rows = [*csv.DictReader((tmp_path / "scan_on_site_targets.csv").read_text().splitlines())]
    assert [row["verdict"] for row in rows] == ["used", "used", "blunder", *4 * ["used"]]
    for row in rows:
        length = np.linalg.norm([float(row[name]) for name in ("dx", "dy", "dz")])
        assert float(row["residual"]) == pytest.approx(length)
        assert float(row["leave_one_out"]) > 0.999 * length
    page = (tmp_path / "scan_on_site_targets.html").read_text()
    assert all(f'<th scope="row">T{row}</th>' in page for row in range(7))
    document = json.loads(run(capsys, *given, "--json")[1])
    assert document["results"]["redundancy"] == 12
    assert document["results"]["targets"][2]["verdict"] == "blunder"


def test_register_judges_the_pose_of_targets_on_the_clouds(site, tmp_path, capsys):
    folder, true = site
    clouds, files = [folder / "a.ply", folder / "b.ply"], [folder / "scan.csv", folder / "site.csv"]
    status, out, err = run(capsys, "register", *clouds, "--targets", *files, "--out", tmp_path, "--json")
    assert (status, err) == (0, "")
    results = json.loads(out)["results"]
    assert results["ok"]
    assert results["T_target_source"] == results["targets"]["T_target_source"]
    assert np.abs(read_transform(tmp_path / "a_on_b.txt") - true).max() < 0.1
    assert (tmp_path / "a_on_b_targets.csv").is_file()
    back = run(capsys, "register", *clouds, "--targets", *reversed(files), "--out", tmp_path / "back")
    assert back[0] == 3
    assert "the clouds do not confirm the pose of the targets" in back[2]


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["group"], 2, "give either MATCHES, or --targets"),
        (["group", "scan.csv", "--targets", "scan.csv", "site.csv"], 2, "give either MATCHES, or --targets"),
        (["group", "--targets", "scan.csv", "missing.csv"], 2, "missing.csv: no such file"),
        (
            ["group", "--targets", "scan.csv", "site.csv", "--sigma", "0.0001"],
            3,
            "larger than sigma explains",
        ),
        (
            ["register", "a.ply", "b.ply", "--targets", "scan.csv", "site.csv", "--scale", "1", "2"],
            2,
            "--scale",
        ),
    ],
)
def test_commands_refuse_what_they_cannot_use(site, tmp_path, capsys, arguments, status, message):
    places = [site[0] / word if Path(word).suffix in (".csv", ".ply") else word for word in arguments]
    ended, _, err = run(capsys, *places, "--out", tmp_path / "out")
    assert (ended, message in err) == (status, True), err
