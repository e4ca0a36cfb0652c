"""What a scene makes of its scans: one cloud, files of poses, a graph."""

import json
from pathlib import Path

import numpy as np
import pytest
from placed_scenes import PAIR, edge, known_scene, thin_scene, turned

from cgroup import InputError
from cgroup.io import read_transforms, write_cloud
from cgroup.io.scan_names import find_names
from cgroup.registration import prepare
from cgroup.rigid import invert
from cgroup.scenes import PoseGraph
from cgroup.types import PointCloud

SCENE = known_scene()
GRID = np.stack(np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], [0.0], indexing="ij"), axis=-1).reshape(-1, 3)


def test_merged_scans_lie_in_the_frame_of_the_component() -> None:
    far = thin_scene(PointCloud(GRID)).merged()
    aside = GRID + np.array([5.0, 0.0, 0.0])
    both = np.concatenate([GRID, aside])
    assert sorted(map(tuple, far.points.round(9))) == sorted(map(tuple, both))
    assert far.normals is None
    assert {tuple(color) for color in far.colors.tolist()} == {(230, 159, 0), (0, 114, 178)}


def test_what_several_scans_show_is_no_denser() -> None:
    """The first and the third are the same surface."""
    once = known_scene(components=[[0, 1], [2], [3]]).merged()
    assert abs(len(SCENE.merged()) - len(once)) < 0.15 * len(once)
    assert len(SCENE.merged(voxel=20.0)) < 0.2 * len(once)


def test_merged_scans_keep_colors_and_normals_that_all_have() -> None:
    colors = np.full((len(GRID), 3), 7, np.uint8)
    normals = np.tile([1.0, 0.0, 0.0], (len(GRID), 1))
    cloud = PointCloud(GRID, normals, colors=colors)
    merged = thin_scene(cloud).merged()
    assert (merged.colors == 7).all()
    assert np.allclose(merged.normals, [1, 0, 0])
    half_turned = known_scene(
        poses=np.array([np.eye(4), turned(np.pi / 2, (9.0, 0.0, 0.0))]),
        components=[[0, 1]],
        edges=[],
        names=["a", "b"],
        scans=(cloud, PointCloud(GRID, normals)),
    ).merged()
    assert np.allclose(half_turned.normals[half_turned.points[:, 0] > 5], [0, 1, 0], atol=1e-9)
    assert not (half_turned.colors == 7).any()  # one has none


def test_paths_are_read_again_and_prepared_scans_have_their_own(tmp_path: Path) -> None:
    path = tmp_path / "scan.ply"
    write_cloud(path, PAIR.target)
    given = known_scene(scans=(path, prepare(PAIR.source, voxel=5.0), str(path), PAIR.source))
    same = known_scene(scans=(PAIR.target, PAIR.source, PAIR.target, PAIR.source))
    assert np.array_equal(given.merged().points, same.merged().points)
    path.unlink()
    with pytest.raises(InputError, match="no such file"):
        given.merged()


@pytest.mark.parametrize("suffix", [".tum", ".kitti", ".log", ".g2o", ".json"])
@pytest.mark.parametrize("components", [[[0, 1, 2, 3]], [[0, 2]], [[1, 3], [0, 2]], [[2, 3, 1]]])
def test_poses_have_the_names_of_their_scans(
    tmp_path: Path, suffix: str, components: list[list[int]]
) -> None:
    """Also of scans that are elsewhere or left out; names may hold anything, each takes one line."""
    names = ["a b#1.ply", "scan 3: x.ply", "ö\n1 0 0 0 0 0 0 1.ply", "sub/other scan 2: y"]
    scene = known_scene(components=components, edges=[], names=names)
    path = tmp_path / f"poses{suffix}"
    for component, rows in enumerate(components):
        scene.write(path, component=component)
        if suffix == ".json":
            read = json.loads(path.read_text())
            found = dict(enumerate(read["scans"])), [node["scan"] for node in read["nodes"]]
        else:
            beside = path.with_name(f"{path.name}.names")
            assert beside.exists() == (suffix in (".kitti", ".log"))
            text = (beside if beside.exists() else path).read_text(encoding="utf-8")
            found = find_names(text.splitlines())
        assert found[0] == {row: name.replace("\n", "\\n") for row, name in enumerate(names)}
        is_graph = suffix in (".g2o", ".json")
        assert found[1] == (sorted(rows) if is_graph else rows)
        poses = PoseGraph.read(path).poses if is_graph else None
        if suffix in (".tum", ".kitti"):
            poses = read_transforms(path)
        if poses is not None:
            np.testing.assert_allclose(poses, scene.poses[found[1]], atol=1e-9)


def test_edges_of_the_graph_measure_sources_in_frames_of_targets() -> None:
    graph = SCENE.graph
    assert graph.ids.tolist() == [0, 1, 2, 3]
    assert graph.edges.tolist() == [[0, 1], [1, 2], [0, 2]]
    assert graph.kept.tolist() == [True, True, False]
    first = invert(graph.poses[0]) @ graph.poses[1]
    assert np.allclose(graph.measurements[0], first)
    assert graph.residuals[0] < 1e-6


def test_residuals_of_the_graph_weigh_errors_as_edges_do() -> None:
    """A small motion of the target's frame, seen through the covariance of an edge, in both frames."""
    small = np.diag([1e-4, 2e-4, 3e-4, 0.1, 0.2, 0.3])
    moved = np.eye(4)
    moved[:3, 3] = [0.3, 0.0, 0.0]
    scene = known_scene(edges=[edge(SCENE.poses, 1, 0, small, 0.0, moved=moved)])
    assert scene.graph.residuals[0] == pytest.approx(0.3 / 0.1**0.5, rel=1e-6)


def test_graphs_hold_the_kept_edges_of_a_component(tmp_path: Path) -> None:
    scene = known_scene(components=[[1, 2], [0], [3]], edges=SCENE.edges[1:2])
    scene.write(tmp_path / "a.g2o")
    read = PoseGraph.read(tmp_path / "a.g2o")
    assert read.ids.tolist() == [1, 2]
    assert read.edges.tolist() == [[0, 1]]
    SCENE.write(tmp_path / "a.json")
    written = json.loads((tmp_path / "a.json").read_text())
    assert len(written["nodes"]) == 3
    assert [(one["target_node_id"], one["source_node_id"]) for one in written["edges"]] == [(0, 1), (1, 2)]


def test_no_output_replaces_a_scan(tmp_path: Path) -> None:
    path = tmp_path / "scan.ply"
    write_cloud(path, PAIR.target)
    (tmp_path / "other.ply").symlink_to(path)
    before = path.read_bytes()
    scene = known_scene(scans=(str(path), PAIR.source, PAIR.target, PAIR.source))
    for name in ("scan.ply", "other.ply"):
        with pytest.raises(InputError, match="is one of the inputs"):
            scene.write(tmp_path / name)
    assert path.read_bytes() == before
