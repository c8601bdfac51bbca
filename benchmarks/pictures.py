"""The pictures of docs/how-it-works.md, from a track through the rendered clip.

    python -m benchmarks.pictures docs

Writes how-it-works.png (windows and parts, the score map, selected features) and noise.png (the
confidence and the label noise of the selection over the frames) into the folder. Needs matplotlib.
"""

import argparse
import functools
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle

from dcs_jax import Config, init, step, synthetic, track_sequence
from dcs_jax.compilation import cache
from dcs_jax.core.samples import part_rectangles
from dcs_jax.core.search import confidence_map, displacements, search_window
from dcs_jax.core.window import VideoFrame, place, window_integral
from dcs_jax.extensions import colour, translation

FRAME = 12  # the target is in full sight
FEATURES = 6


def main() -> None:
    """Draw both pictures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path)
    out = parser.parse_args().out
    cache()
    clip, config, key = synthetic.render(), Config(), jax.random.key(0)
    state = init(clip.frames[0], clip.boxes[0], key, config)
    for frame in clip.frames[1:FRAME]:
        state, _ = step(state, frame, config)
    figure, axes = plt.subplots(1, 3, figsize=(13, 4.8), layout="constrained")
    shown = place(state.box, config, state.initial_size).shown
    _windows(axes[0], clip.frames[FRAME], np.asarray(shown), config)
    seen = VideoFrame(jnp.asarray(clip.frames), jnp.int32(FRAME))
    window = window_integral(seen, shown, config.grid)
    colours = colour.look(seen, shown, config.grid)
    assert colours is not None
    _scores(axes[1], window, colours, clip.frames.shape[1:], state, config)
    _features(axes[2], window, state, config)
    figure.savefig(out / "how-it-works.png", dpi=100)
    track = track_sequence(clip.frames, clip.boxes[0], key, config)
    figure, axes = plt.subplots(2, 1, figsize=(9, 3.6), sharex=True, layout="constrained")
    _over_time(axes, track, clip)
    figure.savefig(out / "noise.png", dpi=100)


def _windows(axes: Any, frame: np.ndarray, shown: np.ndarray, config: Config) -> None:
    """What the canvas shows of the last box, with its parts, and both windows around it."""
    axes.imshow(frame)
    x, y, w, h = shown
    for grid, shade, name in (
        (config.grid, "#56b4e9", "translation filter and colours see"),
        (config.search_grid, "#f0e442", "the parts vote here, around the filter's peak"),
    ):
        across, down = (
            (side + 2 * margin) / side
            for side, margin in (
                (grid.columns, grid.margin_columns),
                (grid.rows, grid.margin_rows),
            )
        )
        corner = (x - w * (across - 1) / 2, y - h * (down - 1) / 2)
        axes.add_patch(_outline(corner, w * across, h * down, shade, 2, name))
    grid = config.grid
    for top, left, height, width in part_rectangles(grid, config.parts):
        corner = (x + w * left / grid.columns, y + h * top / grid.rows)
        sides = w * width / grid.columns, h * height / grid.rows
        axes.add_patch(_outline(corner, *sides, "white", 1.2))
    axes.legend(loc="lower left", fontsize=8)
    _finish(axes, "the object on the canvas, its nine parts, two windows")


def _scores(
    axes: Any,
    window: jax.Array,
    colours: jax.Array,
    frame_shape: tuple[int, ...],
    state: Any,
    config: Config,
) -> None:
    """The score map of the next frame: votes of the parts, translation filter, and colours."""
    assert config.translation is not None
    assert config.colour is not None
    of_object = colour.respond(state.colour, colours, config.colour)
    placed = place(state.box, config, state.initial_size)
    by_colour = functools.partial(colour.score, of_object, placed, config)
    features = translation.features(window, config.grid)
    response = translation.respond(state.translation, features, config.translation)
    middle = translation.search_middle(response, placed, frame_shape, config, by_colour)
    searched = search_window(window, middle, config)
    maps = confidence_map(searched, state.pool, state.weak, state.strong, config)
    scores = maps.score_map + translation.score(response, middle, config)
    scores += by_colour(*displacements(config.search_grid, middle))
    grid = config.search_grid
    down, right = grid.margin_rows, grid.margin_columns
    axes.imshow(scores, extent=(-right - 0.5, right + 0.5, down + 0.5, -down - 0.5))
    row, column = np.unravel_index(np.argmax(scores), scores.shape)
    axes.plot(column - right, row - down, "+", color="red", markersize=14, markeredgewidth=2)
    axes.set_xlabel("cells; the object has 40")
    axes.set_title("score of every position, and its peak", fontsize=10)


def _features(axes: Any, window: jax.Array, state: Any, config: Config) -> None:
    """The features of the whole object that weigh most, on the patch."""
    grid = config.grid
    cells = np.diff(np.diff(window, axis=0), axis=1)
    object_ = cells[grid.margin_rows :, grid.margin_columns :][: grid.rows, : grid.columns]
    strong = state.strong
    best = np.argsort(-np.asarray(strong.alpha[0]))[:FEATURES]
    gap = 3
    tiles = []
    for selector in best:
        number = int(strong.selected[0, selector]) * strong.selected.size + int(selector)
        weights = _weights_of_cells(state.pool, number, grid.rows, grid.columns)
        shade = (object_ - object_.min()) / np.ptp(object_)
        tile = np.repeat(0.25 + 0.5 * shade[..., None], 3, axis=2)
        strength = 0.5 * np.abs(weights)[..., None] / np.abs(weights).max()
        sign = np.where(weights[..., None] > 0, [0.9, 0.6, 0.0], [0.0, 0.45, 0.7])
        tile = (1 - strength) * tile + strength * sign
        tiles.append(np.pad(tile, ((0, gap), (0, gap), (0, 0)), constant_values=1))
    axes.imshow(np.vstack([np.hstack(tiles[:3]), np.hstack(tiles[3:])])[:-gap, :-gap])
    _finish(axes, "six of the 40 features chosen for the whole object")


def _weights_of_cells(pool: Any, number: int, rows: int, columns: int) -> np.ndarray:
    """What every cell of the patch counts in a feature, [rows, columns]."""
    corners = np.zeros((rows + 1, columns + 1))
    places = np.asarray(pool.corners[:, number]).astype(int)
    np.add.at(corners.reshape(-1), places, np.asarray(pool.coefficients[:, number], float))
    # A value of the integral image is the sum of all cells above and to the left.
    return corners[::-1, ::-1].cumsum(0).cumsum(1)[::-1, ::-1][1:, 1:]


def _over_time(axes: Any, track: Any, clip: synthetic.Clip) -> None:
    """What hides the target, the confidence, and the noise that the selection finds."""
    frames = np.arange(len(clip.frames))
    axes[0].fill_between(frames, clip.occluded, color="#bbbbbb", label="share hidden")
    axes[0].plot(track.confidence, color="#0072b2", label="confidence")
    axes[0].legend(loc="lower right", fontsize=8)
    axes[0].set_ylim(0, 1.02)
    noise = np.asarray(track.noise)
    learned = np.flatnonzero(noise.any(axis=1))
    noise = noise[learned]
    axes[1].plot(learned, noise[:, 0], color="#d55e00", label="e of the tracked box")
    corners = np.abs(noise[:, 1:]).mean(1)
    axes[1].plot(learned, corners, color="#009e73", label="e of the corners (mean size)")
    axes[1].legend(loc="upper right", fontsize=8)
    axes[1].set_xlabel("frame")


def _outline(
    corner: tuple[float, float], w: float, h: float, colour: str, line: float, name: str = ""
) -> Rectangle:
    return Rectangle(corner, w, h, fill=False, color=colour, linewidth=line, label=name or None)


def _finish(axes: Any, title: str) -> None:
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_title(title, fontsize=10)


if __name__ == "__main__":
    main()
