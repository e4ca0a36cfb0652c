"""Nuisances: noise, lower density, less overlap.

`add_noise` and `decimate` work on clouds; `apply_nuisance`, and the functions in `NUISANCES`, on pairs: they
change the target (``overlap`` both clouds), never the pose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from cgroup import features
from cgroup._checks.hooks import load_plugin
from cgroup._checks.values import as_choice, as_instance, as_number, as_word, guess_word, refuse_word
from cgroup.datasets.base import MatchingPair, mean_resolution
from cgroup.datasets.generated.shapes import random_direction, stones_around
from cgroup.datasets.voxels import voxel_subset
from cgroup.errors import InputError
from cgroup.evaluation import overlap, within
from cgroup.evaluation.ground_truth import OVERLAP_WITHIN, VISIBLE_WITHIN
from cgroup.rigid import apply
from cgroup.types import AnyCloud, BoolArray, IndexArray, PointCloud
from cgroup.types.point_cloud import as_cloud

Nuisance: TypeAlias = Callable[[MatchingPair, float, np.random.Generator], MatchingPair]


__all__ = [
    "LEAST_POINTS",
    "NUISANCES",
    "add_noise",
    "apply_nuisance",
    "decimate",
    "density",
    "less_overlap",
    "more_clutter",
    "more_occlusion",
    "noise",
    "voxel_density",
]

LEAST_POINTS = 100
"""A nuisance that would leave fewer points than this is refused."""


def add_noise(cloud: AnyCloud, sigma: float, rng: np.random.Generator) -> PointCloud:
    """Move every point by Gaussian noise along x, y and z.

    Parameters
    ----------
    cloud : PointCloud or (N,3) array_like of float
        Left as it is.
    sigma : float
        Standard deviation along each axis, in the data's unit.
    rng : numpy.random.Generator
        Source of the noise.

    Returns
    -------
    PointCloud
        In the same order; faces and colours kept, stored normals dropped because they no longer fit.

    Raises
    ------
    InputError
        If sigma is negative or not finite, or an argument is of another type.
    """
    cloud, deviation = as_cloud("cloud", cloud), as_number("sigma", sigma)
    if not (np.isfinite(deviation) and deviation >= 0):
        raise InputError("sigma", deviation, "give a finite length, 0 or greater")
    noise = deviation * as_instance("rng", rng, np.random.Generator).normal(size=cloud.points.shape)
    return replace(cloud, points=cloud.points + noise, normals=None)


def decimate(
    cloud: AnyCloud,
    share: float,
    rng: np.random.Generator,
    *,
    method: Literal["random", "voxel"] = "random",
) -> PointCloud:
    """Keep a share of the points.

    Parameters
    ----------
    cloud : PointCloud or (N,3) array_like of float
        Left as it is.
    share : float
        Of the points that are kept, greater than 0 and at most 1.
    rng : numpy.random.Generator
        Chooses the points; "voxel" makes no use of it.
    method : {"random", "voxel"}
        A random subset, in the cloud's order; or the means of the points in the cells of a grid whose cell
        size is chosen so that about the share is left.

    Returns
    -------
    PointCloud
        Without faces, and without normals and colours for "voxel".

    Raises
    ------
    InputError
        If the share is out of range or leaves fewer than 100 points, or another argument is wrong.
    """
    as_choice("method", method, ("random", "voxel"))
    as_instance("rng", rng, np.random.Generator)
    part = as_number("share", share)
    if not 0 < part <= 1:
        raise InputError("share", part, "give the part of the points to keep, above 0 and at most 1")
    cloud = as_cloud("cloud", cloud)
    count = round(part * len(cloud))
    _check_left(count, f"share {part}")
    if method == "voxel":
        return PointCloud(voxel_subset(cloud.points, count))
    kept = np.sort(rng.choice(len(cloud), size=count, replace=False))
    return _rows(cloud, kept)


def apply_nuisance(name: str, pair: MatchingPair, level: float, rng: np.random.Generator) -> MatchingPair:
    """Make a pair harder.

    Parameters
    ----------
    name : str
        "noise", "density", "voxel-density", "overlap", "occlusion" or "clutter"; or "module:function" for one
        from outside the package, which takes the pair, the level and the generator and returns a pair.
    pair : MatchingPair
        Left as it is.
    level : float
        For noise its standard deviation, in resolutions of the target; else the share of points kept, or of
        overlap, occlusion or clutter.
    rng : numpy.random.Generator
        The only source of randomness.

    Returns
    -------
    MatchingPair
        With the same name and pose; facts that change are brought up to date.

    Raises
    ------
    InputError
        If the name is unknown, the level is out of range, or an argument is of another type.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.nuisances import apply_nuisance
    >>> pair = standin_pair(pixels=60)
    >>> dict(apply_nuisance("noise", pair, 0.5, np.random.default_rng(0)).facts)
    {'noise': 0.5}
    """
    word = as_word("name", name)
    nuisance: Nuisance | None = load_plugin("nuisance", word) if ":" in word else NUISANCES.get(word)
    if nuisance is None:
        refuse_word("nuisance", name, NUISANCES, guess_word(name, NUISANCES), ", or give module:function")
    return nuisance(*_checked(pair, level), as_instance("rng", rng, np.random.Generator))


def noise(pair: MatchingPair, level: float, rng: np.random.Generator) -> MatchingPair:
    """Add Gaussian noise to the target.

    Parameters
    ----------
    pair, level, rng : MatchingPair, float, numpy.random.Generator
        As for `apply_nuisance`; the level is the standard deviation along each axis, in resolutions of the
        clean target.

    Returns
    -------
    MatchingPair
        With the fact ``noise``.

    Raises
    ------
    InputError
        As for `apply_nuisance`.
    """
    pair, level = _checked(pair, level)
    sigma = level * features.resolution(pair.target.points)
    return replace(pair, target=add_noise(pair.target, sigma, rng), facts={**pair.facts, "noise": level})


def density(pair: MatchingPair, level: float, rng: np.random.Generator) -> MatchingPair:
    """Keep a random subset of the target.

    Parameters
    ----------
    pair, level, rng : MatchingPair, float, numpy.random.Generator
        As for `apply_nuisance`; the level is the share of the points that are kept, above 0 and at most 1.

    Returns
    -------
    MatchingPair
        With a target without faces.

    Raises
    ------
    InputError
        As for `apply_nuisance`, or if fewer than 100 points are left.
    """
    pair, level = _checked(pair, level)
    return replace(pair, target=decimate(pair.target, level, rng))


def voxel_density(pair: MatchingPair, level: float, rng: np.random.Generator) -> MatchingPair:
    """Downsample the target on a grid.

    Parameters
    ----------
    pair, level, rng : MatchingPair, float, numpy.random.Generator
        As for `apply_nuisance`; the level is the approximate share of points left, above 0 and at most 1. The
        grid alone determines the points.

    Returns
    -------
    MatchingPair
        With a target of the means of the points in each cell, alone.

    Raises
    ------
    InputError
        As for `apply_nuisance`, or if fewer than 100 points are left.
    """
    pair, level = _checked(pair, level)
    return replace(pair, target=decimate(pair.target, level, rng, method="voxel"))


def less_overlap(pair: MatchingPair, level: float, rng: np.random.Generator) -> MatchingPair:
    """Cut the same share off both clouds, from opposite sides, down to an overlap.

    Parameters
    ----------
    pair, level, rng : MatchingPair, float, numpy.random.Generator
        As for `apply_nuisance`; the level is the share of the smaller cloud that overlaps the other one,
        between 0 and 1.

    Returns
    -------
    MatchingPair
        With the fact ``overlap``, the share that is reached, at 4 resolutions; it may be below the level.

    Raises
    ------
    InputError
        As for `apply_nuisance`, or if the level exceeds the present overlap or leaves fewer than 100 points.
    """
    pair, level = _checked(pair, level, "overlap")
    direction = random_direction(as_instance("rng", rng, np.random.Generator))
    tolerance = OVERLAP_WITHIN * mean_resolution(pair.source, pair.target)
    source, target = apply(pair.T_target_source, pair.source.points), pair.target.points
    source_height, target_height = source @ direction, target @ direction
    source_shared, target_shared = within(source, target, tolerance), within(target, source, tolerance)

    def overlap_at(share: float) -> float:
        top, bottom = np.quantile(source_height, share), np.quantile(target_height, 1 - share)
        common = min(
            np.count_nonzero(source_shared & (source_height >= bottom - tolerance) & (source_height <= top)),
            np.count_nonzero(target_shared & (target_height >= bottom) & (target_height <= top + tolerance)),
        )
        return common / (share * min(len(source), len(target)))

    if overlap_at(1) < level:
        remedy = f"{pair.name} overlaps by only {overlap_at(1):.2f}; ask for less than {level}"
        raise InputError("overlap", remedy=remedy)
    low, share = 0.01, 1.0
    for _ in range(30):
        middle = (low + share) / 2
        low, share = (middle, share) if overlap_at(middle) < level else (low, middle)
    cut_pair = replace(
        pair,
        source=_keep(pair.source, source_height <= np.quantile(source_height, share)),
        target=_keep(pair.target, target_height >= np.quantile(target_height, 1 - share)),
    )
    reached = overlap(
        cut_pair.source.points, cut_pair.target.points, pair.T_target_source, tolerance=tolerance
    )
    return replace(cut_pair, facts={**pair.facts, "overlap": reached})


def more_occlusion(pair: MatchingPair, level: float, rng: np.random.Generator) -> MatchingPair:
    """Cut the model's points out of the target, up to a hidden share of the model.

    Parameters
    ----------
    pair, level, rng : MatchingPair, float, numpy.random.Generator
        As for `apply_nuisance`; the level is the approximate share of the model (source) that is hidden in
        the scene (target), between 0 and 1.

    Returns
    -------
    MatchingPair
        With the fact ``occlusion``, the share of the model's vertices with no point of the target within 2
        resolutions: exact for even density only.

    Raises
    ------
    InputError
        As for `apply_nuisance`, or if the level is below the present occlusion or leaves fewer than 100
        points.
    """
    pair, level = _checked(pair, level, "occlusion")
    direction = random_direction(as_instance("rng", rng, np.random.Generator))
    tolerance = VISIBLE_WITHIN * mean_resolution(pair.source, pair.target)
    model, scene = apply(pair.T_target_source, pair.source.points), pair.target.points
    visible = within(model, scene, tolerance)
    if 1 - visible.mean() > level:
        remedy = f"{pair.name} has {1 - visible.mean():.2f} already; ask for more than {level}"
        raise InputError("occlusion", remedy=remedy)
    heights = np.sort(model[visible] @ direction)
    edge = heights[min(round((1 - level) * len(model)), len(heights) - 1)]
    hidden = within(scene, model, tolerance) & (scene @ direction > edge)
    target = _keep(pair.target, ~hidden)
    reached = 1 - float(within(model, target.points, tolerance).mean())
    return replace(pair, target=target, facts={**pair.facts, "occlusion": reached})


def more_clutter(pair: MatchingPair, level: float, rng: np.random.Generator) -> MatchingPair:
    """Put generated stones, as large and dense as the source, around the target.

    Parameters
    ----------
    pair, level, rng : MatchingPair, float, numpy.random.Generator
        As for `apply_nuisance`; the level is the share of the target's points that are not on the model
        (source), between 0 and 1.

    Returns
    -------
    MatchingPair
        With the fact ``clutter``, which counts points: exact for even density only.

    Raises
    ------
    InputError
        As for `apply_nuisance`, or if the level is below the present clutter.
    """
    pair, level = _checked(pair, level, "clutter")
    as_instance("rng", rng, np.random.Generator)
    scene = pair.target.points
    pr = mean_resolution(pair.source, pair.target)
    own = within(scene, apply(pair.T_target_source, pair.source.points), VISIBLE_WITHIN * pr)
    missing = round(np.count_nonzero(own) / (1 - level)) - len(scene)
    if missing < 0:
        remedy = f"{pair.name} has {1 - own.mean():.2f} already; ask for more than {level}"
        raise InputError("clutter", remedy=remedy)
    stones = stones_around(missing, scene, float(np.ptp(pair.source.points, axis=0).max()), pr, rng)
    target = PointCloud(np.concatenate([scene, stones]), faces=pair.target.faces)
    return replace(pair, target=target, facts={**pair.facts, "clutter": 1 - float(own.sum() / len(target))})


NUISANCES: dict[str, Nuisance] = {
    "noise": noise,
    "density": density,
    "voxel-density": voxel_density,
    "overlap": less_overlap,
    "occlusion": more_occlusion,
    "clutter": more_clutter,
}
"""What `apply_nuisance` knows by name."""


def _keep(cloud: PointCloud, keep: BoolArray) -> PointCloud:
    """Keep some of the points, and the faces between them."""
    _check_left(int(np.count_nonzero(keep)), "the level")
    faces = cloud.faces
    if faces is not None:
        faces = (np.cumsum(keep) - 1)[faces[keep[faces].all(axis=1)]]
        faces = faces if len(faces) else None
    return replace(_rows(cloud, np.flatnonzero(keep)), faces=faces)


def _rows(cloud: PointCloud, rows: IndexArray) -> PointCloud:
    normals = None if cloud.normals is None else cloud.normals[rows]
    colors = None if cloud.colors is None else cloud.colors[rows]
    return PointCloud(cloud.points[rows], normals, None, colors, cloud.dropped)


def _checked(pair: MatchingPair, level: float, share: str = "") -> tuple[MatchingPair, float]:
    """Refuse what isn't a pair and a number; or a level that is out of range for the share of a name."""
    pair, level = as_instance("pair", pair, MatchingPair), as_number("level", level)
    if share and not 0 < level < 1:
        raise InputError(share, level, "give a share above 0 and below 1")
    return pair, level


def _check_left(count: int, cause: str) -> None:
    if count < LEAST_POINTS:
        message = f"{cause} leaves {count} points; matching needs at least {LEAST_POINTS}"
        raise InputError(message)
