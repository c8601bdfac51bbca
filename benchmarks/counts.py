"""Additions and bytes of each stage of a step, counted by hand.

What a stage cannot do without: its input read once, its output written once, and what does not
stay in the nearest cache between.
"""

from typing import NamedTuple

import jax
import numpy as np

from dcs_jax.config import Config
from dcs_jax.core.samples import LABELS
from dcs_jax.extensions.appearance import PLACES as PATCH
from dcs_jax.extensions.gradients import DIRECTIONS

Counts = tuple[float, float]  # additions (a multiplication with it is free), bytes moved

CORNERS = (2 * 6 + 2 * 8 + 9) / 5  # a feature has in the mean: its five types are equally likely
R, PATTERNS = len(LABELS), 2 ** len(LABELS)


class Size(NamedTuple):
    """What the counts are made of: of the frame, the window, the map and the pool."""

    pixels: int
    channels: int
    width: int
    rows: int  # lines of the window's integral image
    columns: int
    places: int
    parts: int
    problems: int  # K * N
    features: int
    iterations: int
    sizes: int

    @classmethod
    def of(cls, config: Config, frame: jax.Array) -> "Size":
        """The sizes of one step on this frame."""
        height, width = frame.shape[:2]
        problems = config.parts * config.selectors
        return cls(
            pixels=height * width,
            channels=frame.size // (height * width),
            width=width,
            rows=config.grid.window[0] + 1,
            columns=config.grid.window[1] + 1,
            places=int(np.prod(config.grid.positions)),
            parts=config.parts,
            problems=problems,
            features=problems * config.pool_size,
            iterations=config.iterations,
            sizes=config.sizes,
        )


def sums(n: Size) -> Counts:
    """Of the column sums: grey values, added up once."""
    return n.pixels * (n.channels + 1), n.pixels * (n.channels + 8)


def window(n: Size) -> Counts:
    """Each line takes two rows of the frame, and their sums run along it; columns likewise."""
    down, across = n.rows * n.width, n.rows * n.columns
    return 4 * down + 3 * across, 4 * (6 * down + 4 * across)


def votes(n: Size) -> Counts:
    """Of the map: one view a corner, then midpoint, sign and sum; the views stay in the cache."""
    additions = n.problems * n.places * (CORNERS + 3)
    return additions, 4 * (n.rows * n.columns + 2 * n.parts * n.places)


def peak(n: Size) -> Counts:
    """Of the peak: some passes over the map."""
    return 20 * n.places, 4 * 10 * n.places


def gradients(n: Size) -> Counts:
    """Of the place filter: differences, then directions; its transforms have few cells."""
    cells = n.rows * n.columns
    return cells * (4 + 2 * DIRECTIONS), 4 * cells * (6 + DIRECTIONS)


def patches(n: Size) -> Counts:
    """Of S resampled patches: each line is between two of the integral image, both ways."""
    lines, places = n.sizes * PATCH * n.columns, n.sizes * PATCH**2
    return 2 * lines + places * (6 + 2 * DIRECTIONS), 4 * (3 * lines + places * (6 + DIRECTIONS))


def both(n: Size) -> Counts:
    """Of the place filter and the patches, to learn from."""
    (additions, moved), (more, more_moved) = gradients(n), patches(n)
    return additions + more, moved + more_moved


def haar(n: Size) -> Counts:
    """Of the responses: nine corners, weights and the R values at each; then transposed."""
    return 9 * R * n.features, n.features * (9 * (2 + 1 + 4 * R) + 4 * 3 * R)


def weak(n: Size) -> Counts:
    """Of the update: two means, errors and a vote on each of R rows."""
    return n.features * (4 * (R - 1) + 5 * R), 4 * n.features * (2 * R + 8)


def selection(n: Size) -> Counts:
    """Votes to patterns and back; in each iteration Phi x and Phi' r, and the two iterates."""
    solver = n.iterations * n.problems * PATTERNS
    return 4 * R * n.features + solver * (2 * R + 6), 4 * n.features * (R + 2) + 4 * solver * 6


def strong(n: Size) -> Counts:
    """Of the strong classifiers: the selected, added up."""
    return 2 * n.features, 4 * 3 * n.features


def nothing(n: Size) -> Counts:
    """Of a stage that is skipped in most frames."""
    return 0, 0
