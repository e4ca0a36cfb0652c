"""Ground truth from the true pose: correct matches, pose errors, overlap of two views."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.arrays import as_faces, as_points, finite_points
from cgroup._checks.values import as_length
from cgroup.errors import InputError
from cgroup.features import within
from cgroup.rigid import apply, check_rigid
from cgroup.types import AnyCloud, BoolArray, FloatArray, IndexArray

CORRECT_WITHIN = 5.0  # largest distance of a correct match from its true place, in pr
OVERLAP_WITHIN = 4.0  # largest distance of overlapping points of two views, in pr
VISIBLE_WITHIN = 2.0  # largest distance of a scene vertex from the model it belongs to, in pr


def match_errors(source: AnyCloud, target: AnyCloud, T_target_source: ArrayLike) -> FloatArray:
    """Return the distance of each match from its true place, ``|R p + t - p'|``.

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    T_target_source : (4,4) array_like of float
        True pose.

    Returns
    -------
    (n,) array of float64
        In the data's unit.
    """
    moved = apply(check_rigid(T_target_source, "T_target_source"), as_points("source", source))
    there = as_points("target", target)
    if len(moved) != len(there):
        raise InputError("target", f"{len(there)} rows, `source` has {len(moved)}")
    with np.errstate(invalid="ignore", over="ignore"):  # points that aren't finite have no distance
        return np.linalg.norm(moved - there, axis=1)


def correct_matches(
    source: AnyCloud, target: AnyCloud, T_target_source: ArrayLike, *, tolerance: float
) -> BoolArray:
    """Return the mask of correct matches: ``|R p + t - p'|`` <= tolerance.

    Further parameters as for `match_errors`.

    Parameters
    ----------
    tolerance : float
        In the data's unit; 5 times the resolution is usual.

    Returns
    -------
    (n,) array of bool
        Aligned with the matches.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.evaluation import correct_matches
    >>> correct_matches(np.eye(3), np.eye(3) * [1, 1, 2], np.eye(4), tolerance=0.5)
    array([ True,  True, False])
    """
    limit = as_length("tolerance", tolerance)
    return match_errors(source, target, T_target_source) <= limit


def overlap(source: AnyCloud, target: AnyCloud, T_target_source: ArrayLike, *, tolerance: float) -> float:
    """Return the fraction of the smaller view that the other view contains.

    Points overlap that have a point of the other view within the tolerance under the true pose. They are
    counted in both directions; the smaller count is divided by the size of the smaller view.

    Parameters
    ----------
    source, target : (N,3) and (M,3) array_like of float
        Whole clouds.
    T_target_source : (4,4) array_like of float
        True pose.
    tolerance : float
        In the data's unit; 4 times the resolution is usual.

    Returns
    -------
    float
        0 to 1.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.evaluation import overlap
    >>> view = np.column_stack([np.arange(10.0), np.zeros((10, 2))])
    >>> overlap(view[:8], view[4:], np.eye(4), tolerance=0.5)
    0.6666666666666666
    """
    moved = apply(check_rigid(T_target_source, "T_target_source"), finite_points("source", source))
    there = finite_points("target", target)
    for name, points in (("source", moved), ("target", there)):
        if len(points) == 0:
            raise InputError(name, "no points")
    limit = as_length("tolerance", tolerance)
    common = min(within(moved, there, limit).sum(), within(there, moved, limit).sum())
    return float(common / min(len(moved), len(there)))


def alignment_error(
    source: AnyCloud, target: AnyCloud, estimated: ArrayLike, true: ArrayLike, *, tolerance: float
) -> float:
    """Return the mean displacement in the overlap; clouds are as for `overlap`.

    Parameters
    ----------
    estimated, true : (4,4) array_like of float
        Poses of the source in the target's frame.
    tolerance : float
        Largest distance of overlapping source points from the target under the true pose, in the data's unit.

    Returns
    -------
    float
        Mean distance of the source points in the data's unit; NaN without overlap.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.evaluation import alignment_error
    >>> shifted = np.eye(4)
    >>> shifted[0, 3] = 0.25
    >>> alignment_error(np.eye(3), np.eye(3), shifted, np.eye(4), tolerance=0.1)
    0.25
    """
    points, limit = finite_points("source", source), as_length("tolerance", tolerance)
    expected = apply(check_rigid(true, "true"), points)
    reached = apply(check_rigid(estimated, "estimated"), points)
    counted = within(expected, finite_points("target", target), limit)
    return _mean_length(reached[counted] - expected[counted])


def mean_displacement(points: AnyCloud, estimated: ArrayLike, true: ArrayLike) -> float:
    """Return the mean distance of points under a pose from their true places; NaN without points."""
    # Unlike the translation error it is independent of the origin.
    array = as_points("points", points)
    if len(array) == 0:
        return float("nan")
    reached, expected = check_rigid(estimated, "estimated"), check_rigid(true, "true")
    return _mean_length(apply(reached, array) - apply(expected, array))


def clutter_and_occlusion(
    model: ArrayLike,
    model_faces: ArrayLike,
    scene: ArrayLike,
    scene_faces: ArrayLike,
    T_scene_model: ArrayLike,
    *,
    tolerance: float,
) -> tuple[float, float]:
    """Return clutter (fraction of a scene outside the model) and occlusion.

    Parameters
    ----------
    model : (N,3) array_like of float
        Vertices of the model's mesh.
    model_faces : (K,3) array_like of int
        Its triangles, as rows of its vertices.
    scene : (M,3) array_like of float
        Vertices of the scene's mesh.
    scene_faces : (L,3) array_like of int
        Its triangles, as rows of its vertices.
    T_scene_model : (4,4) array_like of float
        True pose of the model in the scene.
    tolerance : float
        Largest distance of scene vertices that belong to the model; twice the resolution is usual.

    Returns
    -------
    clutter, occlusion : float
        1 - visible / scene area, and 1 - visible / model area; the visible triangles of the scene have three
        corners that belong to the model.
    """
    posed = apply(check_rigid(T_scene_model, "T_scene_model"), finite_points("model", model))
    vertices = finite_points("scene", scene)
    triangles = _faces_of("scene", vertices, scene_faces)
    areas = triangle_areas(vertices, triangles)
    model_area = triangle_areas(posed, _faces_of("model", posed, model_faces)).sum()
    for name, area in (("scene", areas.sum()), ("model", model_area)):
        if not 0 < area < np.inf:
            raise InputError(name, remedy="its faces have no area, or one beyond all numbers")
    limit = as_length("tolerance", tolerance)
    seen = areas[within(vertices, posed, limit)[triangles].all(axis=1)].sum()
    return float(1 - seen / areas.sum()), float(1 - seen / model_area)


def _mean_length(vectors: FloatArray) -> float:
    return float(np.linalg.norm(vectors, axis=1).mean()) if len(vectors) else float("nan")


def _faces_of(name: str, vertices: FloatArray, faces: ArrayLike) -> IndexArray:
    parameter = f"{name}_faces"
    triangles = as_faces(parameter, faces)
    if triangles.max(initial=-1) >= len(vertices):
        raise InputError(parameter, f"row {triangles.max()}, but {name} has {len(vertices)} vertices")
    return triangles


def triangle_areas(vertices: FloatArray, faces: ArrayLike) -> FloatArray:
    """Return the area of each triangle, in the square of the data's unit."""
    a, b, c = (vertices[corner] for corner in np.asarray(faces, dtype=np.int64).reshape(-1, 3).T)
    with np.errstate(over="ignore"):
        return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
