"""
A front end of your own
=======================

Compute matches step by step. Replace any step by your own code.
"""

import cgroup
from cgroup import features
from cgroup.datasets import standin_pair
from cgroup.evaluation import correct_matches, score_group
from cgroup.plots import registration_figure

# %%
# Clouds, keypoints, frames, descriptors
# --------------------------------------

pair = standin_pair()
clouds = [features.Cloud(cloud.points) for cloud in (pair.source, pair.target)]
pr = sum(features.resolution(cloud) for cloud in clouds) / 2

keypoints = [features.iss(cloud, resolution=pr) for cloud in clouds]
frames = [
    features.shot_lrf(cloud, rows, radius=15 * pr) for cloud, rows in zip(clouds, keypoints, strict=True)
]
descriptors = [
    features.shot(cloud, features.normals(cloud), rows, radius=15 * pr, lrf=lrf)
    for cloud, rows, lrf in zip(clouds, keypoints, frames, strict=True)
]
# %%
# Matches, and the group
# ----------------------

matches = features.match(*descriptors)

correspondences = cgroup.Correspondences(
    clouds[0].points[keypoints[0][matches.source_indices]],
    clouds[1].points[keypoints[1][matches.target_indices]],
    similarity=matches.similarity,
    ratio=matches.ratio,
    source_lrf=frames[0][matches.source_indices],
    target_lrf=frames[1][matches.target_indices],
    resolution=pr,
    source_centroid=clouds[0].points.mean(axis=0),
)
group = cgroup.group(correspondences, "ransac", tolerance=3 * pr)

# %%
# Score
# -----

correct = correct_matches(
    correspondences.source, correspondences.target, pair.T_target_source, tolerance=5 * pr
)
score = score_group(group.mask, correct)
print(f"{group.size} of {len(correspondences)} matches grouped, {100 * score.precision:.0f} % correct")

figure = registration_figure(
    clouds[0].points,
    clouds[1].points,
    correspondences,
    mask=group.mask,
    T_target_source=group.transform(),
    title="Grouped by RANSAC",
)
figure.savefig("own_front_end.png")
