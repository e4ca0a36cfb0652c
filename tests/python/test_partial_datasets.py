"""A data set of which files are missing or broken offers the pairs whose files are there, and names the others."""

from pathlib import Path

import numpy as np
import pytest

from cgroup.datasets import open_dataset
from cgroup.errors import InputError
from cgroup.io import PointCloud, write_cloud

POINTS = np.random.default_rng(0).normal(size=(30, 3))
MATRIX = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
LOG = "0 1 2\n" + MATRIX
INI = '[MODELS]\nMODEL_0 = "/m/{0}/{0}_res.ply"\nMODEL_0_GROUNDTRUTH = "/r/{0}.xf"\n[SCENE]\nPATH = "/r/{0}.ply"\n'
LINE = " ".join(MATRIX.split())
KITTI_POSES = "".join(f"1 0 0 0 0 1 0 0 0 0 1 {6 * step}\n" for step in range(8))

LAYOUTS = {
    "b3r-clean": {
        **{f"b3r/r/ConfigScene{n}.ini": INI.format(f"S{n}") for n in (0, 1)},
        **dict.fromkeys((f"b3r/m/S{n}/S{n}_res.ply" for n in (0, 1)), ""),
        **dict.fromkeys((f"b3r/r/S{n}.xf" for n in (0, 1)), MATRIX),
        **dict.fromkeys((f"b3r/r/S{n}_0.1.ply" for n in (0, 1)), ""),
        "b3r/r/ConfigScene2.ini": INI.format("S2"),
        **dict.fromkeys(("b3r/models/S2.ply", "b3r/scenes/S2_0.1.ply"), ""),
        "b3r/gt/S2.xf": MATRIX,
    },
    "u3or": {
        **dict.fromkeys((f"u3or/gt/{model}-rs{n}.xf" for model in ("chef", "T-rex") for n in (1, 2)), MATRIX),
        **dict.fromkeys(("u3or/models/cheff.ply", "u3or/models/T-rex_high.ply", "u3or/scenes/rs1.ply"), ""),
    },
    "u3m": {
        "u3m/Chef/pairs.txt": f"a.ply b.ply {LINE}\na.ply c.ply {LINE}\n",
        **dict.fromkeys((f"u3m/Chef/{name}.ply" for name in "abc"), ""),
    },
    "stanford": {
        "manifest.json": '{"stanford_views": {"pairs": ['
        '{"set": "bunny", "src": "a.ply", "tgt": "b-2.ply"}, {"set": "bunny", "src": "a.ply", "tgt": "c.ply"}]}}',
        "stanford_views/bunny/bun.conf": "".join(f"bmesh {n}.ply 0 0 0 0 0 0 1\n" for n in ("a", "b-2", "c")),
        **dict.fromkeys((f"stanford_views/bunny/{name}.ply" for name in ("a", "b-2", "c")), ""),
    },
    "3dmatch": {
        "threedmatch/hall-evaluation/gt.log": LOG + LOG.replace("0 1", "0 3", 1),
        **dict.fromkeys((f"threedmatch/hall/cloud_bin_{n}.ply" for n in (0, 1)), ""),
        "threedmatch/hall/cloud_bin_3_2.5cm.npy": "",
    },
    "lidar": {
        **dict.fromkeys((f"lidar/{pair}_{end}.ply" for pair in "ab" for end in ("source", "target")), ""),
        **dict.fromkeys((f"lidar/{pair}_T_target_source.txt" for pair in "ab"), MATRIX),
        "corr/t/8-2.pose": MATRIX,
        **dict.fromkeys(("corr/t/8_v.pcd", "corr/t/2_v.pcd"), ""),
        "corr/matches/1_trans.txt": MATRIX,
    },
    "kitti": {
        "kitti/poses/08.txt": KITTI_POSES,
        "kitti/sequences/08/calib.txt": "Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n",
        **dict.fromkeys((f"kitti/sequences/08/velodyne/{n:06d}.bin" for n in range(8)), ""),
    },
    "fgr": {
        **dict.fromkeys((f"fgr/p{n}/gt.log" for n in (1, 2, 3)), LOG),
        **dict.fromkeys((f"fgr/p{n}/Depth_000{k}.ply" for n in (1, 2, 3) for k in (0, 1)), ""),
        "fgr/p3/fpfh_nn.npz": "",
        **dict.fromkeys((f"fgr/p{n}/features_000{k}.bin" for n in (1, 2) for k in (0, 1)), ""),
    },
    "corr": {
        **dict.fromkeys(("corr/room/corr.txt", "corr/hall/corr.txt"), ""),
        **dict.fromkeys(("corr/room/GTmat.txt", "corr/hall/GTmat.txt", "corr/street/7_trans.txt"), MATRIX),
        **dict.fromkeys((f"corr/street/7_fpfh_kpts_{end}.txt" for end in ("src", "dst")), ""),
    },
    "corr-three": {
        **dict.fromkeys((f"corr/{place}/8-2.pose" for place in "ab"), MATRIX),
        **dict.fromkeys((f"corr/{place}/8_2_top3.match" for place in "ab"), ""),
    },
}
LAYOUTS["b3r"] = LAYOUTS["b3r-clean"]

REMOVED = [
    ("b3r-clean", "b3r/m/S1/S1_res.ply", ["scene1"]),
    ("b3r-clean", "b3r/r/S0.xf", ["scene0"]),
    ("b3r-clean", "b3r/r/S0_0.1.ply", ["scene0"]),
    ("b3r", "b3r/m/S1/S1_res.ply", [f"scene1-noise{noise}" for noise in (0.1, 0.3, 0.5)]),
    ("u3or", "u3or/models/T-rex_high.ply", ["rs1-T-rex", "rs2-T-rex", "rs2-chef"]),
    ("u3m", "u3m/Chef/c.ply", ["Chef/a-c"]),
    ("stanford", "stanford_views/bunny/b-2.ply", ["bunny/a-b-2"]),
    ("3dmatch", "threedmatch/hall/cloud_bin_3_2.5cm.npy", ["3DMatch/hall/0-3"]),
    ("lidar", "lidar/b_target.ply", ["lidar/b"]),
    ("lidar", "corr/t/2_v.pcd", ["corr/t/8-2"]),
    ("kitti", "kitti/sequences/08/velodyne/000003.bin", ["08/2-3"]),
    ("fgr", "fgr/p2/features_0001.bin", ["p2"]),
    ("corr", "corr/hall/GTmat.txt", ["hall"]),
    ("corr", "corr/room/corr.txt", ["room"]),
    ("corr", "corr/street/7_fpfh_kpts_dst.txt", ["street/7"]),
    ("corr-three", "corr/b/8_2_top3.match", ["b/8-2"]),
]


def lay_out(root: Path, name: str) -> None:
    for file, content in LAYOUTS[name].items():
        path = root / file
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".ply":
            write_cloud(path, PointCloud(POINTS))
        else:
            path.write_text(content or "0 0 0 0\n")


@pytest.mark.parametrize(("name", "file", "lacking"), REMOVED)
def test_pairs_that_lack_a_file_are_left_out_and_named(
    name: str, file: str, lacking: list[str], tmp_path: Path
) -> None:
    lay_out(tmp_path, name)
    whole = open_dataset(name, tmp_path)
    assert not whole.lacking_pairs()
    assert name == "kitti" or not whole.note()
    (tmp_path / file).unlink()
    dataset = open_dataset(name, tmp_path)
    assert dataset.pair_names() == [pair for pair in whole.pair_names() if pair not in lacking]
    assert list(dataset.lacking_pairs()) == lacking
    for pair, path in dataset.lacking_pairs().items():
        assert path.stem.split("_")[0] in file
        assert not path.exists()
        with pytest.raises(InputError, match=r"needs .*, which isn't there"):
            dataset.load(pair)
    total = len(whole.pair_names())
    assert dataset.note().startswith(f"{len(lacking)} of {total} pairs lack files: {lacking[0]} (no ")


@pytest.mark.parametrize(
    ("name", "file", "content", "says"),
    [
        *(
            ("b3r", "b3r/r/ConfigScene0.ini", content, "ConfigScene0.ini: not a readable")
            for content in ("[MODELS]\n", "no configuration at all", "[SCENE]\nPATH = 3\n")
        ),
        ("stanford", "stanford_views/bunny/bun.conf", "bmesh a.ply 0 0 0 x 0 0 1\n", "bun.conf: can't read the pose"),
        ("stanford", "manifest.json", "[]", "manifest"),
        ("3dmatch", "threedmatch/hall-evaluation/gt.log", LOG[:-8], "gt.log: not a list of poses"),
        ("fgr", "fgr/p1/features_0000.bin", "\1\0\0\0\3\0\0\0" + 20 * "\0", "features_0000.bin: declares 1 points"),
        ("u3m", "u3m/Chef/pairs.txt", "a.ply b.ply 1 2 3\n", "pairs.txt, line 1: has 5 words"),
    ],
)  # fmt: skip
def test_broken_lists_and_poses_are_named(
    name: str, file: str, content: str, says: str, tmp_path: Path
) -> None:
    lay_out(tmp_path, name)
    first = open_dataset(name, tmp_path).pair_names()[0]
    (tmp_path / file).write_text(content)
    with pytest.raises(InputError, match=says):
        open_dataset(name, tmp_path).load(first)


def test_data_sets_without_any_whole_pair_are_not_there(tmp_path: Path) -> None:
    for name, files in (("b3r-clean", "*.ply"), ("3dmatch", "*.ply"), ("kitti", "*.bin")):
        lay_out(tmp_path / name, name)
        for path in (tmp_path / name).rglob(files):
            path.unlink()
        with pytest.raises(InputError, match="isn't there, but .* needs it; get it from"):
            open_dataset(name, tmp_path / name)
