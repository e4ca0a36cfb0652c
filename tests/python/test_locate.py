"""Scans in maps: where a generated town was scanned, what repeats, and what the map does not show."""

import json
import os
import pickle
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from shared_data import data_folder

from cgroup import InputError, NoConsensusError
from cgroup.datasets import standin_pair
from cgroup.datasets.generated.stones import random_pose
from cgroup.datasets.generated.worlds import World
from cgroup.evaluation import rotation_error
from cgroup.io import read_cloud
from cgroup.maps import settings
from cgroup.maps.plan_view import find_layers
from cgroup.rigid import apply, invert
from cgroup.scenes import PreparedMap, assess_in_map, locate, prepare_map, register_all

SIDE, LOT, SPACING = 120.0, 30.0, 0.7
EYES = [(33.0, 47.0, 1.8), (75.0, 62.0, 1.8)]
FRAME = random_pose(np.random.default_rng(3))


@cache
def town(seed: int = 0) -> np.ndarray:
    """Return houses (n,7) as `World` has them, one per lot."""
    rng = np.random.default_rng(seed)
    corners = np.arange(LOT / 2, SIDE, LOT)
    places = np.stack(np.meshgrid(corners, corners), axis=-1).reshape(-1, 2)
    heights = rng.uniform(2, 7, len(places))
    halves, yaws = rng.uniform(3, 7, (len(places), 2)), rng.uniform(-0.5, 0.5, len(places))
    return np.column_stack([places + rng.uniform(-5, 5, places.shape), heights, halves, heights, yaws])


def points_on(boxes: np.ndarray) -> np.ndarray:
    """Return points on the ground, on roofs and on walls."""
    rng = np.random.default_rng(1)
    count = int((SIDE / SPACING) ** 2)
    parts = [np.column_stack([rng.uniform(0, SIDE, (count, 2)), np.zeros(count)])]
    for *middle, a, b, c, yaw in boxes:
        half = np.array([a, b, c])
        turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        for axis, side in [(0, -1), (0, 1), (1, -1), (1, 1), (2, 1)]:
            count = int(4 * half.prod() / half[axis] / SPACING**2)
            local = rng.uniform(-1, 1, (count, 3))
            local[:, axis] = side
            parts.append((local * half) @ turn.T + middle)
    return np.concatenate(parts)


def scan_from(eye: tuple[float, float, float]) -> np.ndarray:
    """Scan the town with 32 beams, and return the points in `FRAME`."""
    around, up = np.meshgrid(
        np.linspace(0, 2 * np.pi, 600, endpoint=False), np.radians(np.linspace(-25, 15, 32))
    )
    rays = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=-1)
    rays = rays.reshape(-1, 3)
    ground = [SIDE / 2, SIDE / 2, -1.0, SIDE, SIDE, 1.0, 0.0]
    world = World(np.vstack([town(), ground]), np.empty((0, 5)), np.empty((0, 4)))
    ranges = world.cast(np.array(eye), rays)
    return apply(FRAME, rays[ranges < 50] * ranges[ranges < 50, None])


@cache
def place() -> PreparedMap:
    return prepare_map(points_on(town()))


def origin_of(pose: np.ndarray) -> np.ndarray:
    """Return where a pose puts the scanner."""
    return (pose @ FRAME)[:3, 3]


@pytest.mark.parametrize("whole", [True, False])
def test_a_scan_is_found_in_a_town(whole: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not whole:
        monkeypatch.setattr(settings, "WHOLE", 500)
    for eye in EYES:
        found = locate(scan_from(eye), place())
        assert [each.ok for each in found] == [True]
        np.testing.assert_allclose(origin_of(found[0].T_target_source), eye, atol=0.2)


def test_places_that_look_the_same_share_the_probability() -> None:
    houses = points_on(town())
    beside = houses + np.array([SIDE + 60.0, 0.0, 0.0])
    twice = prepare_map(np.concatenate([houses, beside]), voxel=place().levels[1].voxel)
    found = locate(scan_from(EYES[0]), twice)
    assert len(found) == 2
    assert not any(each.ok for each in found)
    shifts = [origin_of(each.T_target_source) - EYES[0] for each in found]
    np.testing.assert_allclose(sorted(shift[0] for shift in shifts), [0.0, SIDE + 60.0], atol=0.3)
    assert found[0].notes[0].startswith("1 other pose shares the probability")


def test_only_what_lies_near_is_looked_at() -> None:
    scan = apply(invert(FRAME), scan_from(EYES[0]))
    x, y, z = EYES[0]
    assert locate(scan, place(), near=(x + 3, y - 2, z), radius=6)[0].ok
    far = locate(scan, place(), near=(x + 60, y + 40, z), radius=6)
    assert not any(each.ok for each in far)
    assert all(np.linalg.norm(each.T_target_source[:3, 3] - [x + 60, y + 40, z]) < 7 for each in far)
    assert locate(scan, place(), near=(5000, 0, 0), radius=5) == []


def test_a_scan_of_another_place_is_refused() -> None:
    pair = standin_pair()
    scan = (pair.source.points - pair.source.points.mean(axis=0)) * 0.4
    assert not any(found.ok for found in locate(scan, place()))


def test_the_mirror_image_of_a_scan_is_nowhere_in_a_map() -> None:
    scan = scan_from(EYES[0])
    (alone,), (beside,) = locate(scan, place()), locate(scan, place(), decoy=True)
    assert np.array_equal(alone.T_target_source, beside.T_target_source)
    assert beside.decoy_probability is not None
    assert beside.decoy_probability < 0.1
    mirrored = locate(scan * (-1.0, 1.0, 1.0), place())
    assert not any(found.ok for found in mirrored)


def test_a_pose_in_a_map_is_assessed() -> None:
    scan = scan_from(EYES[0])
    pose = locate(scan, place())[0].T_target_source
    done = assess_in_map(scan, place(), pose)
    assert done.ok
    assert np.array_equal(done.T_target_source, pose)
    assert np.linalg.eigvalsh(done.covariance).min() > 0
    beside = pose.copy()
    beside[:3, 3] += FRAME[:3, 0]  # a metre
    wrong = assess_in_map(scan, place(), beside)
    assert not wrong.ok
    assert wrong.notes
    np.testing.assert_allclose(wrong.alternatives[0], pose, atol=0.3)
    for shift in (60.0, 1e4):
        beside[:3, 3] += shift * FRAME[:3, 2]
        with pytest.raises(NoConsensusError, match="under the pose|pose puts the scan"):
            assess_in_map(scan, place(), beside)


def test_a_map_is_kept_in_a_folder(tmp_path: Path) -> None:
    place().save(tmp_path / "map")
    loaded = PreparedMap.load(tmp_path / "map")
    assert repr(loaded) == repr(place())
    scan = scan_from(EYES[0])
    expected = locate(scan, place())[0].T_target_source
    for same in (loaded, pickle.loads(pickle.dumps(place()))):
        np.testing.assert_array_equal(locate(scan, same)[0].T_target_source, expected)
    with pytest.raises(InputError, match="exists already"):
        place().save(tmp_path / "map")
    assert [path.name for path in tmp_path.iterdir()] == ["map"]


def test_a_damaged_map_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "map"
    prepare_map(standin_pair().target, voxel=6.0).save(folder)
    for file in sorted(folder.iterdir()):
        content = file.read_bytes()
        half = len(content) // 2
        for damaged in (content[:half], content[:half] + bytes([content[half] ^ 4]) + content[half + 1 :]):
            file.write_bytes(damaged)
            with pytest.raises(InputError, match="no folder that `PreparedMap.save` has written .*; save"):
                PreparedMap.load(folder)
        file.unlink()
        with pytest.raises(InputError, match="no folder that"):
            PreparedMap.load(folder)
        if hasattr(os, "mkfifo"):
            os.mkfifo(file)
            with pytest.raises(InputError, match="is a pipe"):
                PreparedMap.load(folder)
            file.unlink()
        file.write_bytes(content)
    loaded = PreparedMap.load(folder)
    os.truncate(folder / "points.npy", 200)
    assert np.isfinite(loaded.points).all()
    facts = folder / "map.json"
    facts.write_text(facts.read_text().replace("6.0", "7.0"))
    with pytest.raises(InputError, match="map.json is damaged"):
        PreparedMap.load(folder)


def test_a_map_grows() -> None:
    houses = points_on(town())
    left = houses[:, 0] < SIDE / 2
    half = prepare_map(houses[left], voxel=place().levels[1].voxel)
    whole = half.add(houses[~left])
    assert [level.voxel for level in whole.levels] == [place().levels[1].voxel]  # as was asked for
    assert len(prepare_map(houses[left][::40]).add(houses).levels) > 1
    assert locate(scan_from(EYES[1]), whole)[0].ok


def test_a_scene_is_a_map() -> None:
    pair = standin_pair()
    scene = register_all([pair.source, pair.target])
    found = locate(pair.source, prepare_map(scene))
    assert found[0].ok
    np.testing.assert_allclose(found[0].T_target_source, scene.poses[0], atol=0.2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"radius": 5}, "radius: got 5, but no place; give `near`, too"),
        ({"near": (0, np.nan, 0)}, "near: "),
        ({"place": np.zeros((30, 3))}, "place: "),
    ],
)
def test_wrong_options_are_refused(options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        locate(**{"scan": scan_from(EYES[0]), "place": place()} | options)

    with pytest.raises(InputError, match="voxel: got .*, which leaves .* give a smaller one"):
        prepare_map(points_on(town()), voxel=300.0)


def test_descriptors_are_compared_with_those_around_each_cell() -> None:
    level = place().levels[1]
    wanted = level.descriptors[:200:20, :-1]
    size = 8 * level.voxel
    starts = np.concatenate([[0], level.voxel_ends])
    distances = np.empty((len(level.cells), len(wanted)))
    for cell, middle in enumerate(level.cells):
        beside = np.linalg.norm(level.cells - middle, axis=1) <= 2.25 * size  # to quarters of a cell
        rows = np.concatenate([np.arange(starts[k], starts[k + 1]) for k in np.flatnonzero(beside)])
        rows = rows[level.descriptors[rows, -1] < 1e9]
        values = level.descriptors[rows, :-1].astype(float)
        distances[cell] = np.linalg.norm(values[:, None] - wanted, axis=2).min(axis=0)
    expected = np.minimum(distances / np.maximum(np.median(distances, axis=0), 1e-6), 1).mean(axis=1)
    # Squares in single precision: distances of 0 come out as some hundredths.
    np.testing.assert_allclose(level.compare(wanted, 2.3 * size), expected, atol=0.02)


def test_no_plan_where_there_are_no_walls() -> None:
    points = np.random.default_rng(0).uniform(0, 50, (500, 3)) * [1, 1, 0.0]
    assert find_layers(points, np.tile([0.0, 0, 1], (500, 1)), None) is None


def test_scans_of_a_drive_are_found_in_its_map() -> None:
    folder = data_folder("scenes") / "scenes" / "nclt_map_22_queries"
    queries = json.loads((folder / "set.json").read_text())["scans"][::3]
    drive = prepare_map(read_cloud(folder / "map.ply"))
    for query in queries:
        scan = read_cloud(folder / query["file"])
        best, true = locate(scan, drive)[0], np.array(query["world_from_scan"])
        assert best.ok
        assert rotation_error(best.T_target_source, true) < 5
        middle = scan.points.mean(axis=0)[None]
        assert np.linalg.norm(apply(best.T_target_source, middle) - apply(true, middle)) < 2
