"""Files: point clouds, rigid transforms, correspondences, targets.

Point clouds are parsed without other libraries, but for depth images in PNG (``cgroup[scans]``). Files may
come from anywhere: any fault of a file raises one `InputError` that names it.
"""

from cgroup.io.clouds import read_cloud, read_descriptors, write_cloud, write_descriptors, write_keypoints
from cgroup.io.colmap import ColmapModel, read_colmap, write_colmap
from cgroup.io.correspondences import read_correspondences, write_correspondences, write_mask
from cgroup.io.depth import read_depth
from cgroup.io.files import write_file
from cgroup.io.las import merge_files
from cgroup.io.moved import transform_file
from cgroup.io.targets import read_targets
from cgroup.io.transforms import read_transform, read_transforms, write_transform
from cgroup.rigid import RIGID_TOLERANCE, check_rigid
from cgroup.types import PointCloud

__all__ = [
    "RIGID_TOLERANCE", "ColmapModel", "PointCloud", "check_rigid", "merge_files", "read_cloud", "read_colmap",
    "read_correspondences", "read_depth", "read_descriptors", "read_targets", "read_transform",
    "read_transforms", "transform_file", "write_cloud", "write_colmap", "write_correspondences",
    "write_descriptors", "write_file", "write_keypoints", "write_mask", "write_transform",
]  # fmt: skip
