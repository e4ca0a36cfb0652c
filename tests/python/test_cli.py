"""The command line: what its commands write, and that wrong input is one line and an exit status."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from command_lines import fail, results_in, run, succeed, write_inputs
from scenes import stone_model, stone_scene

from benchmark_runs import CLOUDS
from cgroup import METHODS, Correspondences, group
from cgroup.datasets import make_problem
from cgroup.evaluation import match_errors
from cgroup.io import (
    PointCloud,
    read_cloud,
    read_correspondences,
    read_descriptors,
    read_transform,
    write_cloud,
    write_correspondences,
    write_transform,
)
from cgroup.registration import describe
from cgroup.registry import label_of
from cgroup.rigid import apply, rotation_error

pytestmark = pytest.mark.usefixtures("elsewhere")

Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scans, models, matches, and files with which something is wrong."""
    path = tmp_path_factory.mktemp("input")
    write_inputs(path)
    source = read_cloud(path / "source.ply")
    write_transform(path / "inverse.txt", np.linalg.inv(read_transform(path / "truth.txt")))
    for name, way in (("near", 15.0), ("far", 1e6)):
        moved = read_transform(path / "truth.txt")
        moved[0, 3] += way
        write_transform(path / f"{name}.txt", moved)
    write_cloud(path / "metres.ply", PointCloud(1e-3 * source.points))
    (path / "scaled.txt").write_text("2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n")
    (path / "again").mkdir()
    for name in ("stone1", "stone2", "stone3", "again/stone1"):
        model = stone_model(int(name[-1]))
        trimesh.Trimesh(model.points, model.faces, process=False).export(path / f"{name}.ply")
    write_cloud(path / "scene.ply", stone_scene([1, 2, 1])[0])
    write_cloud(path / "bare.ply", stone_scene([3])[0])
    return path


@pytest.fixture
def pair(folder: Path) -> tuple[Path, Path]:
    return folder / "source.ply", folder / "target.ply"


def is_picture(path: Path) -> bool:
    return path.read_bytes().startswith(b"\x89PNG")


# --- what commands write -------------------------------------------------------------------------


def test_register(pair: tuple[Path, Path], tmp_path: Path, capsys: Capture) -> None:
    out = succeed(capsys, "register", *pair, "--method", "ransac", "--out", "result/here")
    result = tmp_path / "result" / "here"
    expected = read_cloud(pair[0]).transformed(read_transform(result / "source_on_target.txt")).points
    np.testing.assert_allclose(read_cloud(result / "source_on_target_aligned.ply").points, expected)
    assert read_correspondences(result / "source_on_target.npz").ratio is not None
    assert is_picture(result / "source_on_target.png")
    assert results_in(result) == sorted(re.findall(r"^  (source_\S+)  ", out, re.MULTILINE))


def facts_of(out: str) -> dict[str, str]:
    """Return what is said by name, each on one line."""
    said = re.sub(r"\n {12}(?=\S)", " ", out)
    return {
        line[:11].rstrip(): line[12:] for line in said.splitlines() if line[11:12] == " " and line[:1] != " "
    }


def test_register_describes_its_result(folder: Path, pair: tuple[Path, Path], capsys: Capture) -> None:
    said = facts_of(succeed(capsys, "register", *pair))
    document = json.loads(succeed(capsys, "register", *pair, "--json"))
    results = document["results"]
    parts = ["schema_version", "cgroup_version", "command", "inputs", "options", "results", "files"]
    assert list(document) == parts
    assert [one["role"] for one in document["inputs"]] == ["source", "target"]
    assert document["options"]["effort"] == "normal"
    assert all(Path(file).exists() for file in document["files"])
    written = read_transform("out/source_on_target.txt")
    np.testing.assert_array_equal(results["T_target_source"], written)
    assert results["ok"] is True
    pose = read_transform(folder / "truth.txt")
    turn = rf"rotated by {rotation_error(pose, np.eye(4)):.0f}\.?\d* degrees about the axis \(0\.48, 0\.30, 0\.82\)"
    assert re.match(turn, said["pose"])
    assert said["probability"] == f"{results['probability']:.3f} that the pose is correct"
    shares = [f"{100 * results[name]:.0f} %" for name in ("fitness", "target_fitness")]
    assert all(share in said["overlap"] for share in shares)
    assert said["deviation"].startswith(f"{results['deviation_deg']:.2g} degrees, ")
    assert not {"voxel", "matches", "time", "truth"} & set(said)
    assert {"voxel", "matches", "time"} < set(facts_of(succeed(capsys, "register", *pair, "--verbose")))


def test_register_by_matches_of_a_file(
    pair: tuple[Path, Path], tmp_path: Path, folder: Path, capsys: Capture
) -> None:
    rng, truth = np.random.default_rng(0), read_transform(folder / "truth.txt")
    points = rng.permutation(read_cloud(pair[0]).points)[:300]
    matched = points @ truth[:3, :3].T + truth[:3, 3]
    matched[100:] = rng.permutation(matched[100:])
    write_correspondences("own.npz", Correspondences(points, matched))
    said = json.loads(succeed(capsys, "register", *pair, "--matches", "own.npz", "--method", "gtm", "--json"))
    assert (said["options"]["matches"], said["results"]["matches"]) == ("own.npz", 300)
    assert 100 <= said["results"]["selected"] < 200
    assert rotation_error(read_transform("out/source_on_target.txt"), truth) < 1
    own = tmp_path / "out" / "source_on_target.npz"
    before = own.read_bytes()
    assert "is one of the inputs" in fail(capsys, "register", *pair, "--matches", own)
    assert own.read_bytes() == before


def test_register_near_a_rough_pose(pair: tuple[Path, Path], folder: Path, capsys: Capture) -> None:
    line = ("register", *pair, "--initial", folder / "near.txt", "--truth", folder / "truth.txt", "--json")
    succeed(capsys, "register", *pair)
    matches = Path("out/source_on_target.npz")
    assert matches.exists()
    said = json.loads(succeed(capsys, *line, "--radius", 30, "--angle", 5))
    done = said["results"]
    assert done["truth"]["right"]
    assert done["matches"] == 0
    assert not matches.exists()
    assert [Path(name).suffix for name in said["files"]] == [".txt", ".ply", ".png"]
    status, _, err = run(capsys, *line, "--radius", 2, "--angle", 1)
    assert status == 3
    assert "give a larger --radius or --angle, or no --initial" in err


def test_register_with_another_unit(folder: Path, capsys: Capture) -> None:
    line = ("register", folder / "metres.ply", folder / "target.ply", "--scale", 500, 2000)
    written = ("--out", "of-metres", "--merged", "--html")
    facts = facts_of(succeed(capsys, *line, *written))
    assert float(facts["scale"].split()[0]) == pytest.approx(1000, rel=0.01)
    done = json.loads(succeed(capsys, *line, *written, "--json"))["results"]
    assert done["scale"] == pytest.approx(1000, rel=0.01)
    aligned = read_cloud(Path("of-metres/metres_on_target_aligned.ply"))
    expected = apply(np.array(done["T_target_source"]), read_cloud(folder / "metres.ply").points)
    np.testing.assert_allclose(aligned.points, expected, atol=1e-6)
    status, _, err = run(capsys, *line, "--truth", folder / "truth.txt")
    assert status == 2
    assert "--truth: files of poses have no scale" in err


@pytest.mark.parametrize(
    ("name", "verdict"), [("truth", "right: "), ("near", "wrong: "), ("inverse", ""), ("far", "")]
)
def test_register_tells_how_far_the_truth_is(
    name: str, verdict: str, folder: Path, pair: tuple[Path, Path], capsys: Capture
) -> None:
    line = ("register", *pair, "--truth", folder / f"{name}.txt")
    said = facts_of(succeed(capsys, *line))["truth"]
    truth = json.loads(succeed(capsys, *line, "--json"))["results"]["truth"]
    assert said.startswith(verdict)
    assert f"{truth['rotation_error_deg']:.3g} degrees and " in said
    assert truth["right"] is {"right: ": True, "wrong: ": False, "": None}[verdict]
    assert ("under the inverse of this truth" in said) == (name == "inverse") == truth["right_if_inverted"]
    assert ("no point of the source overlaps the target" in said) == (name in {"inverse", "far"})


def test_a_refused_guess_is_judged_too(folder: Path, capsys: Capture) -> None:
    line = ("register", folder / "source.ply", folder / "bare.ply", "--truth", folder / "inverse.txt")
    status, out, err = run(capsys, *line)
    assert (status, err.count("\n")) == (3, 1)
    assert facts_of(out)["truth"].startswith("the refused guess is ")
    status, out, err = run(capsys, *line, "--json")
    document = json.loads(out)
    assert (status, document["error"]["kind"]) == (3, "NoConsensusError")
    assert not document["guess"]["truth"]["right"]


def test_assess(folder: Path, pair: tuple[Path, Path], tmp_path: Path, capsys: Capture) -> None:
    said = facts_of(succeed(capsys, "assess", *pair, folder / "truth.txt", "--verbose"))
    assert {"pose", "probability", "overlap", "residual", "deviation", "voxel", "time"} < set(said)
    assert "next" not in said
    np.savetxt(tmp_path / "wrong.txt", np.diag([1.0, -1.0, -1.0, 1.0]) + np.eye(4, k=3) * 1e8)
    status, _, err = run(capsys, "assess", *pair, tmp_path / "wrong.txt")
    assert status == 3
    assert "cgroup register SOURCE TARGET --initial POSE --html" in " ".join(err.split())
    assert not (tmp_path / "out").exists()
    for pose, ends in ((folder / "truth.txt", 0), (tmp_path / "wrong.txt", 3)):
        status, out, err = run(capsys, "assess", *pair, pose, "--html", "--out", "judged")
        (page,) = results_in(tmp_path / "judged")
        assert page.endswith("_assessed.html")
        assert (status, page in (err if ends else out)) == (ends, True)
        text = (tmp_path / "judged" / page).read_text(encoding="utf-8")
        assert ("Refused" in text) == (ends == 3)


def test_both_clouds_can_be_written_as_one(pair: tuple[Path, Path], tmp_path: Path, capsys: Capture) -> None:
    out = succeed(capsys, "register", *pair, "--merged")
    assert "both clouds merged" in out
    assert "--merged" not in out  # what was given is not advised
    both = read_cloud(tmp_path / "out" / "source_on_target_merged.ply")
    sizes = [len(read_cloud(file)) for file in pair]
    assert max(sizes) < len(both) < sum(sizes)
    assert both.colors is not None
    assert {(230, 159, 0), (0, 114, 178)} < {tuple(color) for color in both.colors.tolist()}


def test_compare(folder: Path, pair: tuple[Path, Path], tmp_path: Path, capsys: Capture) -> None:
    line = ("compare", *pair, "--truth", folder / "truth.txt")
    out = succeed(capsys, *line)
    written = tmp_path / "out" / "source_on_target_"
    rows = list(csv.DictReader(Path(f"{written}comparison.csv").read_text().splitlines()))
    assert [row["method"] for row in rows] == list(METHODS)
    for row in rows:
        assert label_of(row["method"]) in out
        assert 0 <= float(row["precision"]) <= 1
        assert float(row["milliseconds"]) > 0
    assert is_picture(Path(f"{written}comparison.png"))
    assert "inverse" not in out
    lines = out.splitlines()
    (head,) = (row for row, line in enumerate(lines) if line.startswith("method"))
    assert lines[head].split()[:6] == ["method", "selected", "precision", "recall", "F", "registered"]
    scores = [float(line.split()[4]) for line in lines[head + 1 :][: len(METHODS)]]
    assert scores == sorted(scores, reverse=True)
    assert max(len(line) for line in lines if str(folder) not in line) <= 80
    rows = json.loads(succeed(capsys, *line, "--json"))["results"]["methods"]
    assert [row["method"] for row in rows] == list(METHODS)
    assert all((row["T_target_source"] is None) == (row["rotation_error_deg"] is None) for row in rows)
    status, out, _ = run(capsys, "compare", *pair, "--truth", folder / "inverse.txt")
    assert status == 0
    assert "would be correct under the inverse of this truth" in out


def test_demo(tmp_path: Path, capsys: Capture) -> None:
    out = succeed(capsys, "demo", "--out", "pictures")
    assert "GTM" in out
    assert re.search(r"^truth +right: ", out, re.MULTILINE)
    for name in ("source.ply", "target.ply", "truth.txt"):
        assert (tmp_path / "pictures" / name).exists()
    for ending in ("_comparison.csv", "_comparison.png", ".txt", "_aligned.ply"):
        assert (tmp_path / "pictures" / f"source_on_target{ending}").exists()


@pytest.mark.parametrize("name", ["matches.npz", "matches.txt"])
def test_group(name: str, folder: Path, tmp_path: Path, capsys: Capture) -> None:
    out = succeed(capsys, "group", folder / name, "--method", "gtm")
    assert "40 of 60 selected by GTM" in out
    assert (
        "wrote matches_gtm_mask.txt, matches_gtm_transform.txt, matches_gtm_residuals.txt to out/"
        in " ".join(out.split())
    )
    given = read_correspondences(folder / name)
    found = group(given, "gtm")
    mask = np.loadtxt(tmp_path / "out/matches_gtm_mask.txt", dtype=bool)
    np.testing.assert_array_equal(mask, found.mask)
    pose = read_transform(tmp_path / "out/matches_gtm_transform.txt")
    np.testing.assert_array_equal(pose, found.transform())
    residuals = np.loadtxt(tmp_path / "out/matches_gtm_residuals.txt")
    np.testing.assert_array_equal(residuals, match_errors(given.source, given.target, pose))


def test_group_that_chance_could_have_made(tmp_path: Path, capsys: Capture) -> None:
    """All is printed and written; the exit status tells a script, also beside JSON."""
    problem = make_problem(np.random.default_rng(0), 300, inlier_ratio=0.0)
    write_correspondences(tmp_path / "chance.npz", problem.correspondences())
    status, out, err = run(capsys, "group", "chance.npz")
    assert status == 3
    words = (
        r"cgroup: this group may be due to chance: \S+ groups as good are expected from wrong matches alone\n"
    )
    assert re.fullmatch(words, err)
    assert "reliable    no: " in out
    assert len(results_in(tmp_path / "out")) == 3
    status, out, again = run(capsys, "group", "chance.npz", "--json")
    assert (status, again, json.loads(out)["results"]["ok"]) == (3, err, False)


def test_group_without_a_pose_leaves_no_older_one(folder: Path, tmp_path: Path, capsys: Capture) -> None:
    matches = read_correspondences(folder / "matches.npz")
    for count, files in ((60, 3), (2, 1), (0, 1)):
        some = Correspondences(matches.source[:count], matches.target[:count], resolution=matches.resolution)
        write_correspondences(tmp_path / "some.npz", some)
        status, _, err = run(capsys, "group", "some.npz")
        assert (status, err == "") == (0 if count > 2 else 3, count > 2)
        assert len(results_in(tmp_path / "out")) == files
    assert "no consensus: the group has 0 correspondences" in err


def test_group_of_a_cloud_says_what_to_call(pair: tuple[Path, Path], tmp_path: Path, capsys: Capture) -> None:
    np.savetxt(tmp_path / "cloud.xyz", np.ones((9, 3)))
    err = fail(capsys, "group", pair[0])
    assert "source.ply: is a cloud, not matches; use register to place one cloud on another" in err
    assert "has 3 columns" in fail(capsys, "group", "cloud.xyz")
    assert "no such file" in fail(capsys, "group", "missing.ply")


def test_group_takes_lengths(folder: Path, tmp_path: Path, capsys: Capture) -> None:
    line = ("group", folder / "matches.txt", "--method", "gc")
    err = fail(capsys, *line)
    assert "resolution" in err
    assert "tolerance" in err
    for option in ("--resolution", "--tolerance"):
        succeed(capsys, *line, option, "0.01", "--out", "here")
        assert np.loadtxt(tmp_path / "here/matches_gc_mask.txt").sum() >= 40
    estimated = json.loads(succeed(capsys, *line, "--tolerance", "auto", "--json"))
    matches = read_correspondences(folder / "matches.txt")
    assert estimated["results"]["indices"] == group(matches, "gc", tolerance="auto").indices.tolist()
    assert estimated["options"]["tolerance"] == "auto"


def test_detect(pair: tuple[Path, Path], tmp_path: Path, capsys: Capture) -> None:
    options = ("--detector", "iss", "--keypoints", 100, "--out", "kp")
    out = succeed(capsys, "detect", pair[0], *options)
    with np.load(tmp_path / "kp/keypoints.npz") as file:
        found = dict(file)
    assert np.array_equal(found["points"], read_cloud(pair[0]).points[found["indices"]])
    assert 80 <= len(found["indices"]) <= 120
    assert f"keypoints   {len(found['indices'])} by ISS" in out
    colors = read_cloud(tmp_path / "kp/keypoints.ply").colors
    assert colors is not None
    assert np.array_equal(np.flatnonzero(colors[:, 0] != colors[:, 1]), found["indices"])
    assert is_picture(tmp_path / "kp/keypoints.png")


def test_describe(pair: tuple[Path, Path], tmp_path: Path, capsys: Capture) -> None:
    options = ("--descriptor", "rcs", "--nms-radius", 4, "--out", "kp")
    out = succeed(capsys, "describe", pair[0], *options)
    written = read_descriptors(tmp_path / "kp/descriptors.npz")
    expected = describe(read_cloud(pair[0]), descriptor="rcs", nms_radius=4)
    for name in ("indices", "points", "lrf", "descriptors", "centroid"):
        assert np.array_equal(getattr(written, name), getattr(expected, name))
    assert written.resolution == expected.resolution
    assert "RCS, 72 numbers each" in out


def test_recognize(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    monkeypatch.chdir(folder)  # lines of long paths would be broken
    models = [f"stone{seed}.ply" for seed in (1, 2, 3)]
    options = ("--scene", "scene.ply", "--viewpoint", 0, 0, 0, "--out", "found", "--html")
    out = succeed(capsys, "recognize", *models, *options)
    lines = out.splitlines()
    assert lines[1].split("  ")[0] == "model"
    rows = [re.split(r"  +", line) for line in lines[2:6]]
    assert [row[:2] for row in rows] == [
        ["stone1", "1 of 2"],
        ["stone1", "2 of 2"],
        ["stone2", "yes"],
        ["stone3", "no"],
    ]
    assert all(float(row[2]) > 0.9 and 0 < float(row[3]) <= 100 for row in rows[:3])
    names = results_in(folder / "found")
    found = ("stone1_in_scene-2", "stone1_in_scene", "stone2_in_scene")
    assert names == [
        "models_in_scene.html",
        *(name + suffix for name in found for suffix in (".ply", ".txt")),
    ]
    page = (folder / "found" / names[0]).read_text(encoding="utf-8")
    assert page.count("data-near=") == page.count("data-copy=") == 3
    assert all(name in out for name in names)
    pose = read_transform(folder / "found" / "stone2_in_scene.txt")
    points = stone_model(2).points
    middle = pose[:3, :3] @ (points.min(axis=0) + points.max(axis=0)) / 2 + pose[:3, 3]
    place = re.search(r"stone2_in_scene +middle at \((.+), (.+), (.+)\), rotated by", out)
    assert place is not None
    np.testing.assert_allclose([float(number) for number in place.groups()], middle, rtol=0.01, atol=0.5)
    posed = read_cloud(folder / "found" / "stone2_in_scene.ply")
    np.testing.assert_allclose(posed.points, stone_model(2).transformed(pose).points, rtol=1e-4, atol=1e-2)


def test_recognize_finds_nothing(folder: Path, tmp_path: Path, capsys: Capture) -> None:
    status, out, err = run(capsys, "recognize", folder / "stone3.ply", "--scene", folder / "scene.ply")
    assert status == 3
    assert "no" in out
    says = "cgroup: no model was found in scene.ply; for single scans, give"
    assert err.startswith(says)
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_benchmark_run_and_status(tmp_path: Path, capsys: Capture) -> None:
    config = tmp_path / "own.toml"
    config.write_text(CLOUDS.replace('["a", "b"]', '["a", "broken"]'))
    out = succeed(capsys, "benchmark", "run", config, "--workers", 1)
    assert "groupings      4 of 8, 4 failed" in out
    assert "4 of 8 failed; see: cgroup benchmark status" in out
    out = succeed(capsys, "benchmark", "status")
    assert "failed     2 x gc: OSError: this pair is broken" in out
    out = succeed(capsys, "benchmark", "status", "--json")
    results = json.loads(out)["results"]
    assert results["counts"]["experiment"] == {"done": 4, "failed": 4, "wanted": 8}
    assert "smoke" in succeed(capsys, "benchmark", "presets")
    failure = {"error": "OSError: this pair is broken", "times": 2}
    assert results["failures"] == [{"method": method, **failure} for method in ("gc", "ss")]


# --- wrong input ---------------------------------------------------------------------------------

WRONG = [
    ("register missing.ply {target}", "missing.ply: no such file"),
    ("register {source} {target} --descriptor fpfh3", "cgroup: Invalid value for '--descriptor': 'fpfh3' is"),
    ("register {source} {target} {scene}", "got 3 clouds, and registers two; cgroup merge registers many into one scene"),
    ("register {source} {target} --normals mesh", "--normals: belongs to --front paper"),
    ("register {source} {target} --front paper --support 4", "--support: belongs to --front dense"),
    ("register {source} {target} --out {source}", "can't be made a folder"),
    ("register {source} {target} --out=", "--out: got an empty name; give a folder; . is the current one"),
    ("register {source} {target} --matches {folder}/matches.npz --front paper", "--matches, --front: give one"),
    ("register {source} {target} --matches {folder}/matches.npz --support 4", "--matches, --support: give one"),
    ("assess {source} {target} {folder}/scaled.txt", "scale the source by that first, and divide the block"),
    ("register {source} {target} --initial {folder}/truth.txt --matches {folder}/matches.npz", "--matches, --initial: give one"),
    ("register {source} {target} --initial {folder}/truth.txt --method gtm", "nothing is grouped where --initial is given"),
    ("register {source} {target} --scale 1 2 --front paper", "leave out --front"),
    ("register {source} {target} --radius 5", "--radius: got 5, but no --initial"),
    ("register {source} {target} --angle 5", "--angle: got 5, but no --initial"),
    ("compare {source} {target}", "--truth"),
    ("group {folder}/matches.npz --tolerance automatic", "--tolerance: got automatic; give a length, or auto"),
    ("recognize {stone} {folder}/again/stone1.ply --scene {scene}", "two files whose results would be named stone1_in_scene"),
    ("benchmark run nowhere.toml", "nowhere.toml: neither a readable configuration"),
    ("benchmark status --out nowhere", "nowhere: no records; make some"),
    ("frobnicate", "frobnicate"),
]  # fmt: skip


@pytest.mark.parametrize(("line", "says"), WRONG, ids=[line for line, _ in WRONG])
def test_wrong_input_is_one_line_and_status_2(line: str, says: str, folder: Path, capsys: Capture) -> None:
    names = {"source": "source", "target": "target", "stone": "stone1", "scene": "scene"}
    files = {name: folder / f"{stem}.ply" for name, stem in names.items()}
    assert says in fail(capsys, *(word.format(folder=folder, **files) for word in line.split()))


def test_without_a_command_there_is_help(capsys: Capture) -> None:
    for words, command in (((), "register"), (("benchmark",), "presets")):
        assert f"\n  {command} " in succeed(capsys, *words)
