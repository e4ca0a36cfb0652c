"""Measures of registration benchmarks, by their names in the literature.

Redwood's error: Choi, Zhou and Koltun: *Robust reconstruction of indoor scenes*, CVPR 2015, and Zeng et al.:
*3DMatch*, CVPR 2017. Inlier ratio and feature-matching recall: Deng, Birdal and Ilic: *PPFNet*, CVPR 2018.
Mean average accuracy: Jin et al.: *Image matching across wide baselines*, IJCV 2021.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.arrays import as_floats, as_mask
from cgroup._checks.values import as_length, as_number
from cgroup.errors import InputError
from cgroup.evaluation.ground_truth import match_errors
from cgroup.evaluation.scene_scores import as_labels, ecdf
from cgroup.rigid import check_rigid
from cgroup.rigid.transforms import quaternions
from cgroup.types import AnyCloud, FloatArray


def redwood_error(estimated: ArrayLike, true: ArrayLike, information: ArrayLike) -> float:
    """Return the squared error of a pose by Redwood's information matrix.

    It is e' I e / I[0,0], where e is the translation of true^-1 estimated and the vector part of its unit
    quaternion. 3DMatch and Predator call a pair registered if it is at most 0.2 squared.

    Parameters
    ----------
    estimated, true : (4,4) array_like of float
        Poses of the source in the target's frame: of a pair ``i j`` in ``gt.log``, of cloud j in that of i.
    information : (6,6) array_like of float
        Of the pair in ``gt.info``; translation first.

    Returns
    -------
    float
        In the square of the data's unit. At 180 degrees the sign of the quaternion is arbitrary.

    Notes
    -----
    Only nominally an RMSE: the published matrices are sums of G'G with G = [I, -[p]x], of points p in the
    frame of i and angles in radians, but the error is in the frame of j, by the sine of half the angle.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.evaluation import redwood_error
    >>> moved = np.eye(4)
    >>> moved[:3, 3] = [0.3, 0, 0.4]
    >>> redwood_error(moved, np.eye(4), 5000 * np.eye(6))
    0.25
    """
    ours, theirs = check_rigid(estimated, "estimated"), check_rigid(true, "true")
    matrix = check_information(information)
    return float(redwood_errors(ours[None], theirs[None], matrix[None])[0])


def check_information(information: ArrayLike, name: str = "information") -> FloatArray:
    """Return a valid information matrix, or raise `InputError`."""
    matrix = as_floats(name, information)
    if matrix.shape != (6, 6) or not np.isfinite(matrix).all() or matrix[0, 0] <= 0:
        got = f"shape {matrix.shape}" if matrix.shape != (6, 6) else f"{matrix[0, 0]} at its beginning"
        raise InputError(name, got, "give a finite 6x6 matrix, translation first")
    return matrix


def redwood_errors(estimated: FloatArray, true: FloatArray, information: FloatArray) -> FloatArray:
    """Return the `redwood_error` (n,) of many pairs; NaN without information."""
    relative: FloatArray = np.linalg.solve(true, estimated)  # pyright: ignore[reportAssignmentType]
    error = np.concatenate([relative[:, :3, 3], quaternions(relative[:, :3, :3])[:, :3]], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.einsum("ni,nij,nj->n", error, information, error) / information[:, 0, 0]


def registration_recall(registered: ArrayLike, *, scenes: Sequence[str] | None = None) -> float:
    """Return the fraction of registered pairs, or the mean of the fractions of scenes.

    Parameters
    ----------
    registered : (P,) array_like of bool
        Whether each pair of the benchmark was registered; False for a pair without a pose.
    scenes : sequence of str, optional
        Scene of each pair. With it scenes have equal weight, as in 3DMatch, Predator and GeoTransformer;
        without it pairs, as in DGR and MAC.

    Returns
    -------
    float
        0 to 1; NaN without pairs.

    Examples
    --------
    >>> from cgroup.evaluation import registration_recall
    >>> registered = [True, True, True, False]
    >>> registration_recall(registered)
    0.75
    >>> scenes = ["kitchen", "kitchen", "kitchen", "hotel"]
    >>> registration_recall(registered, scenes=scenes)
    0.5
    """
    flags = as_mask("registered", registered)
    if scenes is None or not len(flags):
        return float(flags.mean()) if len(flags) else float("nan")
    _, scene = np.unique(as_labels("scenes", scenes, len(flags), "pairs"), return_inverse=True)
    return float((np.bincount(scene, weights=flags) / np.bincount(scene)).mean())


def feature_matching_recall(
    inlier_ratios: ArrayLike, *, least: float = 0.05, scenes: Sequence[str] | None = None
) -> float:
    """Return the fraction of pairs with an inlier ratio above a threshold.

    `scenes` are as for `registration_recall`; all papers report the mean over scenes.

    Parameters
    ----------
    inlier_ratios : (P,) array_like of float
        The `inlier_ratio` of each pair.
    least : float
        PPFNet's tau_2; GeoTransformer also counts equal ratios.

    Returns
    -------
    float
        0 to 1; NaN without pairs.
    """
    ratios = as_floats("inlier_ratios", inlier_ratios).ravel()
    return registration_recall(ratios > as_number("least", least), scenes=scenes)


def inlier_ratio(
    source: AnyCloud, target: AnyCloud, T_target_source: ArrayLike, *, distance: float = 0.1
) -> float:
    """Return the fraction of matches whose points are close under the true pose.

    Further parameters as for `match_errors`.

    Parameters
    ----------
    distance : float
        PPFNet's tau_1, exclusive, in the data's unit; 0.1 m is usual on 3DMatch.

    Returns
    -------
    float
        0 to 1; 0 without matches.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.evaluation import inlier_ratio
    >>> inlier_ratio(np.zeros((4, 3)), np.diag([0.05, 0.2, 0.3, 0])[:, :3], np.eye(4))
    0.5
    """
    limit = as_length("distance", distance)
    close = match_errors(source, target, T_target_source) < limit
    return float(close.mean()) if len(close) else 0.0


def mean_average_accuracy(errors: ArrayLike, limits: ArrayLike) -> float:
    """Return the mean over limits of the fraction of errors up to each (mAA).

    Parameters are as for `ecdf`; limits are 1 to 10 degrees in the Image Matching Challenge.

    Returns
    -------
    float
        0 to 1; NaN without errors or limits.
    """
    shares = ecdf(errors, limits)
    return float(shares.mean()) if len(shares) else float("nan")
