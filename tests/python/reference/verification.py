"""Scores of poses on surfaces: agreement less violations, both ways, by brute force in double precision.

The nearest point of a place is, by definition, that nearest to the centre of its cell (1 unit wide, counted from the
least coordinates less 5 units) within 4 units of the centre. Places so close to a cell's border, to a threshold or to another
nearest point that single precision may decide otherwise are counted: they bound how far two scores may differ.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .own_axes import own_axes
from .result import BoolArray, FloatArray

CELL, REACH = 1.0, 4.0
TOLERANCE, IN_FRONT, COSINE = 2.0, 3.0, 0.8
ALONG, BACKGROUND, FACING, PIXEL = 0.15, 0.3, 0.3, 2.5
DOUBT = 2e-3


@dataclass
class Surface:
    """Points relative to their mean in units, along their own axes, unit normals (zero for none), the viewpoint likewise."""

    axes: FloatArray
    center: FloatArray
    points: FloatArray
    normals: FloatArray
    eye: FloatArray | None
    oriented: bool
    unit: float


def surface(
    points: FloatArray,
    normals: FloatArray,
    *,
    unit: float,
    viewpoint: FloatArray | None = None,
    oriented: bool = False,
) -> Surface:
    axes, center = own_axes(points), points.mean(axis=0)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    known = np.isfinite(length) & (length > 0)
    directions = np.where(known, normals / np.where(known, length, 1), 0)
    eye = None if viewpoint is None else axes @ (np.asarray(viewpoint) - center) / unit
    local = (points - center) @ axes.T / unit, directions @ axes.T
    return Surface(axes, center, *local, eye, oriented or eye is not None, unit)


def score(source: Surface, target: Surface, pose: FloatArray) -> tuple[float, float]:
    rotation, shift = in_units(source, target, pose)
    there = one_way(source, target, rotation, shift)
    back = one_way(target, source, rotation.T, -rotation.T @ shift)
    return there[0] + back[0], there[1] + back[1]


def in_units(source: Surface, target: Surface, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
    shift = pose[:3, :3] @ source.center + pose[:3, 3] - target.center
    return target.axes @ pose[:3, :3] @ source.axes.T, target.axes @ shift / source.unit


def one_way(from_: Surface, to: Surface, rotation: FloatArray, shift: FloatArray) -> tuple[float, float]:
    """Mean over the samples of one surface (all points with a normal), and the doubt."""
    has_normal = from_.normals.any(axis=1)
    places, normals, near, squares, cosine, doubt = meet(from_, to, rotation, shift)
    values = np.where(near & (squares < TOLERANCE**2) & (cosine > COSINE), 1 - squares / TOLERANCE**2, 0)
    if to.eye is not None:
        seen, unsure = sight(to, places, normals)
        values[~near] = seen[~near]
        doubt |= ~near & unsure
    return float(values[has_normal].mean()), 1e-4 + 2.3 * float(doubt[has_normal].mean())


def meet(
    from_: Surface, to: Surface, rotation: FloatArray, shift: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray, FloatArray, BoolArray]:
    """Moved points and normals, whether a point is near, squared distance and cosine to it, and the doubt."""
    places, normals = from_.points @ rotation.T + shift, from_.normals @ rotation.T
    index, near, doubt = nearest(to, places)
    d = places - to.points[index]
    squares = (d * to.normals[index]).sum(axis=1) ** 2 + ALONG * (d**2).sum(axis=1)
    cosine = (normals * to.normals[index]).sum(axis=1)
    if not (from_.oriented and to.oriented):
        cosine = np.abs(cosine)
    return places, normals, near, squares, cosine, doubt | near & (np.abs(cosine - COSINE) < DOUBT)


def nearest(to: Surface, places: FloatArray) -> tuple[NDArray[np.intp], BoolArray, BoolArray]:
    """Row of the nearest point, whether there is one, and whether that is in doubt."""
    low = to.points.min(axis=0) - REACH - CELL
    cells = (places - low) / CELL
    centers = (np.floor(cells) + 0.5) * CELL + low
    distances = np.linalg.norm(centers[:, None] - to.points, axis=2)
    ordered = np.sort(distances, axis=1)
    doubt = (np.abs(cells - np.round(cells)) < DOUBT).any(axis=1)
    doubt |= np.abs(ordered[:, 0] - REACH) < DOUBT
    doubt |= (ordered[:, 1] - ordered[:, 0] < DOUBT) & (ordered[:, 0] < REACH)
    return distances.argmin(axis=1), ordered[:, 0] < REACH, doubt


def project(points: FloatArray, eye: FloatArray, scale: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Faces of a cube around the viewpoint, pixels on them (fractions kept), ranges."""
    d = points - eye
    axis = np.abs(d).argmax(axis=1)
    main = np.take_along_axis(d, axis[:, None], axis=1)[:, 0]
    other = [np.take_along_axis(d, ((axis + k) % 3)[:, None], axis=1)[:, 0] for k in (1, 2)]
    pixels = np.stack(other, axis=1) * (scale / np.abs(main))[:, None]
    return 2 * axis + (main < 0), pixels, np.linalg.norm(d, axis=1)


def sight(to: Surface, places: FloatArray, normals: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Violation of what the scanner saw at each place, and whether that is in doubt."""
    in_front, facing, doubt = look(to.points, to.eye, places, normals)
    is_seen = np.isfinite(in_front)
    doubt |= np.where(is_seen, np.abs(in_front - IN_FRONT) < DOUBT, np.abs(facing - FACING) < DOUBT)
    before_surface = np.where(in_front > IN_FRONT, -1.0, 0.0)
    return np.where(is_seen, before_surface, np.where(facing > FACING, -BACKGROUND, 0.0)), doubt


def look(
    points: FloatArray, eye: FloatArray, places: FloatArray, normals: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """How far places lie in front of points (infinite: before none), how they face the eye, and the doubt."""
    ranges = np.sort(np.linalg.norm(points - eye, axis=1))
    scale = max(ranges[len(ranges) // 2] / PIXEL, 1.0)
    faces, pixels, depths = project(points, eye, scale)
    at, where, far = project(places, eye, scale)
    facing = (normals * (eye - places)).sum(axis=1) / far
    doubt = (np.abs(where - np.round(where)) < DOUBT).any(axis=1) | _near_an_edge(places - eye)
    doubt |= _near_an_edge(points - eye).any()
    # Points at the border of a pixel may be on either side of it.
    seen = [
        np.array(
            [
                depths[(faces == face) & (np.abs(rows - pixel) <= 1).all(axis=1)].min(initial=np.inf)
                for face, pixel in zip(at, np.floor(where), strict=True)
            ]
        )
        for rows in (np.floor(pixels), np.floor(pixels + DOUBT), np.floor(pixels - DOUBT))
    ]
    doubt |= (seen[0] != seen[1]) | (seen[0] != seen[2])
    return seen[0] - far, facing, doubt


def _near_an_edge(d: FloatArray) -> BoolArray:
    """Whether two faces of the cube are about as good."""
    ordered = np.sort(np.abs(d), axis=1)
    return ordered[:, 2] - ordered[:, 1] < DOUBT
