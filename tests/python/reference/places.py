"""Where the points of a surface come to lie under a pose, by brute force in double precision.

0 unknown, 1 on the other surface, 2 near it, 3 in front of what its scanner saw, 4 before its background.
"""

import numpy as np
from numpy.typing import NDArray

from reference.verification import ALONG, COSINE, DOUBT, FACING, IN_FRONT, TOLERANCE, Surface, look, nearest

FloatArray = NDArray[np.float64]


def places(source: Surface, target: Surface, pose: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Place of each point, and whether single precision may decide otherwise."""
    rotation = pose[:3, :3]
    moved = (
        source.points @ rotation.T + (rotation @ source.center + pose[:3, 3] - target.center) / source.unit
    )
    normals = source.normals @ rotation.T
    index, near, doubt = nearest(target, moved)
    d = moved - target.points[index]
    plane = (d * target.normals[index]).sum(axis=1)
    error = np.sqrt(plane**2 + ALONG * (d**2).sum(axis=1))
    cosine = (normals * target.normals[index]).sum(axis=1)
    if not (source.oriented and target.oriented):
        cosine = np.abs(cosine)
    doubt |= near & ((np.abs(cosine - COSINE) < DOUBT) | (np.abs(error - TOLERANCE) < DOUBT))
    found = np.where(near, np.where((error < TOLERANCE) & (cosine > COSINE), 1, 2), 0)
    if target.eye is not None:
        in_front, _, unsure = look(target.points, target.eye, moved, normals)
        far = np.where(np.isinf(in_front), 4, np.where(in_front > IN_FRONT, 3, 0))
        found = np.where(near, found, far)
        doubt |= ~near & (unsure | (np.abs(in_front - IN_FRONT) < DOUBT))
        behind, facing, unsure = look(moved, target.eye, moved, normals)
        found[(facing <= FACING) | (behind < -IN_FRONT)] = 0
        doubt |= unsure | (np.abs(facing - FACING) < DOUBT) | (np.abs(behind + IN_FRONT) < DOUBT)
    found[~source.normals.any(axis=1)] = 0
    return found, doubt
