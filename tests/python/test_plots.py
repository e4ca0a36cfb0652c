"""Figures are drawn without a display, show what they should, and survive degenerate input."""

import subprocess
import sys
from io import BytesIO

import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure

from cgroup import METHODS, Correspondences
from cgroup.plots import comparison_figure, registration_figure
from cgroup.plots.shading import face_broadside, paint, shade
from cgroup.plots.style import ALONE, CORRECT, DISTANCE_COLORS, WRONG
from cgroup.registry import METHOD_INFO

POSE = np.array([[0.0, -1, 0, 5], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def patch(rng: np.random.Generator, count: int = 2000) -> np.ndarray:
    """A wavy surface that faces +z."""
    x, y = rng.uniform(-1, 1, size=(2, count))
    return np.stack([x, y, 0.1 * np.sin(4 * x)], axis=1)


def drawn(figure: Figure) -> bytes:
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=40)
    return buffer.getvalue()


@pytest.fixture
def scene(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, Correspondences, np.ndarray]:
    source = patch(rng)
    target = source @ POSE[:3, :3].T + POSE[:3, 3]
    rows = np.arange(400)
    partners = np.where(rows < 250, rows, rng.integers(0, 2000, size=400))
    return source, target, Correspondences(source[rows], target[partners]), rows == partners


def test_comparison_has_a_panel_per_method_and_two_colors(scene: tuple) -> None:
    source, target, matches, correct = scene
    mask = np.ones(len(matches), dtype=bool)
    masks = dict.fromkeys(METHODS, mask)
    figure = comparison_figure(
        source, target, matches, correct=correct, masks=masks, T_target_source=POSE, title="two patches"
    )
    panels = [axes for axes in figure.axes if axes.get_title("left")]
    assert [axes.get_title("left") for axes in panels] == [info.label for info in METHOD_INFO.values()]
    for axes in panels:
        wrong, right = axes.collections[0], axes.collections[2]
        assert [to_hex(lines.get_color()[0]).upper() for lines in (wrong, right)] == [WRONG, CORRECT]
        shown = len(wrong.get_segments()) + len(right.get_segments())
        assert shown == 150
        assert f"{shown} of 400 shown" in axes.get_title("right")
        # Subsampling keeps the share of correct matches.
        assert len(right.get_segments()) / shown == pytest.approx(correct.mean(), abs=0.02)
        # Under the true pose the lines of correct matches run parallel.
        steps = np.array([end - start for start, end in right.get_segments()])
        np.testing.assert_allclose(steps, steps[:1].repeat(len(steps), axis=0), atol=1e-9)
    assert drawn(figure).startswith(b"\x89PNG")


def test_figures_of_an_empty_group(scene: tuple) -> None:
    *given, correct = scene
    none, looks = np.zeros(len(correct), dtype=bool), {"T_target_source": POSE, "title": ""}
    assert drawn(comparison_figure(*given, correct=correct, masks={"gtm": none}, **looks))
    assert drawn(registration_figure(*given, mask=none, **looks))


def test_registration_figure_is_coloured_by_the_distance_between_the_clouds(scene: tuple) -> None:
    source, target, matches, correct = scene
    end = 0.025 * np.sqrt(target.var(axis=0).sum())
    for off, color in ((0.0, DISTANCE_COLORS[0]), (2 * end, DISTANCE_COLORS[-1]), (9 * end, ALONE)):
        pose = POSE.copy()
        pose[2, 3] += off
        figure = registration_figure(
            source, target, matches, mask=correct, T_target_source=pose, title="a title"
        )
        assert figure.get_suptitle() == "a title"
        bar = figure.axes[2]
        assert bar.get_xlim() == pytest.approx((0, end))
        assert "in the clouds' unit" in bar.get_xlabel()
        shown = np.asarray(figure.axes[1].images[0].get_array())
        tint = shown[shown[..., 3] > 0][:, :3]
        np.testing.assert_allclose(
            np.median(tint / np.max(tint, axis=1, keepdims=True), axis=0),
            np.array(to_rgb(color)) / max(to_rgb(color)),
            atol=0.05,
        )
        assert drawn(figure)


def test_shading_survives_degenerate_clouds() -> None:
    line = np.arange(30.0).reshape(10, 3)
    for cloud in (line[:1], np.zeros((5, 3)), line, np.eye(3) * 1e-300, np.eye(3) * 1e12):
        picture = shade(face_broadside(cloud).project(cloud), (1, 1, 1))
        assert np.isfinite(picture.rgba).all()
        assert picture.rgba[..., 3].any()


def test_cells_are_painted_by_the_points_in_front(rng: np.random.Generator) -> None:
    clouds = np.concatenate([patch(rng), patch(rng, 8000) + np.array([0, 0, 5])])
    for front in (0.0, 1.0):
        means = []
        values = np.repeat([0.5, front], [2000, 8000])
        picture = paint(clouds, values, lambda mean: means.append(mean) or np.ones((*mean.shape, 3)))  # noqa: B023
        assert (means[0].T[picture.rgba[..., 3] > 0] == front).mean() > 0.95


def test_plots_load_neither_pyplot_nor_pandas() -> None:
    code = "import sys, cgroup.plots; sys.exit(', '.join({'matplotlib.pyplot', 'pandas'} & set(sys.modules)) or 0)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
