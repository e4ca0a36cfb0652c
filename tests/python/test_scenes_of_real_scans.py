"""Scenes of real scans, whose true poses are known: part of each set, and all of it every night."""

import itertools
import json

import numpy as np
import pytest
from shared_data import data_folder

from cgroup.datasets.scan_sets import load_scan_set
from cgroup.io import read_cloud
from cgroup.rigid import apply, invert, rotation_error
from cgroup.scenes import register_all


def errors_of(scene, part, true, middles):
    """Errors of all pairs of a component: turns in degrees, and shifts of the middles of the scans."""
    turns, shifts = [], []
    for one, other in itertools.combinations(part, 2):
        found = invert(scene.poses[one]) @ scene.poses[other]
        expected = invert(true[one]) @ true[other]
        turns.append(rotation_error(found, expected))
        shifts.append(np.linalg.norm(apply(found, middles[[other]]) - apply(expected, middles[[other]])))
    return np.array(turns), np.array(shifts)


@pytest.mark.parametrize(
    ("name", "count", "viewpoint", "alone", "degrees", "meters"),
    [
        ("eth_facade_7", 7, None, 0, 0.1, 0.01),
        ("kitti07_submaps_5", 5, None, 0, 0.5, 0.1),
        ("airsim_blocks_20", 7, None, 0, 0.1, 0.05),
        pytest.param("airsim_blocks_20", 20, None, 0, 0.1, 0.05, marks=pytest.mark.nightly),
        ("vlp16_indoor_11", 6, (0, 0, 0), 1, 2.0, 0.1),  # rings 2 degrees apart: one scan is too doubtful
        pytest.param("vlp16_indoor_11", 11, (0, 0, 0), 1, 2.0, 0.1, marks=pytest.mark.nightly),
    ],
)
def test_stations_and_drives_become_one_scene(name, count, viewpoint, alone, degrees, meters):
    folder = data_folder("scenes") / "scenes" / name
    described = json.loads((folder / "set.json").read_text())["scans"][:count]
    scans = [read_cloud(folder / scan["file"]) for scan in described]
    true = np.array([scan["world_from_scan"] for scan in described])
    scene = register_all(scans, viewpoint=viewpoint)
    assert len(scene.components[0]) >= count - alone
    middles = np.array([scan.points.mean(axis=0) for scan in scans])
    turns, shifts = errors_of(scene, scene.components[0], true, middles)
    assert np.median(turns) < degrees
    assert turns.max() < 5
    assert np.median(shifts) < meters
    for edge in scene.edges:
        if edge.kept:
            assert rotation_error(edge.T_target_source, invert(true[edge.target]) @ true[edge.source]) < 10


@pytest.mark.parametrize(
    ("objects", "seed", "sizes"),
    [
        (["bunny"], 0, [10, 10]),
        pytest.param(["bunny", "happy_stand"], 0, [15, 15, 10, 10], marks=pytest.mark.nightly),
        pytest.param(["bunny", "happy_stand"], 1, [15, 15, 10, 10], marks=pytest.mark.nightly),
    ],
)
def test_views_and_their_mirror_images_become_their_objects(objects, seed, sizes):
    names = [f"stanford_views/{each}" for each in objects]
    views = load_scan_set(names, data_folder("stanford_views"), seed, mirrored=True)
    scene = register_all(views.scans)
    labels = np.array(views.labels)
    assert [len(part) for part in scene.components] == sizes
    middles = np.array([points.mean(axis=0) for points in views.scans])
    for part in scene.components:
        assert len(set(labels[part])) == 1
        turns, shifts = errors_of(scene, part, views.truth, middles)
        assert np.median(turns) < 0.5
        assert turns.max() < 2
        assert np.median(shifts) < 0.0015  # of scans whose points lie .0005 to .001 apart
    assert all(labels[edge.source] == labels[edge.target] for edge in scene.edges if edge.kept)
