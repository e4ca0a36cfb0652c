"""Recognize models in a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from numpy.typing import ArrayLike

from cgroup._checks.arrays import as_place
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.quoting import show
from cgroup._checks.values import as_count, as_named
from cgroup._runtime.memory import report_refused_memory
from cgroup._runtime.progress import StageClock, as_stage_function
from cgroup.errors import InputError
from cgroup.features import Cloud
from cgroup.features.voxels import choose_thinning
from cgroup.fronts.scan import as_model, as_point_cloud, as_viewpoint
from cgroup.recognition.instances import InstanceSearch
from cgroup.registration.pairwise import Given, PreparedScan, Registration, agree, as_given
from cgroup.types import AnyCloud, PointCloud

_MODEL_VOXELS = 5_000
_SCENE_VOXELS = 10_000
_MOST_SCENE_VOXELS = 40_000


class Recognized(NamedTuple):
    """A model found in a scene.

    Attributes
    ----------
    name : str
        Name of the model, as given.
    registration : Registration
        Its pose: `Registration.T_target_source` maps the model into the scene.
    """

    name: str
    registration: Registration


@report_refused_memory()
@explain_wrong_calls
def recognize(
    models: Mapping[str, PreparedScan | Cloud | AnyCloud],
    scene: PreparedScan | Cloud | AnyCloud,
    *,
    voxel: float | None = None,
    viewpoint: ArrayLike | None = None,
    view_direction: ArrayLike | None = None,
    most: int | None = None,
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> list[Recognized]:
    """Return the models found in a scene, with their poses.

    The most probable model is taken first, with the part of the scene that it explains; the search continues
    in the rest until no model is found. So models never cover the same surface, and copies are found one
    after the other. Further parameters are as for `register`.

    Parameters
    ----------
    models : mapping of str to PreparedScan, PointCloud, Cloud, path or (N,3) array_like of float
        Whole models by name, in the scene's unit. With a viewpoint each needs faces or normals.
    scene : PreparedScan, PointCloud, Cloud, path or (N,3) array_like of float
        The scene.
    voxel : float, optional
        Edge length of the voxels, in the unit of the points. By default about 10,000 voxels are left of the
        scene, or more if the smallest model would have less than 5,000.
    viewpoint : (3,) array_like of float, optional
        Position of the scanner, if the scene is a single scan. Without it the result is far less certain.
    view_direction : (3,) array_like of float, optional
        Viewing direction of the scanner, if its position is unknown or its rays are parallel.
    most : int, optional
        Largest number of copies of a model; any by default.

    Returns
    -------
    list of Recognized
        ``(name, registration)`` of each model found, the most probable first within each round.
        `Registration.fitness` is the fraction of the model's surface that is visible in the scene.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.registration import recognize
    >>> pair, other = standin_pair(pixels=60), standin_pair(seed=1, pixels=60)
    >>> found = recognize({"stone": pair.source, "other": other.source}, pair.target)
    >>> [name for name, registration in found]
    ['stone']
    """
    limit = None if most is None else as_count("most", most, 1)
    clock = StageClock(as_stage_function(progress))
    place = as_viewpoint(viewpoint, view_direction)
    library, prepared_scene = _prepare_all(models, scene, voxel, place, threads, clock)
    found = InstanceSearch(library, prepared_scene, limit, threads, clock).run()
    seconds = clock.stop()
    return [Recognized(one.name, one.registration(probability, seconds)) for one, probability in found]


@explain_wrong_calls
def find_instances(
    model: PreparedScan | Cloud | AnyCloud,
    scene: PreparedScan | Cloud | AnyCloud,
    *,
    voxel: float | None = None,
    viewpoint: ArrayLike | None = None,
    view_direction: ArrayLike | None = None,
    most: int | None = None,
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> list[Registration]:
    """Find all copies of a model in a scene.

    Further parameters are as for `recognize` and as for `register`.

    Parameters
    ----------
    model : PreparedScan, PointCloud, Cloud, path or (N,3) array_like of float
        Whole model, in the scene's unit. With a viewpoint it needs faces or normals.

    Returns
    -------
    list of Registration
        One per copy, in the order found.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.registration import find_instances
    >>> pair = standin_pair(pixels=60)
    >>> len(find_instances(pair.source, pair.target))
    1
    """
    found = recognize(
        {"model": model},
        scene,
        voxel=voxel,
        viewpoint=viewpoint,
        view_direction=view_direction,
        most=most,
        threads=threads,
        progress=progress,
    )
    return [registration for _, registration in found]


def _prepare_all(
    models: Mapping[str, PreparedScan | Cloud | AnyCloud],
    scene: PreparedScan | Cloud | AnyCloud,
    voxel: float | None,
    viewpoint: ArrayLike | None,
    threads: int | None,
    clock: StageClock,
) -> tuple[dict[str, PreparedScan], PreparedScan]:
    """Prepare models and scene with one voxel, and normals on the same side."""
    clock.start("voxel size")
    as_named("models", models, "give a dict of clouds by name")
    if viewpoint is not None:
        as_place("viewpoint", viewpoint)
    target = as_given("scene", scene, viewpoint)
    by_frames = target.by_frames
    sources = [_as_model(name, model, by_frames=by_frames) for name, model in models.items()]
    if voxel is None and not any(one.is_ready for one in (target, *sources)):
        voxel = _choose_voxel(target, sources, threads)
    shared = agree([target, *sources], voxel, None, threads)
    ready = [shared.finish(one, by_frames=by_frames) for one in (*sources, target)]
    return dict(zip(models, ready[:-1], strict=True)), ready[-1]


def _as_model(name: str, model: PreparedScan | Cloud | AnyCloud, *, by_frames: bool) -> Given:
    """Check a model; unless prepared, it gets outward normals from its faces, or else its own."""
    label = f"model {show(name)}"
    if isinstance(model, PreparedScan):
        if model.by_frames and not by_frames:
            remedy = "prepared without its outside; prepare it with normals='mesh' or 'given'"
            raise InputError(label, remedy=remedy)
        return as_given(label, model)
    model = as_point_cloud(label, model)
    has_faces = isinstance(model, PointCloud) and model.faces is not None
    has_normals = isinstance(model, PointCloud) and model.normals is not None
    if by_frames and not has_faces:
        return as_given(label, model)
    if not has_faces and not has_normals:
        lacking = "neither faces nor normals, which tell its outside"
        raise InputError(label, lacking, "give a `PointCloud` with them, or leave out `viewpoint`")
    return as_given(label, as_model(label, model, "mesh" if has_faces else "given"))


def _choose_voxel(scene: Given, models: Sequence[Given], threads: int | None) -> float:
    """Choose the usual voxel of a scene, or a smaller one that its smallest model needs."""

    def voxel(cloud: Given, voxels: int) -> float:
        return choose_thinning(cloud.whole.cloud, voxels=voxels, threads=threads)

    needed = min(voxel(model, _MODEL_VOXELS) for model in models)
    return max(min(needed, voxel(scene, _SCENE_VOXELS)), voxel(scene, _MOST_SCENE_VOXELS))
