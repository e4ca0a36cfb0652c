"""What people see of a scene: a figure, a table, a page."""

import colorsys
import re

import numpy as np
import pytest
from matplotlib.figure import Figure
from placed_scenes import known_scene
from test_pages import NASTY, data_of

from cgroup import InputError
from cgroup.pages import scene_page
from cgroup.plots.scans import scans_figure
from cgroup.scenes.scene import scan_colors

plotly = pytest.importorskip("plotly", reason="needs the extra cgroup[scans]")

SCENE = known_scene()


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


def test_many_scans_have_hues_in_their_order_and_the_nearest_is_drawn() -> None:
    colors = scan_colors(100) / 255
    hues = np.array([colorsys.rgb_to_hls(*color)[0] for color in colors])
    assert np.allclose(np.diff(hues), 0.01, atol=0.005)
    assert len(np.unique(colors, axis=0)) == 100
    rng = np.random.default_rng(0)
    shifts = np.arange(30.0)[:, None] * [2.0, 0.0, 0.0]  # each covers most of its neighbours
    clouds = [rng.uniform((-20, -5, 0), (20, 5, 1), size=(2_000, 3)) + shift for shift in shifts]
    tints = np.tile((np.arange(30) / 29)[:, None], 3)
    figure = scans_figure(clouds, [""] * 30, tints, [])
    (image,) = figure.axes[0].images
    shown = np.asarray(image.get_array())
    known = np.nonzero(shown[..., 3])
    left, right = image.get_extent()[:2]
    across = left + (known[1] + 0.5) / shown.shape[1] * (right - left)
    assert abs(np.corrcoef(across, shown[known][:, 0])[0, 1]) > 0.8
