"""
Merge many scans
================

Merge eight scans in random order: four views of one stone, three of another, and one of a third.
`register_all` finds the scans that belong together, and their poses.
"""

import numpy as np

from cgroup.datasets import standin_pair
from cgroup.evaluation import rotation_error
from cgroup.rigid import invert
from cgroup.scenes import register_all

# %%
# The scans
# ---------
# Each view is an array of points with noise, in the scanner's frame. The stones are generated, so the true
# poses are known.


def views(seed: int, turns: tuple[int, ...]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return scans of a stone from several sides, and their poses in the frame of the first."""
    pairs = [standin_pair(seed=seed, turn=turn, pixels=80) for turn in turns]
    scans = [pairs[0].source.points, *(pair.target.points for pair in pairs)]
    return scans, [np.eye(4), *(invert(pair.T_target_source) for pair in pairs)]


stones = [views(1, (40, 80, 120)), views(2, (40, 80)), views(3, (40,))]
bag = [(stone, view) for stone, count in enumerate((4, 3, 1)) for view in range(count)]
bag = [bag[row] for row in np.random.default_rng(1).permutation(len(bag))]
scans = [stones[stone][0][view] for stone, view in bag]
names = [f"{'ABC'[stone]}{view}" for stone, view in bag]
print(", ".join(names))

# %%
# The scene
# ---------
# The scanner is at the origin of each scan. Poses that put a surface into observed free space are rejected.

scene = register_all(scans, names=names, viewpoint=(0, 0, 0))
for rows in scene.components:
    print(", ".join(names[row] for row in rows))
for note in scene.notes:
    print(note)

# %%
# Errors
# ------
# Compare the poses of the two scenes with the true ones, each in the frame of its first scan.

for rows in scene.components[:2]:
    true = np.array([stones[bag[row][0]][1][bag[row][1]] for row in rows])
    true = invert(true[0]) @ true
    off = [rotation_error(scene.poses[row], pose) for row, pose in zip(rows, true, strict=True)]
    print(f"{names[rows[0]]} and {len(rows) - 1} more: largest error {max(off):.2f} degrees")

# %%
# The merged scans, and the edges between them
# --------------------------------------------
# Each scan has a colour. The residual of an edge is its distance from the scene's poses, in standard
# deviations.

figure = scene.plot()

# %%
# Files
# -----
# Poses, pose graph and merged cloud of the largest component; ``component=1`` selects the second.

for file in ("poses.tum", "graph.g2o", "merged.ply"):
    scene.write(file)
figure.savefig("scene.png")
