"""``cgroup evaluate``: recalls against scripts as papers have them, files there and back, and wrong input."""

import csv
import itertools
import json
from dataclasses import fields, replace

import numpy as np
import pytest
from command_lines import fail, succeed
from hypothesis import given, settings
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from scipy import stats
from shared_data import data_folder

from benchmark_runs import serial
from cgroup.benchmark import tables
from cgroup.benchmark.report.page import write_poses
from cgroup.datasets.generated.stones import random_pose
from cgroup.errors import InputError
from cgroup.evaluation.recall_protocols import (
    Recall,
    compare_results,
    mcnemar,
    protocol_names,
    read_protocol,
    score_poses,
)
from cgroup.evaluation.result_files import PairErrors, PairPoses, read_results, read_truth
from cgroup.io import write_file
from cgroup.io.transforms import format_log
from cgroup.pose_graph.files import motion_lines
from cgroup.rigid import invert
from cgroup.rigid.transforms import turn
from cgroup.scenes import PoseGraph
from reference.redwood import redwood_error

BENCHMARKS = {"3DMatch": (1623, 1279), "3DLoMatch": (1781, 1726)}
SCENES = ("hall", "kitchen", "7-scenes-redkitchen")


def poses_of(rng, count):
    return np.array([random_pose(rng) for _ in range(count)]).reshape(-1, 4, 4)


def jolted(rng, poses, degrees, shift):
    """Return poses with errors of so many degrees, exponentially distributed, and so much per axis."""
    axes = rng.normal(size=(len(poses), 3))
    halves = np.radians(rng.exponential(degrees, len(poses))) / 2
    parts = np.sin(halves) * (axes / np.linalg.norm(axes, axis=1)[:, None]).T
    errors = np.tile(np.eye(4), (len(poses), 1, 1))
    errors[:, :3, :3] = turn(*parts, np.cos(halves))
    errors[:, :3, 3] = shift * rng.normal(size=(len(poses), 3))
    return poses @ errors


def write_results(path, results):
    """Write poses of pairs as users do: by a table, by `numpy.savez`, or as logs in a folder."""
    scenes, *numbers = map(np.array, zip(*results.keys, strict=True))
    if path.suffix == ".csv":
        # Column by column, as the order of columns does not matter.
        rows = [["scene", "target", "source", *(f"t{i}{j}" for j in range(4) for i in range(3))]]
        columns = results.poses[:, :3].transpose(0, 2, 1).reshape(-1, 12)
        for key, pose in zip(results.keys, columns.tolist(), strict=True):
            rows.append([*key, *([""] * 12 if np.isnan(pose).any() else map(repr, pose))])
        with path.open("w", newline="") as file:
            csv.writer(file).writerows(rows)
    elif path.suffix == ".npz":
        np.savez(path, scenes=scenes, pairs=np.column_stack(numbers), poses=results.poses)
    else:
        for scene in {key[0] for key in results.keys}:
            rows = [row for row, key in enumerate(results.keys) if key[0] == scene]
            rows = [row for row in rows if np.isfinite(results.poses[row]).all()]
            if not rows:
                continue
            (path / scene).mkdir(parents=True)
            text = format_log(np.array([results.keys[row][1:] for row in rows]), results.poses[rows])
            (path / scene / "est.log").write_text(text)


def made_truth(rng, information=True):
    """Three scenes of five clouds each, all pairs."""
    keys, poses = [], []
    for scene in SCENES:
        clouds = poses_of(rng, 5)
        for i, j in itertools.combinations(range(5), 2):
            keys.append((scene, i, j))
            poses.append(invert(clouds[i]) @ clouds[j])
    matrices = np.tile(np.diag([5e3] * 3 + [2e4] * 3), (len(keys), 1, 1))
    matrices = matrices if information else np.full_like(matrices, np.nan)
    return PairPoses("truth", keys, np.array(poses), matrices, rng.uniform(0.1, 1, len(keys)))


def benchmark(name):
    return data_folder("published") / "published" / "benchmarks" / name


def recalls_of_scripts(truth, poses):
    """RMSE by scene and by pair, and 15 degrees and 0.3 m by pair, as loops over pairs."""
    right, within_limits = {}, []
    for (scene, i, j), true, pose, matrix in zip(
        truth.keys, truth.poses, poses, truth.information, strict=True
    ):
        known = not np.isnan(pose).any()
        if j - i > 1:
            error = redwood_error(pose, true, matrix) if known else np.inf
            right.setdefault(scene, []).append(error <= 0.2**2)
        cosine = np.clip((np.trace(pose[:3, :3].T @ true[:3, :3]) - 1) / 2, -1, 1)
        near = np.linalg.norm(pose[:3, 3] - true[:3, 3]) < 0.3
        within_limits.append(known and np.degrees(np.arccos(cosine)) < 15 and near)
    flat = [one for each in right.values() for one in each]
    return np.mean([np.mean(each) for each in right.values()]), np.mean(flat), np.mean(within_limits)


# --- benchmarks ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BENCHMARKS)
def test_recalls_of_made_up_results_are_those_of_the_scripts(name, tmp_path, capsys):
    truth, rng = read_truth(benchmark(name)), np.random.default_rng(0)
    count, apart = BENCHMARKS[name]
    assert len(truth.keys) == count
    noisy = jolted(rng, truth.poses, 8, 0.1)
    noisy[rng.random(count) < 0.1] = np.nan
    order = rng.permutation(count)
    half = np.where((np.arange(count) % 2 == 0)[:, None, None], truth.poses, np.nan)
    results = {
        "perfect": (truth.keys, truth.poses, truth.poses),
        "noisy": (truth.keys, noisy, noisy),
        "shuffled": ([truth.keys[row] for row in order], noisy[order], noisy),
        "turned": ([(s, j, i) for s, i, j in truth.keys], np.linalg.inv(noisy), noisy),
        "half": (truth.keys[::2], truth.poses[::2], half),
    }
    for label, (keys, poses, _) in results.items():
        write_results(tmp_path / f"{label}.csv", PairPoses(label, keys, poses))
    write_results(tmp_path / "logs", PairPoses("logs", truth.keys, noisy))
    files = [*(tmp_path / f"{label}.csv" for label in results), tmp_path / "logs"]
    asked = ("--protocol", name.lower(), "--truth", benchmark(name), "--json")
    document = json.loads(succeed(capsys, "evaluate", *files, *asked))
    found = {one["name"]: one for one in document["results"]["methods"]}
    for label, (_, _, poses) in results.items():
        expected = recalls_of_scripts(truth, poses)
        assert [one["recall"] for one in found[label]["recalls"][:3]] == pytest.approx(expected, abs=1e-12)
    assert found["logs"]["recalls"] == found["noisy"]["recalls"]
    assert found["logs"]["missing"] == found["noisy"]["refused"] > 0
    assert found["half"]["missing"] == sum(j - i > 1 for _, i, j in truth.keys[1::2])
    assert found["perfect"]["right"] == apart
    floor = {"3DMatch": 0.18, "3DLoMatch": 0.14}[name]  # of angles by the trace, as `left_open` tells
    assert found["perfect"]["recalls"][0]["rotation_deg"] == pytest.approx(floor, abs=0.005)
    inverses = tmp_path / "inverses.npz"
    write_results(inverses, PairPoses("", truth.keys, np.linalg.inv(noisy)))
    message = fail(capsys, "evaluate", inverses, *asked[:-1])
    assert "of their inverses: they map the target into the source's frame; give --inverse" in message
    turned = json.loads(succeed(capsys, "evaluate", inverses, "--inverse", *asked))
    recalls = [one["recall"] for one in turned["results"]["methods"][0]["recalls"][:3]]
    assert recalls == pytest.approx(recalls_of_scripts(truth, noisy), abs=1e-12)


def test_arrays_of_dgr_have_the_digits_of_its_own_script(capsys):
    path = data_folder("published") / "published" / "dgr_3dmatch_per_pair_results.npz"
    document = json.loads(succeed(capsys, "evaluate", path, "--protocol", "3dmatch", "--json"))
    methods = {one["name"]: one["recalls"] for one in document["results"]["methods"]}
    assert all(by[0] is None for by in methods.values())  # the numbers of the clouds are lost
    with np.load(path) as arrays:
        for name, rows in zip(arrays["names"], arrays["stats"], strict=True):
            valid = (rows[:, 1] < 0.3) & (rows[:, 2] < 15)
            by_pair = [valid.mean(), rows[valid, 1].mean(), rows[valid, 2].mean()]
            found = methods[str(name)][2]
            assert [found["recall"], found["translation"], found["rotation_deg"]] == pytest.approx(by_pair)
            by_scene = np.mean([valid[rows[:, 4] == scene].mean() for scene in range(8)])
            assert methods[str(name)][3]["recall"] == pytest.approx(by_scene)


# --- files --------------------------------------------------------------------------------------------------


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), refused=st.floats(0, 0.9))
def test_results_come_back_bit_for_bit(tmp_path_factory, seed, refused):
    rng = np.random.default_rng(seed)
    truth = made_truth(rng)
    poses = np.where((rng.random(len(truth.keys)) < refused)[:, None, None], np.nan, truth.poses)
    results = PairPoses("made", truth.keys, poses)
    folder = tmp_path_factory.mktemp("there")
    for name in ("results.csv", "results.npz", "logs"):
        write_results(folder / name, results)
        if name == "logs" and np.isnan(poses).all():
            continue
        (back,) = read_results(folder / name, truth)
        kept = dict(zip(back.keys, back.poses, strict=True))
        for key, pose in zip(truth.keys, poses, strict=True):
            assert (
                np.array_equal(kept[key], pose)
                if not np.isnan(pose).any()
                else np.isnan(kept.get(key, pose)).all()
            )


def test_trajectories_and_graphs_give_the_pairs_of_the_truth(tmp_path):
    rng = np.random.default_rng(0)
    clouds = poses_of(rng, 5)
    pairs = list(itertools.combinations(range(5), 2))
    relative = np.array([invert(clouds[i]) @ clouds[j] for i, j in pairs])
    truth = made_truth(rng)
    truth = PairPoses(
        "t", [("hall", i, j) for i, j in pairs], relative, truth.information[:10], truth.overlap[:10]
    )
    lines = motion_lines(clouds)
    files = {
        "poses.tum": "# times\n" + "".join(f"{row} {lines[row]}\n" for row in (3, 0, 1, 4, 2)),
        "poses.kitti": "".join(" ".join(map(repr, pose[:3].ravel().tolist())) + "\n" for pose in clouds),
        "poses.log": format_log(np.repeat(np.arange(5), 2).reshape(-1, 2), clouds),
        "poses.csv": "target,source,tx,ty,tz,qx,qy,qz,qw\n"
        + "".join(
            f"{i},{j},{line.replace(' ', ',')}\n"
            for (i, j), line in zip(pairs, motion_lines(relative), strict=True)
        ),
    }
    for name, text in files.items():
        write_file(tmp_path / name, text.encode())
    edges, weights = np.array(pairs), np.tile(np.eye(6), (10, 1, 1))
    PoseGraph(clouds, edges, relative, weights).write(tmp_path / "graph.g2o")
    lonely = [line for line in (tmp_path / "graph.g2o").read_text().splitlines() if "VERTEX" not in line]
    write_file(tmp_path / "edges.g2o", "\n".join(lonely).encode())
    for number, (i, j) in enumerate(pairs):
        (tmp_path / "each").mkdir(exist_ok=True)
        np.savez(tmp_path / "each" / f"{i}_{j}.npz", estimated_transform=relative[number].astype(np.float32))
    for name in (*files, "graph.g2o", "edges.g2o", "each"):
        (found,) = read_results(tmp_path / name, truth)
        scored = score_poses(truth, found)
        assert not scored.missing.any(), name
        assert scored.translation.max() < (1e-3 if name == "each" else 1e-8), name
        assert scored.rotation.max() < (0.1 if name == "each" else 1e-5), name  # by the cosine
    (alone,) = read_results(tmp_path / "poses.tum")
    assert sorted(pair[1:] for pair in alone.keys) == pairs


def test_documents_of_register_and_merge(tmp_path):
    pose = random_pose(np.random.default_rng(1))
    inputs = [{"file": "scans/cloud_bin_7.ply"}, {"file": "scans/cloud_bin_4.ply"}]
    registered = {
        "command": "register",
        "inputs": inputs,
        "results": {"ok": True, "T_target_source": pose.tolist()},
    }
    refused = {"command": "register", "error": {"kind": "NoConsensusError"}}
    scans = [("scan4.ply", 0, np.eye(4).tolist()), ("scan7.ply", 0, pose.tolist()), ("scan9.ply", None, None)]
    placed = [dict(zip(("name", "component", "T_component_scan"), scan, strict=True)) for scan in scans]
    merged = {"command": "merge", "results": {"scans": placed}}
    keys = [("hall", 4, 7), ("hall", 4, 9)]
    nothing = np.full((2, 6, 6), np.nan)
    truth = PairPoses("truth", keys, np.array([pose, pose]), nothing, nothing[:, 0, 0])
    folder = tmp_path / "documents"
    folder.mkdir()
    (folder / "a.json").write_text(json.dumps(registered))
    (folder / "cloud_bin_9_on_cloud_bin_4.json").write_text(json.dumps(refused))
    (tmp_path / "merged.json").write_text(json.dumps(merged))
    for name in ("documents", "merged.json"):
        (found,) = read_results(tmp_path / name, truth)
        scored = score_poses(truth, found)
        assert scored.rotation == pytest.approx([0, np.inf], abs=1e-5)
        assert scored.refused.tolist() == [False, True]
        assert not scored.missing.any()
    compared = registered | {"command": "compare"}  # its pose is the true one
    lost = registered | {"results": {"ok": True, "T_target_source": None}}
    flat = {"command": "merge", "results": {"scans": [placed[0] | {"T_component_scan": [[1, 0]]}]}}
    for other in ({"command": "group"}, compared, lost, flat, [], 5):
        (tmp_path / "other.json").write_text(json.dumps(other))
        with pytest.raises(
            InputError, match="other.json: not a result of cgroup; give what register or merge"
        ):
            read_results(tmp_path / "other.json", truth)
    (folder / "a.json").write_text(
        json.dumps(registered | {"results": registered["results"] | {"ok": False}})
    )
    (found,) = read_results(folder, truth)
    assert score_poses(truth, found).refused.all()


# --- the command --------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path):
    rng = np.random.default_rng(0)
    truth = made_truth(rng)
    for (scene, *pair), pose, matrix, share in zip(
        truth.keys, truth.poses, truth.information, truth.overlap, strict=True
    ):
        home = tmp_path / "truth" / scene
        home.mkdir(parents=True, exist_ok=True)
        name = f"{pair[0]} {pair[1]} 5\n"
        for file, rows in (("gt.log", pose), ("gt.info", matrix)):
            with (home / file).open("a") as stream:
                stream.write(name + "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist()))
        with (home / "gt_overlap.log").open("a") as stream:
            stream.write(f"{pair[0]},{pair[1]},{share}\n")
    noisy = jolted(rng, truth.poses, 10, 0.1)
    noisy[3] = np.nan
    write_results(tmp_path / "ours.csv", PairPoses("ours", truth.keys, noisy))
    write_results(tmp_path / "theirs", PairPoses("theirs", truth.keys[:-4], truth.poses[:-4]))
    return tmp_path


def asked(folder, *results):
    files = [folder / name for name in results or ("ours.csv", "theirs")]
    return ["evaluate", *files, "--protocol", "3dmatch", "--truth", folder / "truth"]


def test_the_text_has_every_table(folder, capsys):
    text = succeed(capsys, *asked(folder), "--curve", "--wide")
    assert "3DMatch: 30 pairs of 3 scenes; recalls in % with Wilson's intervals of 95 %" in text
    for part in (
        "RMSE, by pair",
        "15deg 0.3m, by scene",
        "refused",
        "7-scenes-redkitchen",
        "0.3 to 0.5",
        "limits x",
    ):
        assert part in text
    assert "note        3DMatch has 1623 pairs, the truth has 30" in text
    assert "left open   Which recall" in text
    (counts,) = [line.split() for line in text.splitlines() if line.startswith("theirs ") and "[" not in line]
    assert counts[1:5] == ["16", "0", "0", "2"]


def test_names_of_files_are_text_in_every_table(folder, capsys):
    name = "[l](javascript:x)<script>^~\n\x1b[2J*|`&_%.csv"
    (folder / name).write_bytes((folder / "ours.csv").read_bytes())
    rows = succeed(capsys, *asked(folder, name), "--markdown").splitlines()
    assert len(rows) == 3
    shown = r"\[l\](javascript:x)\<script\>^\~\\n\\x1b\[2J\*\|\`\&\_%"
    assert rows[2].startswith(f"| {shown} | ")
    html = MarkdownIt().enable("table").render("\n".join(rows))
    assert "<script" not in html
    assert "href" not in html
    assert html.count("<td") == 7
    latex = succeed(capsys, *asked(folder, name), "--latex").splitlines()
    assert latex[0] == r"\begin{tabular}{lrrrrrr}"
    assert latex[2].startswith("result & RMSE & ")
    assert latex[4].startswith(
        r"{[}l](javascript:x)\textless{}script\textgreater{}\textasciicircum{}\textasciitilde{}"
        r"\textbackslash{}n\textbackslash{}x1b{[}2J{*}\textbar{}`\&\_\% & "
    )
    for text in (*rows, *latex, succeed(capsys, *asked(folder, name), "--curve", "--wide")):
        assert "\x1b" not in text


def test_the_worst_poses_are_listed(folder, capsys):
    ours, theirs = json.loads(succeed(capsys, *asked(folder), "--json"))["results"]["methods"]
    assert len(ours["worst"]) == min(20, ours["wrong"]) > 0
    assert theirs["worst"] == []
    factors = [one["factor"] for one in ours["worst"]]
    assert factors == sorted(factors, reverse=True)
    assert min(factors) > 1
    for one in ours["worst"]:
        assert one["factor"] == pytest.approx(one["rmse"] / 0.2)


def test_own_protocols(folder, capsys):
    (folder / "own.toml").write_text(
        'title = "Mine"\n[[recall]]\nname = "tight"\nmax_rotation = 5\nmax_translation = 0.2\n'
    )
    command = [*asked(folder)[:3], "--protocol", folder / "own.toml", "--truth", folder / "truth"]
    assert "By tight:" in succeed(capsys, *command)
    wrong = {
        "title = ": "not a protocol",
        'title = "x"': r"\[\[recall\]\]: got none; give one or more",
        'title = "x"\n[[recall]]\nname = "a"': "recall: got no limit; give max_rotation",
        'title = "x"\n[[recall]]\nname = "a"\nmax_rmse = -1': "max_rmse: got -1",
        'title = "x"\n[[recall]]\nname = "a"\nmax_rmse = 1\naverage = "all"': "average: got 'all'; choose one of",
        'title = "x"\n[[recall]]\nname = "a"\nmax_rms = 1': "unexpected keyword argument 'max_rms'",
        '[[recall]]\nname = "a"\nmax_rmse = 1': "title",
        'title = "x"\nleft_open = 3\n[[recall]]\nname = "a"\nmax_rmse = 1': "not a protocol",
        'title = "x"\n[[recall]]\nname = 5\nmax_rmse = 1': "give a str",
    }
    for text, message in wrong.items():
        (folder / "own.toml").write_text(text)
        with pytest.raises(InputError, match=message):
            read_protocol(str(folder / "own.toml"))


def test_protocols_of_the_package_are_whole():
    assert read_protocol("3DMatch") == read_protocol("3dmatch")
    with pytest.raises(InputError, match="did you mean '3dmatch'"):
        read_protocol("3DMtch")
    assert protocol_names() == ["3dlomatch", "3dmatch", "eth", "kitti", "scannet"]
    for name in protocol_names():
        protocol = read_protocol(name)
        assert protocol.citation
        assert protocol.left_open
        assert all(one.source for one in protocol.recalls)
        assert all(one.describe() for one in protocol.recalls)


HEAD = "scene,target,source,tx,ty,tz,qx,qy,qz,qw\n"
WRONG_FILES = {
    "empty.csv": ("", "the file is empty"),
    "head.csv": (HEAD, "holds no poses of pairs"),
    "other.csv": ("a,b\n1,2\n", "not a table of poses; its first line has to name scene, target, source"),
    "words.csv": (HEAD + "hall,0,x,0,0,0,0,0,0,1\n", "line 2 isn't a pair and the numbers of its pose"),
    "short.csv": (HEAD + "hall,0,1,0,0\n", "line 2 isn't a pair"),
    "long.csv": (HEAD + "hall,0,1,0,0,0,0,0,0,2\n", "quaternion is of length 2"),
    "wide.csv": (HEAD + "\nhall,0,1,0,0,0,0,0,0,1,0\n", "line 3 has more cells than the first; quote"),
    "twice.csv": (HEAD + "hall,0,1,0,0,0,0,0,0,1\n" * 2, "pair hall/0-1 is there twice"),
    "back.csv": (HEAD + "hall,0,1,0,0,0,0,0,0,1\nhall,1,0,9,0,0,0,0,0,1\n", "pair hall/1-0 is there twice"),
    "hall.tum": ("1 0 0 0 0 0 0 1\n" * 2, "cloud 1 is there twice"),
    "unknown.csv": (HEAD + "cellar,0,1,0,0,0,0,0,0,1\n", "none of its pairs, such as cellar/0-1, is in the truth"),
    "cut.log": ("0 1 5\n1 0 0 0\n", "not a list of poses; 5 lines each"),
    "hall.log": ("0 1 5\n" + "2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n", "scaled by 2, not a rotation"),
    "nowhere.log": ("0 1 5\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "none of its pairs, such as nowhere/0-1, is in the truth"),
    "cut.npz": ("PK", "not a readable NPZ file"),
    "cut.json": ("{", "not a readable JSON file"),
    "cut.g2o": ("EDGE_SE3:QUAT 0 1", "needs 30 finite numbers"),
    "cut.tum": ("0 0 0\n", "a pose is 4 rows of 4 numbers"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG_FILES)
def test_wrong_files_are_one_sentence(folder, capsys, name):
    text, message = WRONG_FILES[name]
    (folder / name).write_text(text)
    said = fail(capsys, *asked(folder, name))
    assert message in said
    assert len(said.strip().splitlines()) == 1


def test_wrong_folders_and_options_are_one_sentence(folder, capsys):
    (folder / "bare").mkdir()
    assert "bare: holds no poses of pairs of 7-scenes-redkitchen, hall" in fail(
        capsys, *asked(folder, "bare")
    )
    assert "no such file" in fail(capsys, *asked(folder, "nowhere.csv"))
    ours = folder / "ours.csv"
    assert "choose one of 3dlomatch, 3dmatch, eth" in fail(capsys, "evaluate", ours, "--protocol", "4dmatch")
    assert "--truth: is needed" in fail(capsys, "evaluate", ours, "--protocol", "3dmatch")
    assert "not a truth" in fail(capsys, "evaluate", ours, "--protocol", "3dmatch", "--truth", ours)
    for name in ("a", "b"):
        (folder / "bare" / f"{name}.csv").write_bytes(ours.read_bytes())
    assert "b.csv: pair hall/0-1 is there twice, first in" in fail(capsys, *asked(folder, "bare"))
    (folder / "truth" / "hall" / "gt_overlap.log").write_text("0,1\n")
    assert "gt_overlap.log: not a readable LOG file" in fail(capsys, *asked(folder))


def test_results_beside_the_truth_are_not_taken_for_it(folder, capsys):
    for name in ("ransac.log", "est.log"):
        moved = np.eye(4)[None] + np.eye(4, k=3)
        (folder / "truth" / "hall" / name).write_text(format_log(np.array([[0, 2]]), moved))
        document = json.loads(succeed(capsys, *asked(folder, "truth"), "--json"))
        (found,) = document["results"]["methods"]
        assert (found["right"], found["wrong"]) == (0, 1)
        assert document["results"]["pairs"] == 30


def test_other_scenes_are_left_out_of_a_truth_of_one(folder, capsys):
    alone = [*asked(folder, "theirs")[:-1], folder / "truth" / "hall"]
    text = " ".join(succeed(capsys, *alone).split())
    assert "theirs: 16 pairs are not in the truth, such as 7-scenes-redkitchen/0-1: left out" in text


def test_pairs_count_by_the_difference_of_their_numbers():
    keys = [("hall", 0, 1), ("hall", 3, 0), ("hall", 1, 0), ("hall", 1, 4)]
    rmse, no = np.array([np.nan, 0, np.nan, 0]), np.zeros(4, dtype=bool)
    found = PairErrors("made", keys, np.zeros(4), np.zeros(4), rmse, no, no, np.zeros(4))
    apart = read_protocol("3dmatch").recalls[1]
    assert apart.counted(found).tolist() == [False, True, False, True]
    assert apart.is_known(found)
    assert not apart.is_known(replace(found, rmse=rmse[::-1]))
    (predators,) = (one for one in read_protocol("3dlomatch").recalls if not one.first)
    found = replace(found, keys=[*keys[:2], ("kitchen", 0, 2), ("kitchen", 0, 3)], rmse=np.zeros(4))
    assert predators.counted(found).tolist() == [False, True, False, True]


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        *(
            ({"pairs": [[0, number]], "poses": np.eye(4)[None]}, "give whole numbers")
            for number in (np.inf, np.nan, 1e300, -1.0, 1.5, np.uint64(2**63))
        ),
        ({"pairs": [[0, 1]], "poses": np.eye(4)[None, :3]}, "poses (1, 3, 4)"),
        ({"pairs": 1, "poses": 1}, "give whole numbers"),
        ({"pairs": [[0, 1]], "poses": np.eye(4)[None], "scenes": [7]}, "none of its pairs, such as 7/0-1"),
        ({"names": ["a"], "stats": np.full((1, 3, 5), np.nan)}, "DGR's is"),
    ],
)
def test_wrong_arrays_are_one_sentence(folder, capsys, arrays, message):
    np.savez(folder / "wrong.npz", **arrays)
    assert message in fail(capsys, *asked(folder, "wrong.npz"))


def test_times_tell_clouds_of_two_trajectories(tmp_path):
    clouds = poses_of(np.random.default_rng(0), 4)
    lines = [f"{1305031102.175304 + 0.1 * row:.6f} {line}\n" for row, line in enumerate(motion_lines(clouds))]
    (tmp_path / "truth.tum").write_text("".join(lines))
    (tmp_path / "found.tum").write_text("".join(lines[1:]))  # a cloud is lost
    truth = read_truth(tmp_path / "truth.tum")
    (found,) = read_results(tmp_path / "found.tum", truth)
    scored = score_poses(truth, found)
    assert scored.missing.sum() == 3
    assert scored.translation[~scored.missing].max() < 1e-9
    (tmp_path / "long.kitti").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 1001)
    with pytest.raises(InputError, match="more than 1000 clouds; list the pairs that count"):
        read_truth(tmp_path / "long.kitti")


def test_results_of_other_scenes_stand_apart(folder, capsys):
    names, stats = np.array(["a", "b"]), np.zeros((2, 30, 5))
    stats[1, :, 1:3] = 9
    np.savez(folder / "dgr.npz", names=names, stats=stats)
    rows = succeed(capsys, *asked(folder, "ours.csv", "dgr.npz"), "--wide").splitlines()
    told = {row.split()[0]: row.split()[1:] for row in rows[::-1] if row.startswith(("0 ", "hall "))}
    assert told["0"] == ["-", "100.0", "0.0"]
    assert told["hall"][1:] == ["-", "-"]
    np.savez(folder / "dgr.npz", names=names, stats=stats[:, :7])
    assert "RESULT: of 7 and 30 pairs" in fail(capsys, *asked(folder, "ours.csv", "dgr.npz"))


def test_results_are_tested_on_the_same_pairs_in_any_order(folder, tmp_path, capsys):
    truth, rng = made_truth(np.random.default_rng(0)), np.random.default_rng(1)
    recall = read_protocol("3dmatch").recalls[0]
    found = {
        name: score_poses(truth, replace(truth, poses=jolted(rng, truth.poses, 10, 0.1))) for name in "ab"
    }
    order = rng.permutation(len(truth.keys))
    keys = [truth.keys[row] for row in order]
    arrays = [getattr(found["b"], one.name)[order] for one in fields(PairErrors)[2:8]]
    (told,), (shuffled,) = (
        compare_results({"a": found["a"], "b": other}, recall)
        for other in (found["b"], PairErrors("b", keys, *arrays))
    )
    assert shuffled == told
    assert told["only_one"] + told["only_other"] > 0
    stats = np.zeros((2, 30, 5))
    stats[:, :, 1] = rng.uniform(0, 0.6, (2, 30))
    stats[:, :, 4] = np.arange(30) // 10
    np.savez(tmp_path / "dgr.npz", names=np.array(["a", "b"]), stats=stats)
    one, other = stats[:, :, 1] < 0.3
    stats[1] = np.roll(stats[1], 10, axis=0)  # scenes in another order
    np.savez(tmp_path / "turned.npz", names=np.array(["a", "b"]), stats=stats)
    for name in ("dgr.npz", "turned.npz"):
        done = json.loads(succeed(capsys, *asked(folder, "ours.csv", tmp_path / name), "--json"))["results"]
        (test,) = done["tests"]
        assert (test["only_one"], test["only_other"]) == ((one & ~other).sum(), (other & ~one).sum())
        assert done["notes"][-1] == "not tested, because their pairs differ: ours and a, ours and b"


def test_without_information_the_first_recall_that_is_known_leads(folder, capsys):
    for file in (folder / "truth").rglob("gt.info"):
        file.unlink()
    text = succeed(capsys, *asked(folder))
    assert "By 15deg 0.3m:" in text
    (folder / "own.toml").write_text('title = "x"\n[[recall]]\nname = "a"\nmax_rmse = 1')
    command = [*asked(folder)[:3], "--protocol", folder / "own.toml", "--truth", folder / "truth"]
    assert "no recall is known for all results; RMSE needs gt.info" in fail(capsys, *command)


@given(st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), min_size=1, max_size=6))
def test_intervals_are_wilsons_and_those_of_means_combined(counts):
    counts = [(right, max(1, right + wrong)) for right, wrong in counts]
    keys = [(f"{scene}", 0, 1) for scene, (_, size) in enumerate(counts) for _ in range(size)]
    errors = np.concatenate([np.arange(size) >= right for right, size in counts]).astype(float)
    no = np.zeros(len(keys), dtype=bool)
    found = PairErrors("made", keys, errors, errors, errors, no, no, errors)
    for average, shares in (("pairs", [tuple(np.sum(counts, axis=0))]), ("scenes", counts)):
        scored = Recall("any", max_rotation=0.5, average=average).score(found)
        each = [stats.binomtest(*map(int, share)).proportion_ci(method="wilson") for share in shares]
        share = np.array([right / size for right, size in shares])
        below, above = share - [one.low for one in each], share - [one.high for one in each]
        expected = share.mean() - np.array([np.hypot.reduce(below), -np.hypot.reduce(above)]) / len(shares)
        assert (scored["low"], scored["high"]) == pytest.approx(tuple(expected), abs=1e-12)
        assert 0 <= scored["low"] <= scored["recall"] <= scored["high"] <= 1
        assert scored["high"] - scored["low"] > 0.01  # at 0 and 100 % too


@given(st.integers(0, 40), st.integers(0, 40))
def test_mcnemar_is_the_binomial_test(one, other):
    first, second = np.arange(one + other) < one, np.arange(one + other) >= one
    expected = stats.binomtest(one, one + other).pvalue if one + other else 1.0
    assert mcnemar(first, second) == pytest.approx(expected, rel=1e-9)


def test_poses_of_the_benchmark_are_results(tmp_path):
    text = """
name = "few"
[trials]
methods = ["lc", "sc2pcr"]
[[trials.sets]]
id = "3DMatch"
dataset = "3dmatch-test"
matches = "nearest, unit length"
voxel = 0.05
loose = "3dmatch"
strict = "3dmatch-strict"
preset = "3dmatch"
pairs = 2
"""
    serial(text, tmp_path, root=data_folder("threedmatch"))
    rows = tables.load(tmp_path, "matches")
    write_poses(tmp_path / "poses", [rows])
    truth = read_truth(tmp_path / "poses/3DMatch/truth")
    for method in ("lc", "sc2pcr"):
        (found,) = read_results(tmp_path / "poses/3DMatch" / method, truth)
        assert isinstance(found, PairPoses)
        by = read_protocol("3dmatch")
        errors = score_poses(truth, found)
        right = next(one for one in by.recalls if one.is_known(errors)).registered(errors)
        own = rows[rows["method"] == method]
        assert sorted(right.tolist()) == sorted(own["right"].tolist())
        np.testing.assert_allclose(sorted(errors.translation), sorted(own["translation_error"]), atol=1e-6)


ZEROS = "0 0 0 0\n" * 4


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.tum", "inf 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n"),
        ("a.tum", "nan 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n"),
        ("a.tum", "1e300 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n"),
        ("a.log", f"0 0 2\n{ZEROS}1 1 2\n{ZEROS}"),
        ("a.log", f"0 1 2\n{ZEROS}"),
        ("a.log", f"{10**400} 1 2\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"),
        ("a.csv", "target,source,tx,ty,tz,qx,qy,qz,qw\n0,1," + "x" * 200_000 + ",2,3,0,0,0,1\n"),
        ("a.csv", f"target,source,tx,ty,tz,qx,qy,qz,qw\n{10**400},1,1,2,3,0,0,0,1\n"),
        ("a.json", "[" * 100_000),
        ("a.json", '{"command": "merge", "results": {"scans": [' + "1" + "0" * 400 + "]}}"),
    ],
)
def test_what_is_no_result_is_refused(tmp_path, name, content):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=name):
        read_truth(tmp_path / name)
