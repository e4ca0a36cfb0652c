"""
Close the loops of a LiDAR drive
================================

A car drives down a street and back, and its odometry drifts. `register_all` finds pairs of scans of the same
place (loops) and estimates the poses of all scans. The street and the scans are generated.
"""

from itertools import pairwise

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from cgroup.rigid import invert
from cgroup.scenes import register_all

# %%
# A street and a scanner
# ----------------------
# Houses, cars and poles are boxes. A ray ends at the first box, or on the ground.

rng = np.random.default_rng(4)


def boxes_of_a_street() -> np.ndarray:
    """Return opposite corners of houses, cars and poles, (k,2,3)."""
    kinds = (  # count, distance from the middle of the street, smallest and largest half sizes
        (24, (14, 20), (4, 4, 2.5), (6, 7, 7)),
        (24, (4, 6), (0.8, 1.8, 0.7), (1.1, 2.6, 1.0)),
        (24, (7, 8), (0.1, 0.1, 2), (0.2, 0.2, 4)),
    )
    corners = []
    for count, across, least, greatest in kinds:
        half = rng.uniform(least, greatest, size=(count, 3))
        side = rng.choice([-1, 1], size=count)
        center = np.column_stack(
            [side * rng.uniform(*across, count), rng.uniform(-90, 90, count), half[:, 2]]
        )
        corners.append(np.stack([center - half, center + half], axis=1))
    return np.concatenate(corners)


def scan(boxes: np.ndarray, T_world_scanner: np.ndarray) -> np.ndarray:
    """Return the scan of a 32-beam scanner in its own frame, (N,3)."""
    azimuth, elevation = np.meshgrid(
        np.linspace(-np.pi, np.pi, 450, endpoint=False), np.radians(np.linspace(-20, 12, 32))
    )
    rays = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)],
        axis=-1,
    ).reshape(-1, 3)
    toward, origin = rays @ T_world_scanner[:3, :3].T, T_world_scanner[:3, 3]
    distance = np.where(toward[:, 2] < 0, -origin[2] / toward[:, 2], np.inf)
    for low, high in boxes:
        first, second = (low - origin) / toward, (high - origin) / toward
        enter, leave = np.minimum(first, second).max(axis=1), np.maximum(first, second).min(axis=1)
        is_hit = (enter > 0) & (enter < leave)
        distance = np.where(is_hit & (enter < distance), enter, distance)
    seen = distance < 70
    return rays[seen] * (distance[seen] + rng.normal(scale=0.02, size=seen.sum()))[:, None]


def pose(x: float, y: float, heading: float) -> np.ndarray:
    """Return the pose of the scanner, 1.8 m above the street, (4,4)."""
    cos, sin = np.cos(heading), np.sin(heading)
    return np.array([[cos, -sin, 0, x], [sin, cos, 0, y], [0, 0, 1, 1.8], [0, 0, 0, 1]])


along = np.arange(-45, 46, 15)
drive = [pose(-1.5, y, np.pi / 2) for y in along] + [pose(1.5, y - 4, -np.pi / 2) for y in along[::-1]]
street = boxes_of_a_street()
scans = [scan(street, place) for place in drive]
print(f"{len(scans)} scans of about {len(scans[0]):,} points")

# %%
# Odometry
# --------
# Each step has the same error of half a degree and 30 centimetres, so the end of the drive is far from its
# true position.

drift = invert(pose(0, 0, 0)) @ pose(0.3, 0.05, 0.01)
odometry = [np.eye(4)]
for before, after in pairwise(drive):
    odometry.append(odometry[-1] @ invert(before) @ after @ drift)

# %%
# The scene
# ---------
# Pairs within 35 metres by the odometry may show the same place and are registered. The scanner is at the
# origin of each scan, and its z axis is vertical. At low overlap `viewpoint` and `axis` help most.

places = np.array(odometry)[:, :3, 3]
pairs = [(i, j) for i in range(len(scans)) for j in range(i) if np.linalg.norm(places[i] - places[j]) < 35]
scene = register_all(scans, pairs=pairs, odometry=odometry, viewpoint=(0, 0, 0), axis=(0, 0, 1), voxel=0.5)
print(scene)
loops = [edge for edge in scene.edges if edge.kept and abs(edge.source - edge.target) > 3]
print(f"{scene.tried} pairs tried, {len(loops)} loops")

true = invert(drive[0]) @ np.array(drive)
for name, poses in (("odometry", np.array(odometry)), ("scene", scene.poses)):
    off = np.linalg.norm(poses[:, :3, 3] - true[:, :3, 3], axis=1)
    print(f"{name}: largest error {off.max():.2f} m")

# %%
# The map
# -------

figure = Figure(figsize=(9, 3.8), layout="constrained")
axes = figure.subplots()
for low, high in street:
    axes.fill([low[1], high[1], high[1], low[1]], [low[0], low[0], high[0], high[0]], color="#dddddd")
drawn = [(np.array(odometry), "#D55E00", "odometry"), (scene.poses, "#0072B2", "scene")]
for poses, color, label in drawn:
    line = (drive[0] @ poses)[:, [1, 0], 3]
    axes.plot(*line.T, "o-", color=color, markersize=4, linewidth=1, label=label)
found = (drive[0] @ scene.poses)[:, [1, 0], 3]
lines = [found[[edge.source, edge.target]] for edge in loops]
axes.add_collection(LineCollection(lines, colors="#009E73", linewidths=1.5, label="loops"))
axes.set(xlabel="along the street (m)", ylabel="across (m)", aspect=1.6, xlim=(-95, 95))
figure.legend(loc="outside upper center", ncols=3, frameon=False)
figure.savefig("loops.png")
