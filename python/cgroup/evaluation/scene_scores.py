"""Score the poses of many scans against the true ones, by pairs of scans and by components."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.arrays import as_floats, as_rows
from cgroup._checks.values import refusal
from cgroup.errors import InputError
from cgroup.rigid.transforms import angles, as_poses
from cgroup.types import FloatArray

ROTATION_LIMITS = (3.0, 5.0, 10.0, 30.0, 45.0)  # rotation limits of ScanNet's protocol, in degrees
TRANSLATION_LIMITS = (0.05, 0.1, 0.25, 0.5, 0.75)  # translation limits of ScanNet's protocol, in m


@dataclass(frozen=True, eq=False)
class SceneScore:
    """Errors of the poses of many scans against the true ones.

    Attributes
    ----------
    rotation, translation : (P,) array of float64
        Errors of the relative pose of every two scans of one place, in degrees and in the data's unit;
        infinite for two scans that aren't in one component.
    right, mixed : int
        Components with exactly the scans of one place, and components with scans of several places.
    found, wanted : int
        Components of at least two scans, and places with at least two scans.
    placed : int
        Scans in components of at least two.
    """

    rotation: FloatArray
    translation: FloatArray
    right: int
    mixed: int
    found: int
    wanted: int
    placed: int

    def summarize(self) -> dict[str, float]:
        """Return median, mean and largest errors of the pairs within components.

        Returns
        -------
        dict of str to float
            "rotation_median" and so on, in degrees and in the data's unit; NaN without such pairs.
        """
        summary: dict[str, float] = {}
        for name, errors in (("rotation", self.rotation), ("translation", self.translation)):
            known = errors[np.isfinite(errors)]
            for word, of in (("median", np.median), ("mean", np.mean), ("largest", np.max)):
                summary[f"{name}_{word}"] = float(of(known)) if len(known) else float("nan")
        return summary


def score_scene(
    poses: ArrayLike, components: Sequence[Sequence[int]], truth: ArrayLike, labels: Sequence[str]
) -> SceneScore:
    """Score poses of many scans.

    All pairs of scans of one place count, overlapping or not, as in ScanNet's protocol (Gojcic et al.:
    Learning multiview 3D point cloud registration, CVPR 2020).

    Parameters
    ----------
    poses : (N,4,4) array_like of float
        Map points of each scan into the frame of its component; unused for scans in no component.
    components : sequence of sequences of int
        Rows of connected scans; each scan is in one component at most.
    truth : (N,4,4) array_like of float
        Map points of each scan into the frame of its place.
    labels : sequence of str
        The place of each scan.

    Returns
    -------
    SceneScore
        In the order of the upper triangle.
    """
    estimated, true = as_floats("poses", poses), as_floats("truth", truth)
    count = len(true) if true.ndim else 0
    places = as_labels("labels", labels, count, "true poses")
    for name, array in (("poses", estimated), ("truth", true)):
        if array.shape != (count, 4, 4):
            raise InputError(name, f"shape {array.shape}", f"give ({count},4,4): one pose for each label")
    try:
        listed = list(itertools.islice(components, count + 1))
    except Exception as error:  # whatever the object's own conversion raises
        raise refusal("components", components, "give lists of rows") from error
    if len(listed) > count:
        raise InputError("components", f"more than {count}", f"give each of the {count} rows once at most")
    parts = [as_rows(f"components[{number}]", part) for number, part in enumerate(listed)]
    rows = np.concatenate([np.empty(0, np.int64), *parts])
    as_poses("truth", true)
    if len(rows) and (rows.min() < 0 or rows.max() >= count or len(np.unique(rows)) < len(rows)):
        raise InputError("components", f"rows {rows.tolist()}", f"give each of the {count} rows once at most")
    as_poses("poses", estimated[rows])
    part = np.full(count, -1)
    for number, members in enumerate(parts):
        part[members] = number
    _, place = np.unique(places, return_inverse=True)
    first, second = np.triu_indices(count, 1)
    together = place[first] == place[second]
    first, second = first[together], second[together]
    rotation, translation = (np.full(len(first), np.inf) for _ in range(2))
    joined = (part[first] == part[second]) & (part[first] >= 0)
    source, target = first[joined], second[joined]
    relative, actual = (np.linalg.solve(each[target], each[source]) for each in (estimated, true))
    rotation[joined] = angles(relative[:, :3, :3].transpose(0, 2, 1) @ actual[:, :3, :3])
    translation[joined] = np.linalg.norm(relative[:, :3, 3] - actual[:, :3, 3], axis=1)
    members = {frozenset(np.flatnonzero(place == each).tolist()) for each in np.unique(place)}
    several = [frozenset(component.tolist()) for component in parts if len(component) > 1]
    right = sum(each in members for each in several)
    mixed = sum(len({int(place[row]) for row in each}) > 1 for each in several)
    wanted, placed = sum(len(each) > 1 for each in members), sum(map(len, several))
    return SceneScore(rotation, translation, right, mixed, len(several), wanted, placed)


def as_labels(name: str, value: object, count: int, what: str) -> list[str]:
    """Return `count` labels."""
    try:
        labels = [str(label) for label in itertools.islice(cast("Sequence[object]", value), count + 1)]
    except Exception as error:  # whatever the object's own conversion raises
        raise refusal(name, value, "give a list of str") from error
    if len(labels) != count:
        raise InputError(name, f"{len(labels)}", f"give one for each of the {count} {what}")
    return labels


def ecdf(errors: ArrayLike, limits: ArrayLike) -> FloatArray:
    """Return the fractions of errors up to limits.

    Parameters
    ----------
    errors : (P,) array_like of float
        Infinite for failures.
    limits : (L,) array_like of float
        In the unit of the errors.

    Returns
    -------
    (L,) array of float64
        One fraction per limit; NaN without errors.
    """
    values, bounds = as_floats("errors", errors).ravel(), as_floats("limits", limits).ravel()
    if not len(values):
        return np.full(len(bounds), np.nan)
    return np.searchsorted(np.sort(values), bounds, side="right") / len(values)
