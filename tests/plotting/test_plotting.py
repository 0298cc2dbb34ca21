"""Figures and pixels: the right colours in the right places, the same bytes every time, no global state."""

import sys
from io import BytesIO
from types import SimpleNamespace

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image, ImageSequence

from shadowjax import plotting
from shadowjax.plotting.style import spread

STEP = (np.arange(12) >= 6).astype(float) * np.ones((9, 1))


def test_difference_is_blue_where_too_dark_and_red_where_too_bright():
    test = np.array([[0.0, 1.0, 0.5, 1.0]])
    reference = np.array([[1.0, 0.0, 0.5, 0.0]])
    mask = np.array([[True, True, True, False]])
    dark, bright, right, ignored = plotting.difference_pixels(test, reference, mask)[0]
    assert dark[2] > 0.5 > dark[0]
    assert bright[0] > 0.5 > bright[2]
    np.testing.assert_allclose(right, ignored)  # no error and no receiver both show paper
    np.testing.assert_allclose(right, 0.97)


def test_difference_grows_with_the_error():
    errors = np.linspace(0, 1, 11)[None]
    colors = plotting.difference_pixels(errors, np.zeros_like(errors))[0]
    blueness = colors[:, 2]
    assert (np.diff(blueness) < 0).all()


def test_enlarge_makes_blocks():
    np.testing.assert_array_equal(plotting.enlarge(np.array([[1, 2]]), 2), [[1, 1, 2, 2], [1, 1, 2, 2]])
    with pytest.raises(ValueError, match="enlargement factor"):
        plotting.enlarge(np.zeros((2, 2)), 0)


def test_edge_window_finds_the_edge_and_stays_inside():
    image = np.ones((60, 80))
    image[40:55, 50:70] = 0
    mask = np.ones(image.shape, bool)
    rows, cols = plotting.edge_window(image, mask, 10, 12)
    seen = image[rows, cols]
    assert seen.shape == (10, 12)
    assert 0.2 < seen.mean() < 0.8
    rows, cols = plotting.edge_window(np.ones((60, 80)), mask, 10, 12)
    assert (rows.start, cols.start) == (25, 34)
    rows, cols = plotting.edge_window(STEP, np.ones(STEP.shape, bool), 100, 100)
    assert (rows.stop, cols.stop) == STEP.shape


def test_outline_draws_the_border_alone():
    image = np.zeros((6, 6, 3))
    drawn = plotting.outlined(image, (slice(1, 5), slice(1, 5)), (1.0, 0.0, 0.0))
    assert drawn[..., 0].sum() == 12
    assert image.sum() == 0


def _figures():
    depth = np.hypot(*np.mgrid[0:9, 0:12])
    return [
        plotting.image_grid([STEP, 1 - STEP], ["a", "b"], ["left", "right"], heading="both"),
        plotting.depth_map(depth, depth < 9, "light view"),
        plotting.difference_map(STEP, np.roll(STEP, 1)),
        plotting.lines({"a": ([1, 2], [3, 4]), "b": ([1, 2], [4, 3])}, "x", "y", marks={"here": 1.5}),
        plotting.scatter({"a": (1.0, 2.0), "b": (2.0, 1.0), "c": (2.0, 2.0)}, "x", "y", front=["a", "b"], chosen="a"),
        plotting.bars({"a": 1.0, "b": 0.0}, "ms"),
        plotting.tone_histogram({"hard": STEP, "pcf": STEP / 2, "smooth": STEP / 3}, {"hard": 2, "pcf": 3}),
    ]


def test_figures_have_the_same_bytes_every_time_whatever_the_users_settings():
    first = [plotting.figure_png(figure) for figure in _figures()]
    with mpl.rc_context({"font.size": 30, "axes.facecolor": "red"}):
        second = [plotting.figure_png(figure) for figure in _figures()]
    assert first == second
    for png in first:
        pixels = np.asarray(Image.open(BytesIO(png)).convert("L"))
        assert pixels.std() > 1  # something is drawn


def test_no_global_figure_is_made():
    _figures()
    assert "matplotlib.pyplot" not in sys.modules or not sys.modules["matplotlib.pyplot"].get_fignums()


def test_misses_of_a_depth_map_are_left_out_of_its_range():
    depth = np.array([[1.0, 2.0], [3.0, 1e9]])
    figure = plotting.depth_map(depth, depth < 10)
    assert figure.axes[0].images[0].get_clim() == (1.0, 3.0)
    empty = plotting.depth_map(depth, np.zeros((2, 2), bool))
    assert empty.axes[0].images[0].get_clim() == (0.0, 1.0)


def test_histogram_bars_stand_on_the_tones():
    values = np.repeat([0.0, 1 / 3, 2 / 3, 1.0], [5, 2, 3, 7])
    spot = plotting.tone_histogram({"t": values}, {"t": 4}).axes[0]
    bars = [(patch.get_x() + patch.get_width() / 2, patch.get_height()) for patch in spot.patches]
    np.testing.assert_allclose(bars, [(1 / 3, 2), (2 / 3, 3)])


def test_grid_counts_must_match():
    with pytest.raises(ValueError, match="as many titles"):
        plotting.image_grid([STEP], ["a", "b"])


def test_spread_keeps_order_and_gap():
    placed = spread([1.0, 1.0, 5.0], 2.0)
    assert placed[2] - max(placed[:2]) >= 2 - 1e-6
    assert abs(placed[0] - placed[1]) >= 2 - 1e-6


def test_a_gif_holds_every_frame_and_says_what_is_wrong():
    grey = [np.full((20, 30), value) for value in (0.0, 0.5, 1.0)]
    content = plotting.gif_bytes([*grey[::-1], np.linspace(0, 1, 1800).reshape(20, 30, 3)], 50, 200)
    assert content == plotting.gif_bytes([*grey[::-1], np.linspace(0, 1, 1800).reshape(20, 30, 3)], 50, 200)
    movie = Image.open(BytesIO(content))
    means, times = [], []
    for frame in ImageSequence.Iterator(movie):
        means.append(np.asarray(frame.convert("L"), float).mean())
        times.append(frame.info["duration"])
    np.testing.assert_allclose(means, [255, 127.5, 0, 127.5], atol=6)
    assert times == [50, 50, 50, 200]
    assert movie.info["loop"] == 0
    figure, _ = plotting.new_figure(2.0, 1.0)
    assert Image.open(BytesIO(plotting.gif_bytes([figure, np.zeros((80, 160))]))).size == (160, 80)
    with pytest.raises(ValueError, match="at least two frames; got 1"):
        plotting.gif_bytes(grey[:1])
    with pytest.raises(ValueError, match="one size"):
        plotting.gif_bytes([grey[0], grey[0].T])
    with pytest.raises(ValueError, match="must be finite"):
        plotting.gif_bytes([grey[0], np.full((20, 30), np.nan)])
    with pytest.raises(ValueError, match="rows, cols, 3"):
        plotting.gif_bytes([grey[0], np.zeros(3)])
    with pytest.raises(ValueError, match="fewer or smaller frames"):
        plotting.gif_bytes(grey, most_bytes=100)


def test_a_name_with_dollar_signs_is_no_formula():
    record = SimpleNamespace(technique="hard", light_rmse=0.1, map_bytes=1024, build_ms=1.0, visibility_ms=1.0)
    assert len(plotting.figure_png(plotting.pareto([record], r"$\frac{$.obj"))) > 1000
