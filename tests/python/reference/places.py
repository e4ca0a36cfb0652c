"""Where the points of a surface come to lie under a pose, by brute force in double precision.

0 unknown, 1 on the other surface, 2 near it, 3 in front of what its scanner saw, 4 before its background.
"""

import numpy as np
from numpy.typing import NDArray

from reference.verification import COSINE, DOUBT, FACING, IN_FRONT, TOLERANCE, Surface, in_units, look, meet

from .result import FloatArray


def places(source: Surface, target: Surface, pose: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Place of each point, and whether single precision may decide otherwise."""
    moved, normals, near, squares, cosine, doubt = meet(source, target, *in_units(source, target, pose))
    error = np.sqrt(squares)
    doubt |= near & (np.abs(error - TOLERANCE) < DOUBT)
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
