"""Base class of data sets, pairs, unrelated pairs, and measures of pairs."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, Literal, TypeAlias

import numpy as np

from cgroup.errors import InputError
from cgroup.evaluation import clutter_and_occlusion, overlap
from cgroup.evaluation.ground_truth import OVERLAP_WITHIN, VISIBLE_WITHIN
from cgroup.features import ORIGIN, Viewpoint, resolution, within
from cgroup.rigid import apply, invert
from cgroup.types import Correspondences, FloatArray, IndexArray, PointCloud

Role: TypeAlias = Literal["full-full", "full-partial", "partial-partial", "correspondences"]
Origin: TypeAlias = Literal["real", "semi-synthetic", "synthetic"]

MIN_FITTING = 0.05  # A pose is rejected if it moves a smaller share of the source points onto the target
FITTING_WITHIN = 2.0  # pr. A source point is on the target within this distance
_MOST_CELLS = 1e6  # along an axis, so that the number of a cell fits into 64 bits
_FITTING_SAMPLE = 3000  # source points that a pose is checked with


@dataclass(frozen=True, eq=False)
class MatchingPair:
    """Two clouds of the same thing and the pose between them.

    Attributes
    ----------
    name : str
        Short, unique within its data set.
    source, target : PointCloud
        In the same unit, each in its own frame.
    T_target_source : (4,4) array of float64
        True pose: maps source points into the target's frame.
    source_viewpoint, target_viewpoint : (float, float, float)
        Positions of the scanners in their clouds' frames; normals are oriented towards them.
    normals : {"pca", "mesh", "given"}
        How `cgroup.registration.correspond` is to find normals: "mesh", or "given" where points have some,
        for whole models, whose normals cannot all point towards one viewpoint.
    facts : mapping of str to float
        Known facts: ``overlap``, ``clutter``, ``occlusion`` (0 to 1), ``noise`` (in the data set's unit).

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.datasets import MatchingPair, standin_pair
    >>> scan = standin_pair(pixels=60).source
    >>> MatchingPair("twice", scan, scan, np.eye(4), facts={"overlap": 1.0}).name
    'twice'
    """

    name: str
    source: PointCloud
    target: PointCloud
    T_target_source: FloatArray
    source_viewpoint: Viewpoint = ORIGIN
    target_viewpoint: Viewpoint = ORIGIN
    normals: Literal["pca", "mesh", "given"] = "pca"
    facts: Mapping[str, float] = field(default_factory=dict[str, float])


@dataclass(frozen=True, eq=False)
class CorrespondencePair:
    """Precomputed matches, and the true pose, which determines the correct matches.

    Name, pose and facts are as for `MatchingPair`.

    Parameters
    ----------
    correspondences : Correspondences
        With the resolution set, so that the usual threshold of 5 pr is the inlier distance its makers use.
    """

    name: str
    correspondences: Correspondences
    T_target_source: FloatArray
    facts: Mapping[str, float] = field(default_factory=dict[str, float])


@dataclass(frozen=True, eq=False)
class UnrelatedPair:
    """Two clouds that no rigid motion aligns; fields are as for `MatchingPair`."""

    source: PointCloud
    target: PointCloud
    source_viewpoint: Viewpoint
    target_viewpoint: Viewpoint


class Dataset(ABC):
    """Named pairs with a true pose; subclasses set the class attributes.

    Attributes
    ----------
    name, title : str
        For `open_dataset`, and for figures and tables.
    role : {"full-full", "full-partial", "partial-partial", "correspondences"}
        Completeness of source and target, or matches without clouds.
    origin : {"real", "semi-synthetic", "synthetic"}
        Origin of the clouds; see `origin_of` for a single pair.
    protocols : tuple of str
        Names in `cgroup.evaluation.PROTOCOLS` that make sense here; by default those for any unit.
    citation : str
        Whom to cite.
    single_views : bool
        Whether each cloud is one scan, taken from its viewpoint. Otherwise (fragments of many scans, whole
        models) viewpoints only orient normals.
    own_subjects : bool
        Whether every pair shows a subject of its own, for `subject_of`.

    Examples
    --------
    >>> from cgroup.datasets import Dataset, standin_pair
    >>> class Stones(Dataset):
    ...     name, title = "stones", "Two stones"
    ...     role, origin, citation = "partial-partial", "synthetic", "none"
    ...
    ...     def pair_names(self):
    ...         return ["0", "1"]
    ...
    ...     def load(self, name):
    ...         self.check_name(name)
    ...         return standin_pair(seed=int(name), pixels=60)
    >>> [Stones().load(name).name for name in Stones().pair_names()]
    ['standin-0', 'standin-1']
    """

    name: ClassVar[str]
    title: ClassVar[str]
    role: ClassVar[Role]
    origin: ClassVar[Origin]
    protocols: ClassVar[tuple[str, ...]] = ("precision>0.1", "rmse<=1pr", "rmse<=5pr")
    citation: ClassVar[str]
    single_views: ClassVar[bool] = False
    own_subjects: ClassVar[bool] = False

    _lacking: Mapping[str, Path] = MappingProxyType({})

    def __init__(self, root: Path | str | None = None) -> None:
        del root  # for data sets in files

    @abstractmethod
    def pair_names(self) -> list[str]:
        """Return the names of all pairs that can be loaded, without reading a cloud.

        Returns
        -------
        list of str
            Names for `load`, always in the same order, without `lacking_pairs`.
        """

    @abstractmethod
    def load(self, name: str) -> MatchingPair | CorrespondencePair:
        """Read or make one pair.

        Parameters
        ----------
        name : str
            One of `pair_names`.

        Returns
        -------
        MatchingPair or CorrespondencePair
            The same every time.
        """

    def lacking_pairs(self) -> Mapping[str, Path]:
        """Return the pairs with a missing file, and that file.

        Returns
        -------
        mapping of str to Path
            The first missing file of each pair that the data set should have, as far as it knows.
        """
        return self._lacking

    def note(self) -> str:
        """Return a sentence about missing files.

        Returns
        -------
        str
            The number of pairs with missing files, and the first of these pairs; else empty.
        """
        lacking = self.lacking_pairs()
        if not lacking:
            return ""
        few = itertools.islice(lacking.items(), 3)
        named = [f"{name} (no {'/'.join(path.parts[-2:])})" for name, path in few]
        more = ", ..." if len(lacking) > len(named) else ""
        wanted = len(lacking) + len(self.pair_names())
        return f"{len(lacking)} of {wanted} pairs lack files: {', '.join(named)}{more}"

    def origin_of(self, name: str) -> Origin:
        """Return the origin of the clouds of one pair, named as for `load`.

        Returns
        -------
        {"real", "semi-synthetic", "synthetic"}
            That of the data set, unless a subclass overrides it.
        """
        self.check_name(name)
        return self.origin

    def protocols_of(self, name: str) -> tuple[str, ...]:
        """Return the registration protocols for one pair, named as for `load`.

        Returns
        -------
        tuple of str
            Names in `cgroup.evaluation.PROTOCOLS`; those of the data set, unless a subclass overrides it.
        """
        self.check_name(name)
        return self.protocols

    def subject_of(self, name: str) -> str:
        """Return the object or place that a pair shows; it is named as for `load`.

        Returns
        -------
        str
            The pair's name with `own_subjects`; else the data set's, unless a subclass overrides it.
        """
        self.check_name(name)
        return name if self.own_subjects else self.name

    def check_name(self, name: str) -> None:
        """Raise for a pair that does not exist; it is named as for `load`."""
        names = self.pair_names()
        if name in self.lacking_pairs():
            message = f"{self.name}: the pair {name!r} needs {self.lacking_pairs()[name]}, which isn't there"
            raise InputError(message)
        if name not in names:
            raise InputError(f"{self.name}: has no pair {name!r}; it has {len(names)}, such as {names[0]!r}")


def mixed_names(dataset: Dataset) -> list[tuple[str, str]]:
    """List pairs whose source and target have different subjects.

    Parameters
    ----------
    dataset : Dataset
        Its `subject_of` names the subject of each pair.

    Returns
    -------
    list of (str, str)
        Names of the pairs that give the source and the target, always in the same order.
    """
    subjects = {name: dataset.subject_of(name) for name in dataset.pair_names()}
    pairs = itertools.product(subjects, subjects)
    return [(one, other) for one, other in pairs if subjects[one] != subjects[other]]


def mix(first: MatchingPair, second: MatchingPair) -> UnrelatedPair:
    """Combine the source of one pair with the target of another.

    Parameters
    ----------
    first, second : MatchingPair
        Pairs that show different things, such as `mixed_names` lists.

    Returns
    -------
    UnrelatedPair
        The first's source and the second's target, with their viewpoints.
    """
    return UnrelatedPair(first.source, second.target, first.source_viewpoint, second.target_viewpoint)


def mirror(pair: MatchingPair) -> UnrelatedPair:
    """Reflect the target and its viewpoint at the plane x = 0.

    Unless the shape is mirror-symmetric, no pose fits then. `pair` is as for `apply_nuisance`.

    Returns
    -------
    UnrelatedPair
        The unchanged source, and the mirrored target without faces and normals.
    """
    x, y, z = pair.target_viewpoint
    target = PointCloud(pair.target.points * np.array([-1.0, 1.0, 1.0]))
    return UnrelatedPair(pair.source, target, pair.source_viewpoint, (-x, y, z))


def view_pair(
    name: str, source: PointCloud, target: PointCloud, pose: FloatArray, viewpoint: Viewpoint = ORIGIN
) -> MatchingPair:
    """Return a pair of views with their overlap; both have the same viewpoint."""
    facts = {"overlap": measure_overlap(source, target, pose)}
    return MatchingPair(name, source, target, pose, viewpoint, viewpoint, facts=facts)


def mean_resolution(source: PointCloud, target: PointCloud) -> float:
    """Return the mean of the resolutions of two clouds, the unit of bounds for both."""
    return (resolution(source.points) + resolution(target.points)) / 2


def measure_overlap(source: PointCloud, target: PointCloud, T_target_source: FloatArray) -> float:
    """Return the overlap of two views, within 4 pr."""
    tolerance = OVERLAP_WITHIN * mean_resolution(source, target)
    return overlap(source.points, target.points, T_target_source, tolerance=tolerance)


def measure_clutter(model: PointCloud, scene: PointCloud, T_scene_model: FloatArray) -> dict[str, float]:
    """Return clutter and occlusion of a model in a scene, two meshes, within 2 pr."""
    meshes = model.points, faces_of(model), scene.points, faces_of(scene)
    near = VISIBLE_WITHIN * mean_resolution(model, scene)
    clutter, occlusion = clutter_and_occlusion(*meshes, T_scene_model, tolerance=near)
    return {"clutter": clutter, "occlusion": occlusion}


def faces_of(cloud: PointCloud) -> IndexArray:
    """Return the faces of a model or scene; raise `InputError` without faces."""
    if cloud.faces is None:
        raise InputError("a model or scan has no faces; clutter and normals need meshes")
    return cloud.faces


def posed_pair(
    name: str, model: PointCloud, scene: PointCloud, pose: FloatArray, *, noise: float
) -> MatchingPair:
    """Return the pair with the viewpoint moved like the model, so that normals have the same sign in both."""
    x, y, z = (float(value) for value in pose[:3, 3])
    return MatchingPair(name, model, scene, pose, ORIGIN, (x, y, z), facts={"noise": noise})


def fitting_pose(
    pose: FloatArray, source: PointCloud, target: PointCloud, *, origin: str, tolerance: float | None = None
) -> FloatArray:
    """Return the one of the pose and its inverse that aligns more of the source with the target.

    Files differ in the direction of their poses. A source point is on the target within the tolerance,
    in the data's unit; by default `FITTING_WITHIN`, in units of the mean of the resolutions.
    If neither aligns a fraction of `MIN_FITTING`, an `InputError` names the origin of the pose.
    """
    near = FITTING_WITHIN * mean_resolution(source, target) if tolerance is None else tolerance
    sample = source.points[:: max(1, len(source) // _FITTING_SAMPLE)]
    candidates = (pose, invert(pose))
    shares = [float(within(apply(T, sample), target.points, near).mean()) for T in candidates]
    best = int(np.argmax(shares))
    if shares[best] < MIN_FITTING:
        shown = f"only {shares[0]:.1%} and {shares[1]:.1%} of the points come near it"
        problem = f"neither the pose nor its inverse aligns the source with the target ({shown})"
        raise InputError(f"{origin}: {problem}; is it the pose of another pair, or unit?")
    return candidates[best]


def voxel_means(points: FloatArray, size: float) -> FloatArray:
    """Return the mean point of each occupied grid cell, in the order of cells; `size` is the edge length."""
    above = points - points.min(axis=0)
    width = max(size, above.max() / _MOST_CELLS)
    cells = np.floor(above / width).astype(np.int64)
    extent = cells.max(axis=0) + 1
    numbers = (cells[:, 0] * extent[1] + cells[:, 1]) * extent[2] + cells[:, 2]
    _, rows = np.unique(numbers, return_inverse=True)
    counts = np.bincount(rows)
    return np.stack([np.bincount(rows, weights=points[:, axis]) / counts for axis in range(3)], axis=1)


def voxel_subset(points: FloatArray, count: int) -> FloatArray:
    """Return voxel means, with the cell size whose number of points is nearest to a given one."""
    if count == len(points):
        return points
    extent = float(np.ptp(points, axis=0).max())
    smallest, largest = extent / len(points), extent
    best = points
    for _ in range(30):
        size = float(np.sqrt(smallest * largest))
        means = voxel_means(points, size)
        if abs(len(means) - count) < abs(len(best) - count):
            best = means
        smallest, largest = (size, largest) if len(means) > count else (smallest, size)
    return best
