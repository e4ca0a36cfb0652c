"""Points between the rings of a scan whose beams are known."""

import numpy as np

from .result import FloatArray

STEP, MOST_STEPS, GRAZING = 1.5, 12, 0.05


def fill_between_rings(beams: FloatArray) -> FloatArray:
    """Return the points on lines between adjacent beams (B,n,3), lowest first, seen from the origin."""
    around = np.arctan2(beams[..., 1], beams[..., 0])
    ranges = np.linalg.norm(beams, axis=2)
    upwards = np.arcsin(beams[..., 2] / ranges)
    spacing = 2 * np.pi / beams.shape[1]
    filled = []
    for k, point in ((k, point) for k in range(len(beams) - 1) for point in range(beams.shape[1])):
        apart = np.abs((around[k + 1] - around[k, point] + np.pi) % (2 * np.pi) - np.pi)
        other = int(apart.argmin())
        start, end = beams[k, point], beams[k + 1, other]
        length, near = np.linalg.norm(end - start), min(ranges[k, point], ranges[k + 1, other])
        if near * np.sin(abs(upwards[k + 1, other] - upwards[k, point])) <= GRAZING * length:
            continue
        steps = min(np.ceil(length / (STEP * spacing * near)), MOST_STEPS + 1)
        filled += [start + step / steps * (end - start) for step in range(1, int(steps))]
    return np.array(filled)
