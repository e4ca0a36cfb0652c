"""Nuisances: noise, lower density, less overlap, more occlusion and clutter.

`add_noise` and `decimate` change a cloud, `apply_nuisance` the target of a pair ("overlap": both clouds).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from cgroup import features
from cgroup._checks.calls import load_plugin
from cgroup._checks.values import as_choice, as_instance, as_number, as_word, guess_word, refuse_word
from cgroup.datasets.base import MatchingPair, mean_resolution, voxel_subset
from cgroup.datasets.generated.stones import random_direction, stones_around
from cgroup.errors import InputError
from cgroup.evaluation import overlap
from cgroup.evaluation.ground_truth import OVERLAP_WITHIN, VISIBLE_WITHIN
from cgroup.features import within
from cgroup.rigid import apply
from cgroup.types import AnyCloud, BoolArray, PointCloud
from cgroup.types.point_cloud import as_cloud

Nuisance: TypeAlias = Callable[[MatchingPair, float, np.random.Generator], MatchingPair]

__all__ = ["LEAST_POINTS", "NUISANCES", "add_noise", "apply_nuisance", "decimate"]

LEAST_POINTS = 100
"""A nuisance that would leave fewer points than this is refused."""


def add_noise(cloud: AnyCloud, sigma: float, rng: np.random.Generator) -> PointCloud:
    """Move every point by Gaussian noise along x, y and z.

    Parameters
    ----------
    cloud : PointCloud or (N,3) array_like of float
        Not changed.
    sigma : float
        Standard deviation along each axis, in the data's unit.
    rng : numpy.random.Generator
        Source of the noise.

    Returns
    -------
    PointCloud
        In the same order; faces and colours kept, stored normals dropped because they no longer fit.
    """
    cloud, deviation = as_cloud("cloud", cloud), as_number("sigma", sigma)
    if not (np.isfinite(deviation) and deviation >= 0):
        raise InputError("sigma", deviation, "give a finite length, 0 or greater")
    noise = deviation * as_instance("rng", rng, np.random.Generator).normal(size=cloud.points.shape)
    return replace(cloud, points=cloud.points + noise, normals=None)


def decimate(
    cloud: AnyCloud, share: float, rng: np.random.Generator, *, method: Literal["random", "voxel"] = "random"
) -> PointCloud:
    """Keep a fraction of the points. Further parameters as for `add_noise`.

    Parameters
    ----------
    share : float
        Of the points that are kept, greater than 0 and at most 1.
    method : {"random", "voxel"}
        A random subset, in the cloud's order; or the means of the points in the cells of a grid whose cell
        size is chosen so that about this fraction is left.

    Returns
    -------
    PointCloud
        Without faces, and without normals and colours for "voxel".
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
    kept = np.isin(np.arange(len(cloud)), rng.choice(len(cloud), size=count, replace=False))
    return replace(cloud, faces=None).select(kept)


def apply_nuisance(name: str, pair: MatchingPair, level: float, rng: np.random.Generator) -> MatchingPair:
    """Make a pair harder. `rng` is as for `add_noise`.

    Parameters
    ----------
    name : str
        One of `NUISANCES`; or "module:function" for one from outside the package, which takes the pair, the
        level and the generator and returns a pair.
    pair : MatchingPair
        Not changed.
    level : float
        For "noise" the standard deviation along each axis, in resolutions of the target; for "density" and
        "voxel-density" the fraction of points kept; for "overlap" the fraction of the smaller cloud, within 4
        resolutions; for "occlusion" the hidden fraction of the source, and for "clutter" the fraction of
        the target's points that are not on the source, both within 2 resolutions.

    Returns
    -------
    MatchingPair
        With the same name and pose; facts that change are brought up to date.
    """
    word = as_word("name", name)
    nuisance: Nuisance | None = load_plugin("nuisance", word) if ":" in word else NUISANCES.get(word)
    if nuisance is None:
        refuse_word("nuisance", name, NUISANCES, guess_word(name, NUISANCES), ", or give module:function")
    pair, level = as_instance("pair", pair, MatchingPair), as_number("level", level)
    return nuisance(pair, level, as_instance("rng", rng, np.random.Generator))


def _noise(pair: MatchingPair, level: float, rng: np.random.Generator) -> MatchingPair:
    sigma = level * features.resolution(pair.target.points)
    return replace(pair, target=add_noise(pair.target, sigma, rng), facts={**pair.facts, "noise": level})


def _overlap(pair: MatchingPair, level: float, rng: np.random.Generator) -> MatchingPair:
    """Cut the same fraction off both clouds, from opposite sides, to reach an overlap."""
    _check_share("overlap", level)
    direction = random_direction(rng)
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
    clouds = cut_pair.source.points, cut_pair.target.points
    reached = overlap(*clouds, pair.T_target_source, tolerance=tolerance)
    return replace(cut_pair, facts={**pair.facts, "overlap": reached})


def _occlusion(pair: MatchingPair, level: float, rng: np.random.Generator) -> MatchingPair:
    """Cut the model's points out of the target, until a fraction of the model is hidden."""
    _check_share("occlusion", level)
    direction = random_direction(rng)
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


def _clutter(pair: MatchingPair, level: float, rng: np.random.Generator) -> MatchingPair:
    """Add generated stones around the target, as large and dense as the source."""
    _check_share("clutter", level)
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
    "noise": _noise,
    "density": lambda pair, level, rng: replace(pair, target=decimate(pair.target, level, rng)),
    "voxel-density": lambda pair, level, rng: replace(
        pair, target=decimate(pair.target, level, rng, method="voxel")
    ),
    "overlap": _overlap,
    "occlusion": _occlusion,
    "clutter": _clutter,
}
"""What `apply_nuisance` knows by name."""


def _keep(cloud: PointCloud, keep: BoolArray) -> PointCloud:
    _check_left(int(np.count_nonzero(keep)), "the level")
    kept = cloud.select(keep)
    return kept if kept.faces is not None and len(kept.faces) else replace(kept, faces=None)


def _check_share(name: str, level: float) -> None:
    if not 0 < level < 1:
        raise InputError(name, level, "give a share above 0 and below 1")


def _check_left(count: int, cause: str) -> None:
    if count < LEAST_POINTS:
        raise InputError(f"{cause} leaves {count} points; matching needs at least {LEAST_POINTS}")
