"""What people see of a scene: a figure, a table, a page."""

import json
import re

import numpy as np
import pytest
from matplotlib.figure import Figure
from placed_scenes import PAIR, known_scene

from cgroup import InputError
from cgroup.pages import scene_page
from cgroup.pages.stage import arrange
from cgroup.plots.scans import place_nodes

plotly = pytest.importorskip("plotly", reason="needs the extra cgroup[scans]")

SCENE = known_scene()
NASTY = "</script><!--<img src=x onerror=alert(1)>&amp;\"'$title %{x}"


def test_a_scene_in_few_words() -> None:
    assert repr(SCENE) == "Scene(scans=4, components=[3, 1], edges=2 of 3 kept)"
    table = SCENE._repr_html_()
    assert "3 of 4 scans in 1 component<" in table
    assert "front.ply, side.ply, again.ply" in table
    assert "stranger.ply belongs to no other scan" in table
    assert "6 tried; of the edges 2 kept, 1 dropped" in table
    nothing = known_scene(components=[[k] for k in range(4)], edges=[])._repr_html_()
    assert "0 of 4 scans in 0 components" in nothing
    assert "None" not in table + nothing


def test_the_figure_has_each_scan_and_each_edge() -> None:
    figure = SCENE.plot()
    assert isinstance(figure, Figure)
    graph = figure.axes[1]
    dropped, kept = graph.collections[:2]
    assert [len(lines.get_segments()) for lines in (dropped, kept)] == [1, 2]
    assert dropped.get_linestyle() != kept.get_linestyle()
    assert [text.get_text() for text in graph.texts] == ["front.ply", "side.ply", "again.ply"]
    alone = SCENE.plot(component=1)
    assert [text.get_text() for text in alone.axes[1].texts] == ["stranger.ply"]
    with pytest.raises(InputError, match="component"):
        SCENE.plot(component=2)


def test_names_are_no_formulas() -> None:
    named = known_scene(names=["$\\frac$", "b", "c", "d"])
    named.plot().canvas.draw()


def test_nodes_that_crowd_stand_on_a_circle() -> None:
    rng = np.random.default_rng(0)
    crowd = [rng.normal(size=(50, 3)) * 1e-3 + np.array([k == 0, 0, 0]) for k in range(6)]
    places = place_nodes(crowd, np.eye(3))
    assert np.allclose(np.linalg.norm(places, axis=1), 1.0)
    road = [rng.normal(size=(50, 3)) + np.array([30.0 * k, 0, 0]) for k in range(6)]
    assert np.allclose(place_nodes(road, np.eye(3))[:, 0], [each[:, 0].mean() for each in road])


def test_boxes_that_are_laid_out_do_not_overlap() -> None:
    rng = np.random.default_rng(0)
    sizes = list(rng.uniform(0.2, 3.0, (17, 3)))
    middles = arrange(sizes)
    for k in range(17):
        for other in range(k):
            apart = np.abs(middles[k] - middles[other])[:2]
            assert (apart > (sizes[k] + sizes[other])[:2] / 2).any()


def data_of(page: str) -> dict[str, list[list[float]]]:
    (text,) = re.findall(r'<script type="application/json" id="stage-data">(.*?)</script>', page)
    return json.loads(text)


def test_the_page_lays_components_apart_and_scans_of_one_together() -> None:
    data = data_of(scene_page(SCENE))
    assert data["rows"] == [0, 1, 2, 3]
    joined, apart = np.array(data["joined"]), np.array(data["apart"])
    assert np.allclose(joined[0], joined[2], atol=1e-6)  # the same surface
    assert np.linalg.norm(joined[3] - joined[0]) > np.linalg.norm(joined[1] - joined[0])
    distances = np.linalg.norm(apart[:, None] - apart, axis=-1)
    assert distances[np.triu_indices(4, 1)].min() > 50.0  # none hides another
    assert data["edges"] == [[1, 0], [2, 1], [2, 0]]


def test_the_page_tells_kept_edges_from_dropped_ones() -> None:
    page = scene_page(SCENE, title="Stones")
    assert "<title>Stones</title>" in page
    assert len(re.findall(r'<line data-edge="\d"[^>]*stroke-dasharray', page)) == 1
    assert len(re.findall(r"<line data-edge", page)) == 3
    assert re.findall(r'<tr data-edge="(\d)"', page) == ["2", "0", "1"]  # dropped ones first
    assert "dropped: other edges contradict it" in page
    assert len(re.findall(r'type="checkbox" data-row', page)) == 4


def test_nothing_breaks_out_of_its_place_and_nothing_is_fetched() -> None:
    page = scene_page(known_scene(names=[NASTY] * 4, notes=(NASTY,)), title=NASTY)
    assert "<img" not in page
    assert not re.findall(r'(?:src|href)\s*=\s*["\']?(?:https?:)?//', page)


def test_a_scene_without_edges_and_wrong_arguments() -> None:
    page = scene_page(known_scene(components=[[k] for k in range(4)], edges=[]))
    assert "<svg" not in page
    assert "0 of 4 scans connected" in page
    with pytest.raises(InputError, match="scene: got"):
        scene_page(PAIR)  # type: ignore[arg-type]
