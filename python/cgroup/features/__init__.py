"""The front end: from a point cloud to keypoints, frames, descriptors and matches.

The steps of the paper (J. Yang, K. Xian, P. Wang, Y. Zhang, TPAMI 2019, section 4.1), each usable alone:

============  ==========================================================================
cloud         `Cloud`: points checked and indexed once for all steps
unit          `resolution`: the paper's *pr*
downsampling  `voxel_downsample`, `choose_voxel`
surface       `normals` (plane fits), `mesh_normals`, `sample_mesh`
detectors     `harris3d`, `iss`; `drop_isolated` removes keypoints without support
frames        `shot_lrf`, `toldi_lrf`
descriptors   `shot` (352 numbers), `lfsh` (30), `rcs` (72), `fpfh` (33)
matching      `match`
============  ==========================================================================

Points are (N,3) in any unit and finite; lengths are in that unit. Keypoints are row numbers of the cloud.
"Within a radius" means nearer than it, as in PCL. Points that coincide count once, except in the means of
voxels and in meshes; a keypoint is the first row of those that coincide. Make a `Cloud` of the points for
several steps. All functions but those of meshes take ``threads``; results do not depend on it.

>>> import numpy as np
>>> from cgroup import features
>>> rng = np.random.default_rng(0)
>>> xy = rng.uniform(size=(4000, 2))
>>> height = 0.1 * np.sin(9 * xy[:, 0]) * np.cos(7 * xy[:, 1])
>>> points = np.column_stack([xy, height])
>>> cloud = features.Cloud(points)
>>> pr = features.resolution(cloud)
>>> keypoints = features.harris3d(cloud, resolution=pr, threshold=1e-6)
>>> normals = features.normals(cloud, viewpoint=(0, 0, 9))
>>> descriptors = features.shot(cloud, normals, keypoints, radius=15 * pr)
>>> matches = features.match(descriptors, descriptors)
>>> bool((matches.source_indices == matches.target_indices).all())
True
"""

from __future__ import annotations

from cgroup.features.cloud import Cloud, CloudLike, resolution
from cgroup.features.descriptors import DescribedCloud, fpfh, lfsh, rcs, shot, shot_lrf, toldi_lrf
from cgroup.features.keypoints import SUPPORT_RADIUS, drop_isolated, harris3d, iss
from cgroup.features.matching import Matches, match
from cgroup.features.meshes import sample_mesh
from cgroup.features.surface import ORIGIN, Viewpoint, mesh_normals, normals
from cgroup.features.voxels import Voxels, choose_voxel, voxel_downsample

__all__ = [
    "ORIGIN",
    "SUPPORT_RADIUS",
    "Cloud",
    "CloudLike",
    "DescribedCloud",
    "Matches",
    "Viewpoint",
    "Voxels",
    "choose_voxel",
    "drop_isolated",
    "fpfh",
    "harris3d",
    "iss",
    "lfsh",
    "match",
    "mesh_normals",
    "normals",
    "rcs",
    "resolution",
    "sample_mesh",
    "shot",
    "shot_lrf",
    "toldi_lrf",
    "voxel_downsample",
]
