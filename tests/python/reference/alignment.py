"""The last refinement of a pose, by brute force: samples of either cloud with their planes, laid on points of the other.

All lengths are in spacings. Clouds of more than 1,000 places, of which not all are samples in every step, are not
covered: which are drawn is tested elsewhere.
"""

from dataclasses import dataclass

import numpy as np

from .neighborhood import FloatArray
from .own_axes import own_axes
from .voxels import voxel_downsample

PLANE_RADIUS, LEAST_POINTS, LEAST_WIDTH = 2.4, 6, 0.01
FIRST_REACH, LAST_REACH, FIRST_STEPS, LAST_STEPS = 3.0, 1.5, 5, 7
TUKEY, PER_MEDIAN, LEAST_DEVIATION = 4.685, 1.4826, 1e-3
LEAST_PAIRS, DAMPING, STILL = 20, 1e-6, 5e-3
OPEN = 0.01


@dataclass
class FineSurface:
    """Points, and the places among them that have a plane: foot, normal, deviation.

    Relative to the mean, in spacings, along the cloud's own axes.
    """

    axes: FloatArray
    center: FloatArray
    points: FloatArray
    feet: FloatArray
    normals: FloatArray
    deviations: FloatArray
    spacing: float


@dataclass
class Pairs:
    """Samples laid on points, in the target's frame: where, their planes' normals, distances from plane and point."""

    places: FloatArray
    normals: FloatArray
    residuals: FloatArray
    distances: FloatArray
    deviations: FloatArray


@dataclass
class Alignment:
    """What `align` gives, and whether the steps came to rest."""

    pose: FloatArray
    residuals: FloatArray
    deviations: FloatArray
    paired: float
    information: FloatArray
    resistance: float
    """Least eigenvalue of the matrix by the sum of weights, about the target's mean, rotations scaled by the radius."""
    settled: bool


def fine_surface(cloud: FloatArray, spacing: float) -> FineSurface:
    """Thin out a cloud, and fit a plane around every point."""
    axes, middle = own_axes(cloud), cloud.mean(axis=0)
    means = voxel_downsample((cloud - middle) @ axes.T, np.zeros_like(cloud), spacing)[0]
    center = means.mean(axis=0)
    points = (means - center) / spacing
    center = middle + center @ axes
    planes = [plane for point in points if (plane := _plane(point, points)) is not None]
    feet, normals, deviations = (np.array(column) for column in zip(*planes, strict=True))
    return FineSurface(axes, center, points, feet, normals, deviations, spacing)


def _plane(point: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray, float] | None:
    around = points[np.linalg.norm(points - point, axis=1) < PLANE_RADIUS]
    if len(around) < LEAST_POINTS:
        return None
    mean = around.mean(axis=0)
    values, vectors = np.linalg.eigh(np.cov(around.T, bias=True))
    if values[1] < LEAST_WIDTH * values[2]:
        return None
    normal = vectors[:, 0]
    deviation = np.sqrt((((around - mean) @ normal) ** 2).sum() / (len(around) - 3))
    return point + normal * ((mean - point) @ normal), normal, float(deviation)


def align(source: FineSurface, target: FineSurface, pose: FloatArray) -> Alignment:
    """Point-to-plane steps both ways, with Tukey's weights and a reach that shrinks."""
    rotation, shift = in_spacings(source, target, pose)
    settled, radius = False, _radius(source, target)
    for step in range(FIRST_STEPS + LAST_STEPS):
        share = min(step / FIRST_STEPS, 1.0)
        reach = FIRST_REACH + (LAST_REACH - FIRST_REACH) * share
        pairs = pair(source, target, rotation, shift, reach)
        if len(pairs.residuals) < LEAST_PAIRS:
            break
        jacobian, weights = equations(pairs, reach)
        matrix = jacobian.T @ (weights[:, None] * jacobian)
        right = -jacobian.T @ (weights * pairs.residuals)
        motion = np.linalg.solve(matrix + DAMPING * matrix.diagonal().max() * np.eye(6), right)
        turn = rotation_of(motion[:3])
        rotation, shift = turn @ rotation, turn @ shift + motion[3:]
        moved = radius * np.linalg.norm(motion[:3]) + np.linalg.norm(motion[3:])
        settled = share >= 1 and bool(moved < STILL)
        if settled:
            break
    return _alignment(source, target, rotation, shift, settled=settled)


def in_spacings(source: FineSurface, target: FineSurface, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation and shift from the frame of one surface into that of the other."""
    shift = pose[:3, :3] @ source.center + pose[:3, 3] - target.center
    return target.axes @ pose[:3, :3] @ source.axes.T, target.axes @ shift / target.spacing


def _radius(source: FineSurface, target: FineSurface) -> float:
    """Root mean square distance of the samples from the mean, of the wider surface."""
    return float(max(np.sqrt((surface.feet**2).sum(axis=1).mean()) for surface in (source, target)))


def pair(
    source: FineSurface, target: FineSurface, rotation: FloatArray, shift: FloatArray, reach: float
) -> Pairs:
    """Samples of both surfaces that have a point of the other within reach."""
    feet, near = source.feet @ rotation.T + shift, (target.feet - shift) @ rotation
    there, back = _nearest(feet, target.points), _nearest(near, source.points)
    places = np.concatenate([feet, back @ rotation.T + shift])
    fixed = np.concatenate([there, target.feet])
    normals = np.concatenate([source.normals @ rotation.T, target.normals])
    deviations = np.concatenate([source.deviations, target.deviations])
    offsets = places - fixed
    distances = np.linalg.norm(offsets, axis=1)
    residuals = (offsets * normals).sum(axis=1)
    kept = distances < reach
    return Pairs(places[kept], normals[kept], residuals[kept], distances[kept], deviations[kept])


def plane_distances(
    source: FineSurface, target: FineSurface, rotation: FloatArray, shift: FloatArray
) -> FloatArray:
    """Distances of the nearest points from the planes of the source's samples; NaN beyond the first reach."""
    feet = source.feet @ rotation.T + shift
    offsets = _nearest(feet, target.points) - feet
    distances = np.abs((offsets * (source.normals @ rotation.T)).sum(axis=1))
    return np.where(np.linalg.norm(offsets, axis=1) < FIRST_REACH, distances, np.nan)


def _nearest(places: FloatArray, points: FloatArray) -> FloatArray:
    return points[np.linalg.norm(places[:, None] - points, axis=2).argmin(axis=1)]


def equations(pairs: Pairs, reach: float) -> tuple[FloatArray, FloatArray]:
    """Change of the residuals with a rotation vector about the target's mean and a translation; weights of the pairs."""
    jacobian = np.hstack([np.cross(pairs.places, pairs.normals), pairs.normals])
    sizes = np.sort(np.abs(pairs.residuals))
    cut = TUKEY * max(PER_MEDIAN * sizes[len(sizes) // 2], LEAST_DEVIATION)
    robust = np.maximum(1 - (pairs.residuals / cut) ** 2, 0) ** 2
    return jacobian, (1 - (pairs.distances / reach) ** 2) * robust


def rotation_of(vector: FloatArray) -> FloatArray:
    angle = np.linalg.norm(vector)
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def _alignment(
    source: FineSurface, target: FineSurface, rotation: FloatArray, shift: FloatArray, *, settled: bool
) -> Alignment:
    unit, pairs = target.spacing, pair(source, target, rotation, shift, FIRST_REACH)
    pose = np.eye(4)
    pose[:3, :3] = target.axes.T @ rotation @ source.axes
    pose[:3, 3] = target.axes.T @ shift * unit + target.center - pose[:3, :3] @ source.center
    samples = len(source.feet) + len(target.feet)
    paired, residuals, deviations = (
        len(pairs.residuals) / samples,
        pairs.residuals * unit,
        pairs.deviations * unit,
    )
    near = pair(source, target, rotation, shift, LAST_REACH)
    if len(near.residuals) == 0:
        return Alignment(pose, residuals, deviations, paired, np.zeros((6, 6)), 0.0, settled)
    jacobian, weights = equations(near, LAST_REACH)
    scaled = jacobian / np.array([_radius(source, target)] * 3 + [1.0] * 3)
    resistance = np.linalg.eigvalsh(scaled.T @ (weights[:, None] * scaled))[0] / weights.sum()
    # About the target's own origin, in the unit of the data.
    places, normals = near.places @ target.axes * unit + target.center, near.normals @ target.axes
    jacobian = np.hstack([np.cross(places, normals), normals])
    information = jacobian.T @ (weights[:, None] * jacobian)
    return Alignment(pose, residuals, deviations, paired, information, resistance, settled)
