"""Pages of clouds placed in a larger one: a scan in a map, models in a scene."""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from matplotlib.colors import to_hex

from cgroup._checks.arrays import in_double
from cgroup._checks.values import as_instance, as_items
from cgroup._show.drawing import as_points
from cgroup._show.words import counted, say_placement
from cgroup.errors import InputError
from cgroup.pages.matches import MAX_POINTS
from cgroup.pages.page import fill, pose_html
from cgroup.pages.results import lead_html
from cgroup.pages.stage import Stage, place_clouds
from cgroup.plots.scans import look_at
from cgroup.plots.shading import View, choose_rows, face_broadside
from cgroup.registration import Registration
from cgroup.rigid import apply
from cgroup.scenes import PreparedMap
from cgroup.scenes.scene import scan_colors
from cgroup.types import AnyCloud, FloatArray

_GROUND = "#b4b8be"  # colour of the map or scene
_GROUND_POINTS = 80_000  # points of it that are drawn, and of all placed clouds together


class _Placed(NamedTuple):
    """A cloud under a pose."""

    name: str
    cloud: FloatArray  # (N,3), not moved
    found: Registration

    def facts(self) -> list[tuple[str, str]]:
        found, name = self.found, self.name
        share = f"{100 * found.fitness:.0f} % overlap, residual {found.inlier_rmse:.3g} there"
        notes = [(name, html.escape(note)) for note in found.notes]
        return [(name, share), *notes, (name, pose_html(found.T_target_source, self.cloud))]

    def words(self) -> str:
        pose, middle = self.found.T_target_source, (self.cloud.min(axis=0) + self.cloud.max(axis=0)) / 2
        return say_placement(pose, apply(pose, middle[None])[0])


def location_page(
    scan: AnyCloud,
    place: PreparedMap,
    found: Iterable[Registration],
    *,
    title: str = "Location",
    refusal: str | None = None,
) -> str:
    """Return the page of a located scan: the map, and the scan in each place.

    Further parameters are as for `registration_page`.

    Parameters
    ----------
    scan : PointCloud or (N,3) array_like of float
        The located scan; at most 20,000 points of it are drawn, and 80,000 of the map.
    place : PreparedMap
        The map.
    found : iterable of Registration
        Result of `cgroup.scenes.locate`, at least one: the best place, then its rivals.

    Returns
    -------
    str
        HTML, for `write_page`.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.pages import location_page
    >>> from cgroup.scenes import locate, prepare_map
    >>> pair = standin_pair()
    >>> place = prepare_map(pair.target)
    >>> page = location_page(pair.source, place, locate(pair.source, place))
    >>> page.startswith("<!doctype html>")
    True
    """
    as_instance("place", place, PreparedMap)
    places = [as_instance("found", one, Registration) for one in as_items("found", found, "give several")]
    if not places:
        raise InputError("found", "none", "give at least one Registration")
    points, whole = as_points("scan", scan), in_double(place.points)
    names = ["scan", *(f"scan, rival place {k}" for k in range(2, len(places) + 1))]
    placed = [_Placed(name, points, one) for name, one in zip(names, places, strict=True)]
    lead = lead_html(places[0], refusal, ("scan", "map"))
    return _page(title, lead, ("map", whole), placed, look_at([whole]))


def recognition_page(
    models: Mapping[str, AnyCloud],
    scene: AnyCloud,
    found: Iterable[tuple[str, Registration]],
    *,
    title: str = "Recognition",
) -> str:
    """Return the page of recognized models: each in its colour in the scene.

    Parameters
    ----------
    models : mapping of str to PointCloud or (N,3) array_like of float
        The models by name.
    scene : PointCloud or (N,3) array_like of float
        The scene; at most 80,000 points of it are drawn.
    found : iterable of (str, Registration)
        Result of `cgroup.registration.recognize`.
    title : str
        Plain text.

    Returns
    -------
    str
        HTML, for `write_page`.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.pages import recognition_page
    >>> from cgroup.registration import register
    >>> pair = standin_pair(pixels=60)
    >>> found = [("stone", register(pair.source, pair.target))]
    >>> page = recognition_page({"stone": pair.source}, pair.target, found)
    >>> "rotated by" in page
    True
    """
    as_instance("models", models, Mapping)
    points, copies, placed = as_points("scene", scene), Counter[str](), list[_Placed]()
    for name, one in as_items("found", found, "give pairs of a name and a Registration"):
        if name not in models:
            raise InputError("found", repr(name), "give results whose names are in `models`")
        copies[name] += 1
        copy = f"{name}, copy {copies[name]}" if copies[name] > 1 else name
        cloud = as_points("models", models[name])
        placed.append(_Placed(copy, cloud, as_instance("found", one, Registration)))
    count = f"{counted(len(placed), 'object')} of {counted(len(copies), 'model')} found."
    lead = f'<p class="lead quiet">{count} Each has its colour; the scene is grey.</p>'
    return _page(title, lead, ("scene", points), placed, face_broadside(points))


def _page(title: str, lead: str, ground: tuple[str, FloatArray], placed: list[_Placed], view: View) -> str:
    name, points = ground
    most = min(MAX_POINTS, _GROUND_POINTS // max(len(placed), 1))
    posed = {0: points[choose_rows(points, _GROUND_POINTS)]}
    for k, one in enumerate(placed, 1):
        posed[k] = apply(one.found.T_target_source, one.cloud[choose_rows(one.cloud, most)])
    names = [name, *(one.name for one in placed)]
    colors = [_GROUND, *(to_hex(color / 255) for color in scan_colors(len(placed)))]
    clouds = place_clouds(posed, view.axes, names, colors, [[*posed]])
    return Stage(
        kind="places",
        title=as_instance("title", title, str),
        label=f"{len(placed)} clouds in three dimensions, placed in the {name}",
        lead=lead,
        clouds=clouds,
        data={},
        side=_legend(names, colors, placed),
        facts=[fact for one in placed for fact in one.facts()],
        is_named=True,
        controls=fill("places_controls.html", side="above" if name == "map" else "the front"),
    ).page()


def _legend(names: list[str], colors: list[str], placed: list[_Placed]) -> str:
    lines = ""
    for k, (name, color) in enumerate(zip(names, colors, strict=True)):
        one = placed[k - 1] if k else None
        count = f"{one.found.probability:.3f}" if one else ""
        near = f'<button type="button" data-near="{k}" disabled>Near</button>' if one else ""
        lines += (
            f'<div class="bar"><label><input type="checkbox" data-cloud="{k}" checked disabled>'
            f'<span class="swatch dot" style="--color: {color}"></span>{html.escape(name)}</label>'
            f'<span class="count">{count}</span>{near}</div>'
            f'<p class="quiet">{one.words() if one else ""}</p>'
        )
    heading = "<legend>Clouds, and probability of their poses</legend>"
    return f'<fieldset class="placed">{heading}{lines}</fieldset>'
