"""The front end: keypoints, frames, descriptors and matches of point clouds.

The steps are those of J. Yang, K. Xian, P. Wang, Y. Zhang, TPAMI 2019, section 4.1, each usable alone.

Points are (N,3) in any unit and finite; lengths are in that unit. Keypoints are row numbers of the cloud.
"Within a radius" means nearer than it, as in PCL. Points that coincide count once, except in the means of
voxels and in meshes; a keypoint is the first row of those that coincide. Make a `Cloud` of the points for
several steps. All functions but those of meshes take ``threads``; results do not depend on it.
"""

from cgroup.features.cloud import Cloud, CloudLike, resolution, within
from cgroup.features.descriptors import DescribedCloud, fpfh, lfsh, rcs, shot, shot_lrf, toldi_lrf
from cgroup.features.keypoints import SUPPORT_RADIUS, drop_isolated, harris3d, iss
from cgroup.features.matching import Matches, match
from cgroup.features.meshes import sample_mesh
from cgroup.features.surface import ORIGIN, Viewpoint, mesh_normals, normals
from cgroup.features.voxels import Voxels, choose_voxel, voxel_downsample

__all__ = [
    "ORIGIN", "SUPPORT_RADIUS", "Cloud", "CloudLike", "DescribedCloud", "Matches", "Viewpoint", "Voxels",
    "choose_voxel", "drop_isolated", "fpfh", "harris3d", "iss", "lfsh", "match", "mesh_normals", "normals",
    "rcs", "resolution", "sample_mesh", "shot", "shot_lrf", "toldi_lrf", "voxel_downsample", "within",
]  # fmt: skip
