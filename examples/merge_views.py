"""
Merge many scans
================

Eight scans lie in a bag: four views of one stone, three of another, and one of a third. In which order, and
which belong together, is not told. Where does each scan lie?
"""

import numpy as np

from cgroup.datasets import standin_pair
from cgroup.evaluation import rotation_error
from cgroup.rigid import invert
from cgroup.scenes import register_all

# %%
# A bag of scans
# --------------
# Each view is an array of points in the scanner's own frame, with noise. True poses are known, since the
# stones are generated.


def views(seed: int, turns: tuple[int, ...]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Scan a stone from several sides; return the pose of each scan in the frame of the first, too."""
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
# The scanner stood at the origin of each scan. What it saw through speaks against a pose.

scene = register_all(scans, names=names, viewpoint=(0, 0, 0))
for rows in scene.components:
    print(", ".join(names[row] for row in rows))
for note in scene.notes:
    print(note)

# %%
# How far it is right
# -------------------
# Poses of the two scenes are compared with the true ones, each in the frame of its first scan.

for rows in scene.components[:2]:
    true = np.array([stones[bag[row][0]][1][bag[row][1]] for row in rows])
    true = invert(true[0]) @ true
    off = [rotation_error(scene.poses[row], pose) for row, pose in zip(rows, true, strict=True)]
    print(f"{names[rows[0]]} and {len(rows) - 1} more: off by {max(off):.2f} degrees at most")

# %%
# The merged scans, and the edges between them
# --------------------------------------------
# Each scan has a colour. The residual of an edge is its distance from the scene's poses, in standard
# deviations.

figure = scene.plot()

# %%
# Files
# -----
# Poses, the pose graph and the merged cloud of the largest component; of another one with ``component=1``.

for file in ("poses.tum", "graph.g2o", "merged.ply"):
    scene.write(file)
figure.savefig("scene.png")
