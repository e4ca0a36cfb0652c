"""Fit a similarity to two scans, and compare the best scale with 1."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cgroup import _core
from cgroup._checks.values import run_options
from cgroup.registration.judge import Found, is_accepted
from cgroup.registration.motions import OPEN
from cgroup.registration.prepare import PreparedScan
from cgroup.rigid import apply
from cgroup.rigid.se3 import motion
from cgroup.rigid.transforms import cross_products, scaling, split_scale
from cgroup.types import FloatArray

BEND = 6.0  # edge of the cells whose mean residuals show bends, in voxels
# Deviation of the scale of right poses; deviations at which half of a probability is left, and the share of
# these from which that is noted; one voxel of so many is looked at
DRIFT, CLEARLY, NOTED, SOME = 0.01, 3.0, 0.8, 3
_REACH, _LAST_REACH, _REACHED = 3.0, 1.5, 5  # voxels, and the step from which the reach stays
_STEPS, _STILL, _LEAST_PAIRS = 30, 1e-3, 50
_CUT, _PER_MEDIAN, _LEAST_DEVIATION, _DAMPING = 4.685, 1.4826, 1e-3, 1e-6  # as for `align`


class Similarity(NamedTuple):
    """A rigid pose of the source times a scale."""

    scale: float  # of the source as it was given: near 1
    pose: FloatArray  # (4,4), of the scaled source
    # how much the surfaces resist scaling while all motions are free, as a share of that of all pairs
    resistance: float
    deviation: float  # standard deviation of the scale, as a share of it


def compare_scales(found: Found | None) -> Found | None:
    """Reduce the probability of a pose if another scale fits clearly better, and store that scale.

    Half of the probability of an accepted pose is left if the scale is `CLEARLY` deviations from 1, those of
    the fit and of `DRIFT`: fragments of one room fit best at scales slightly off 1.
    """
    if found is None or not is_accepted(found.probability):
        return found
    fitted = fit_similarity(found.source, found.target, found.refined.T_target_source, every=SOME)
    if fitted is None or fitted.resistance <= OPEN:
        return found
    away = abs(float(np.log(fitted.scale))) / float(np.hypot(fitted.deviation, DRIFT)) / CLEARLY
    better = fitted.scale if away >= NOTED else 1.0
    return replace(found, better_scale=better, probability=found.probability * 0.5**away**4)


def fit_similarity(
    source: PreparedScan, target: PreparedScan, pose: FloatArray, every: int = 1
) -> Similarity | None:
    """Fit scale and pose to the voxels of both; None if too few are near each other.

    Point-to-plane steps in both directions, weighted as for `align`; the seventh unknown is the logarithm of
    the scale, about the middle of the pairs. Its deviation assumes that the mean residuals in cells of `BEND`
    voxels all pull the scale one way, as for bent surfaces. One of `every` voxels of either scan is paired.
    """
    voxel, transform, options = source.voxel, pose, run_options(source.threads)
    fixed, step = target.voxels.points, 0
    sources, targets = source.normals[::every], target.normals[::every]
    while True:
        share = min(step / _REACHED, 1.0)
        reach = voxel * (_REACH + (_LAST_REACH - _REACH) * share)
        moved = apply(transform, source.voxels.points)
        offsets = np.concatenate(
            [
                -_core.nearest(moved[::every].copy(), fixed, options, reach),
                _core.nearest(fixed[::every].copy(), moved, options, reach),
            ]
        )
        places = np.concatenate([moved[::every], fixed[::every] + offsets[len(sources) :]])
        normals = np.concatenate([sources @ split_scale(transform)[1][:3, :3].T, targets])
        paired = np.isfinite(offsets).all(axis=1) & np.isfinite(normals).all(axis=1)
        if paired.sum() < _LEAST_PAIRS:
            return None
        places, offsets, normals = places[paired], offsets[paired], normals[paired]
        middle = np.median(places, axis=0)
        arms = places - middle
        radius = np.median(np.linalg.norm(arms, axis=1))
        residuals = np.einsum("ij,ij->i", normals, offsets)
        # Most of a prism fits wherever it slides: the residuals of its ends count until the reach stays.
        least = max(_LEAST_DEVIATION * voxel, (1 - share) * reach)
        deviation = max(_PER_MEDIAN * float(np.median(np.abs(residuals))), least)
        weights = np.maximum(1 - (offsets**2).sum(axis=1) / reach**2, 0)
        weights *= np.maximum(1 - (residuals / (_CUT * deviation)) ** 2, 0) ** 2
        outwards = np.einsum("ij,ij->i", normals, arms)[:, None]
        rows = np.concatenate([cross_products(arms, normals) / radius, normals, outwards / radius], axis=1)
        matrix = rows.T @ (weights[:, None] * rows)
        damped = matrix + _DAMPING * matrix.diagonal().max() * np.eye(7)
        change = -np.linalg.solve(damped, rows.T @ (weights * residuals))
        turned = motion(np.append(change[:3] / radius, change[3:6]), middle)
        transform = turned @ scaling(float(np.exp(change[6] / radius)), middle) @ transform
        resisted = 1.0 / (np.linalg.inv(damped)[6, 6] * max(weights.sum(), 1e-300))
        step += 1
        if step == _STEPS or (step > _REACHED and np.abs(change).max() < _STILL * voxel):
            break
    cells = np.unique(np.floor(places / (BEND * voxel)), axis=0, return_inverse=True)[1].ravel()
    bend = np.sum(np.bincount(cells, residuals) ** 2 / np.bincount(cells)) / len(residuals)
    deviation = np.sqrt(bend / resisted) / radius
    return Similarity(*split_scale(transform), float(resisted), float(deviation))
