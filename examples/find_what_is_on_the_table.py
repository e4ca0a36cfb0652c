"""
Models in a scene
=================

Find four models in a range scan, with their poses. The models are meshes; the scan is one view.
"""

import numpy as np
from matplotlib.figure import Figure

from cgroup.datasets import open_dataset
from cgroup.plots.shading import face_broadside
from cgroup.registration import recognize
from cgroup.rigid import apply

heap = open_dataset("standin-clutter")
pairs = {f"stone{i}": heap.load(f"scene0-stone{i}") for i in range(4)}
models = {name: pair.source for name, pair in pairs.items()}
scene = pairs["stone0"].target

# %%
# The search
# ----------
# The scanner is at the origin of the scene. Models that would hide observed points are rejected.

found = recognize(models, scene, viewpoint=(0, 0, 0))
for name, registration in found:
    error = np.abs(registration.T_target_source - pairs[name].T_target_source)[:3, 3].max()
    print(f"{name}: probability {registration.probability:.2f}, error {error:.2f} mm")

# %%
# The scene and the found models
# ------------------------------

view = face_broadside(scene.points)
figure = Figure(figsize=(8, 6), layout="constrained")
left, right = figure.subplots(1, 2, sharex=True, sharey=True)
seen = view.project(scene.points)
left.scatter(seen[:, 0], seen[:, 1], c=seen[:, 2], s=1, cmap="Greys_r", linewidths=0)
left.set_title("the scan")
right.scatter(seen[:, 0], seen[:, 1], color="#cccccc", s=1, linewidths=0)
colors = ("#0072B2", "#E69F00", "#009E73", "#CC79A7")
for (name, registration), color in zip(found, colors, strict=False):
    placed = view.project(apply(registration.T_target_source, models[name].points))
    right.scatter(placed[:, 0], placed[:, 1], color=color, s=0.5, linewidths=0, label=name)
figure.legend(loc="outside lower center", ncols=4, markerscale=12, frameon=False)
right.set_title("the models found")
for axes in (left, right):
    axes.set_aspect("equal")
    axes.set_axis_off()
figure.savefig("recognition.png")
