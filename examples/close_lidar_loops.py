"""
Close the loops of a LiDAR drive
================================

A car drives down a street and back. Which of its scans show the same place, and how do they lie to each
other? Scans that look alike are candidates; `register` finds the pose of each, or says that there is no
loop. The street is generated: boxes, seen by a scanner in software.
"""

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from cgroup import NoConsensusError
from cgroup.registration import prepare, register

# %%
# A street and a scanner
# ----------------------
# Houses, cars and poles are boxes; a ray ends where it first enters one, or on the ground.

rng = np.random.default_rng(4)


def boxes_of_a_street() -> np.ndarray:
    """(k,2,3): opposite corners of houses, cars and poles."""
    kinds = (  # how many, distance from the middle of the street, least and greatest half sizes
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
    """(N,3): what a scanner with 32 beams sees, in its own frame."""
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
    """(4,4): where the scanner is, 1.8 m over the street."""
    cos, sin = np.cos(heading), np.sin(heading)
    return np.array([[cos, -sin, 0, x], [sin, cos, 0, y], [0, 0, 1, 1.8], [0, 0, 0, 1]])


along = np.arange(-60, 61, 15)
drive = [pose(-1.5, y, np.pi / 2) for y in along] + [pose(1.5, y - 4, -np.pi / 2) for y in along[::-1]]
street = boxes_of_a_street()
scans = [scan(street, place) for place in drive]
print(f"{len(scans)} scans of about {len(scans[0]):,} points")

# %%
# Candidates
# ----------
# A descriptor of a whole scan: the greatest height in each cell of a polar grid. Turning the car shifts the
# columns, so the magnitudes of their Fourier transform stay the same. Candidates are the scans that are most
# alike and not neighbours in time.


def describe(points: np.ndarray) -> np.ndarray:
    """Heights over 16 rings of 3.75 m and 60 sectors, whatever the heading."""
    ring = (np.linalg.norm(points[:, :2], axis=1) / 3.75).astype(int)
    sector = ((np.arctan2(points[:, 1], points[:, 0]) / np.pi + 1) * 30).astype(int) % 60
    heights = np.full((16, 60), -2.0)
    near = ring < 16
    np.maximum.at(heights, (ring[near], sector[near]), points[near, 2])
    return np.abs(np.fft.rfft(heights + 2, axis=1))[:, :12].ravel()


descriptors = np.array([describe(points) for points in scans])
unlike = np.linalg.norm(descriptors[:, None] - descriptors, axis=2)
candidates = [
    (late, int(early))
    for late in range(len(scans))
    for early in np.argsort(unlike[late, : max(late - 3, 0)])[:2]
]

# %%
# Loops
# -----
# Each scan is made ready once. The scanner stands at the origin of each, upright: both are told, since at low
# overlap nothing helps more.

prepared = [prepare(points, voxel=0.5, viewpoint=(0, 0, 0)) for points in scans]
loops, refused = [], []
for late, early in candidates:
    try:
        found = register(prepared[late], prepared[early], axis=(0, 0, 1))
    except NoConsensusError:
        refused.append((late, early))
        continue
    loops.append((late, early))
    true = np.linalg.inv(drive[early]) @ drive[late]
    error = np.linalg.norm(found.T_target_source[:3, 3] - true[:3, 3])
    print(f"{late:2} closes on {early:2}: probability {found.probability:.2f}, {100 * error:.1f} cm off")
print(f"{len(loops)} loops, {len(refused)} candidates refused")

# %%
# The map
# -------

figure = Figure(figsize=(9, 3.4), layout="constrained")
axes = figure.subplots()
for low, high in street:
    axes.fill([low[1], high[1], high[1], low[1]], [low[0], low[0], high[0], high[0]], color="#dddddd")
places = np.array([place[[1, 0], 3] for place in drive])
axes.plot(*places.T, "o-", color="#0072B2", markersize=4, linewidth=1, label="drive")
drawn = [(refused, "#999999", 0.5, "refused"), (loops, "#009E73", 2.5, "loops")]
for pairs, color, width, label in drawn:
    lines = [places[list(pair)] for pair in pairs]
    axes.add_collection(LineCollection(lines, colors=color, linewidths=width, label=label))
axes.set(xlabel="along the street (m)", ylabel="across (m)", aspect=1.6, xlim=(-95, 95))
figure.legend(loc="outside upper center", ncols=3, frameon=False)
figure.savefig("loops.png")
