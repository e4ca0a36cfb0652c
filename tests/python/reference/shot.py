"""SHOT-352 with PCL's additive interpolation.

Written per dimension: the centre of a neighbour's own bin, its distance from there in bins, and the bin on
the side it leans to. A neighbour gives its own bin one minus each distance, and the other bin the distance.
"""

import numpy as np

from .neighborhood import FloatArray, ball
from .shot_lrf import shot_lrf

HISTOGRAM = (8, 2, 2, 11)  # sectors of azimuth, shells, halves in elevation, steps of cosine


def shot(
    points: FloatArray,
    normals: FloatArray,
    keypoint: int,
    *,
    radius: float,
    lrf: FloatArray | None = None,
    pcl_compat: bool = True,
) -> FloatArray:
    """Descriptor (352,) of one keypoint, of unit length; NaN where it is undefined."""
    frame = shot_lrf(points, keypoint, radius=radius) if lrf is None else lrf
    rows = ball(points, keypoint, radius)
    if np.isnan(frame).any() or len(rows) < 5:
        return np.full(352, np.nan)
    histogram = np.zeros(HISTOGRAM)
    for row in rows:
        x, y, z = frame @ (points[row] - points[keypoint])
        distance = np.sqrt(x * x + y * y + z * z)
        if distance == 0 or not np.isfinite(normals[row]).all():
            continue
        add(
            histogram,
            (x, y, z),
            distance / radius,
            float(np.clip(frame[2] @ normals[row], -1, 1)),
            pcl_compat,
        )
    norm = np.linalg.norm(histogram)
    return (histogram / norm if norm > 0 else histogram).ravel()


def add(
    histogram: FloatArray, place: tuple[float, float, float], distance: float, cosine: float, pcl_compat: bool
) -> None:
    """Add one neighbour; `distance` in radii."""
    x, y, z = place
    azimuth = (np.degrees(np.arctan2(y, x)) + 180) / 45  # in sectors
    elevation = np.degrees(np.arccos(np.clip(z / np.sqrt(x * x + y * y + z * z), -1, 1)))
    sector = min(int(azimuth), 7)
    shell = int(distance > 0.5)
    upper = int(z > 0)
    step = int(np.floor(5 * (1 + cosine) + 0.5))
    home = 0.0

    lean = 5 * (1 + cosine) - step
    other = step + 1 if lean > 0 else step - 1
    if pcl_compat:
        other %= 10  # sic: PCL wraps the eleven steps modulo ten
    home += 1 - abs(lean)
    histogram[sector, shell, upper, min(other, 10)] += abs(lean)

    lean = (distance - (0.75 if shell else 0.25)) / 0.5
    home += 1 - abs(lean)
    if (lean < 0 and shell) or (lean >= 0 and not shell):
        histogram[sector, 1 - shell, upper, step] += abs(lean)

    lean = (elevation - (45 if upper else 135)) / 90
    home += 1 - abs(lean)
    if (lean > 0 and upper) or (lean <= 0 and not upper):
        histogram[sector, shell, 1 - upper, step] += abs(lean)

    if x != 0 or y != 0:
        lean = np.clip(azimuth - sector - 0.5, -0.5, 0.5)
        home += 1 - abs(lean)
        histogram[(sector + (1 if lean > 0 else -1)) % 8, shell, upper, step] += abs(lean)
    histogram[sector, shell, upper, step] += home
