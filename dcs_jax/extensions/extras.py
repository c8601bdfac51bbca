"""What the tracker has beyond the paper (`Config.extras`).

A correlation filter as one more witness of the place; the size of the object; recognition of the
object, with which a track learns only where it is recognised, knows when it is lost, and looks for
it all over the frame.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from dcs_jax.config import Config
from dcs_jax.core.window import ColumnSums
from dcs_jax.extensions import appearance, correlation
from dcs_jax.types import Appearance, Extras, Filter, Sighting, State

# Windows looked at in a frame, beside that around the last place, for an object out of sight.
_LOOKS = 2
# The object is not followed to a size below this, pixels: there is nothing left to see.
_LEAST_SIDE = 8.0

Find = Callable[[State, Float[Array, "4"], ColumnSums, Config], Sighting]


def begin(window: Float[Array, "lines_y lines_x"], config: Config) -> Extras:
    """What is known after the first frame, from the window around the given box."""
    place, size, description = _learned(window, config)
    seen = Appearance(description, description)
    return Extras(seen, place, place, size, jnp.zeros((), jnp.int32))


def is_lost(known: Extras, config: Config) -> Bool[Array, ""]:
    """Whether the object has not been recognised for `patience` frames: [] bool."""
    return known.missing >= config.patience


def witness(
    known: Extras, window: Float[Array, "lines_y lines_x"], config: Config
) -> Float[Array, "C_y C_x"]:
    """What the place filter adds to the evidence at every place: [C_y, C_x].

    The filter of the first frame has a share in it, against slow drift.
    """
    place = correlation.blend(known.place, known.anchor, config.anchor)
    return config.place_weight * correlation.place_answer(place, window, config.grid)


def recognise(
    known: Extras,
    seen: Sighting,
    given: Float[Array, "2"],
    window: Float[Array, "lines_y lines_x"],
    displacement: Float[Array, "2"],
    frame_shape: tuple[int, ...],
    config: Config,
) -> Sighting:
    """The sighting with the object's size there, and with how surely it is the object.

    given: [2], w and h of the box that was given, pixels. window: in which the object was found,
    displacement: where, [2] down and right, cells. Where the object is not recognised well enough
    to be learned from, behind something perhaps, it keeps its size. The less it is alike, the more
    its size is drawn to the given one: small errors would add up.
    """
    patches = appearance.describe(window, displacement, config)
    alike = appearance.similarity(known.appearance, patches[config.sizes // 2], config)
    confidence = appearance.confidence(alike, config)
    grown = 0.5 * jnp.log(seen.box[2:] / given).sum() / jnp.log(config.size_step)
    steps = correlation.size_steps(known.size, patches) - config.size_pull * (1 - alike) * grown
    steps = jnp.where(confidence > config.learn_above, steps, 0)
    return seen._replace(
        box=_resized(seen.box, config.size_step**steps, frame_shape), confidence=confidence
    )


def seek(find: Find, state: State, seen: Sighting, sums: ColumnSums, config: Config) -> Sighting:
    """The object somewhere else, if it was missed in the last frame and is recognised there.

    In each frame a few more windows are looked at, of those that cover the frame.
    """

    # Under vmap the tracks take turns, so that those which hold their object do not search.
    @jax.custom_batching.sequential_vmap
    def elsewhere(
        missed: Bool[Array, ""], state: State, seen: Sighting, sums: ColumnSums, config: Config
    ) -> Sighting:
        def look(turn: Int32[Array, ""], best: Sighting) -> Sighting:
            assert state.extras is not None
            number = _LOOKS * state.extras.missing + turn
            other = find(state, _tile(state.box, number, sums.shape, config), sums, config)
            better = other.confidence > jnp.maximum(best.confidence, config.found_above)
            return jax.tree.map(lambda new, old: jnp.where(better, new, old), other, best)

        def search() -> Sighting:
            return jax.lax.fori_loop(jnp.int32(0), jnp.int32(_LOOKS), look, seen)

        return jax.lax.cond(missed, search, lambda: seen)

    assert state.extras is not None
    missed = state.extras.missing > 0
    return elsewhere(missed, state, seen, sums, jax.tree.map(jnp.asarray, config))


def learn(
    last: State,
    learned: State,
    seen: Sighting,
    window: Float[Array, "lines_y lines_x"],
    config: Config,
) -> tuple[State, Sighting]:
    """The state after a frame: what was learned in it counts only if the object was recognised.

    learned: the last state with what the classifiers have learned. window: around the new box, in
    which the object is recognised once more: its size is another now. Where it is not, the search
    goes on from where it was last.
    """
    known = last.extras
    assert known is not None
    place, size, description = _learned(window, config)
    alike = appearance.similarity(known.appearance, description, config)
    seen = seen._replace(confidence=appearance.confidence(alike, config))
    # To come back, a lost object has to be recognised as surely at its own place as elsewhere.
    least = jnp.where(is_lost(known, config), config.found_above, config.lost_below)
    recognised = seen.confidence > least
    missing = jnp.where(recognised, 0, known.missing + 1)

    learned = learned._replace(
        extras=Extras(
            appearance.remember(known.appearance, description, config),
            known.anchor,
            correlation.blend(known.place, place, config.place_rate),
            correlation.blend(known.size, size, config.size_rate),
            missing,
        )
    )
    box = jnp.where(recognised, learned.box, last.box)
    forgotten = last._replace(box=box, extras=known._replace(missing=missing))
    keep = seen.confidence > config.learn_above

    def choose(new: Any, old: Any) -> Any:
        # What is the same in both, the features above all, is not copied.
        return old if new is old else jnp.where(keep, new, old)

    return jax.tree.map(choose, learned, forgotten), seen


def _learned(
    window: Float[Array, "lines_y lines_x"], config: Config
) -> tuple[Filter, Filter, Float[Array, " D"]]:
    """Filters for place and size, and the description, of the object in the window's middle."""
    patches = appearance.describe(window, jnp.zeros(2, jnp.float32), config)
    place = correlation.learn_place(window, config.grid)
    return place, correlation.learn_size(patches), patches[config.sizes // 2]


def _resized(
    box: Float[Array, "4"], factor: Float[Array, ""], frame_shape: tuple[int, ...]
) -> Float[Array, "4"]:
    """The box around the same middle in another size, within limits."""
    x, y, w, h = box
    least = _LEAST_SIDE / jnp.minimum(w, h)
    most = jnp.minimum(frame_shape[1] / w, frame_shape[0] / h)
    # A box that was given smaller or larger than that may still stay as it is.
    factor = jnp.clip(factor, jnp.minimum(least, 1), jnp.maximum(most, 1))
    return jnp.stack([x + w * (1 - factor) / 2, y + h * (1 - factor) / 2, w * factor, h * factor])


def _tile(
    box: Float[Array, "4"], number: Int32[Array, ""], frame_shape: tuple[int, ...], config: Config
) -> Float[Array, "4"]:
    """The box in the middle of one of the places that the search windows divide the frame into."""
    sides = jnp.array([frame_shape[1], frame_shape[0]], jnp.float32)
    counts = jnp.ceil(sides / (box[2:] * (config.window_factor - 1))).astype(jnp.int32)
    row, column = jnp.divmod(number % (counts[0] * counts[1]), counts[0])
    middle = (
        (jnp.stack([column, row]).astype(jnp.float32) + 0.5) * sides / counts.astype(jnp.float32)
    )
    return jnp.concatenate([middle - box[2:] / 2, box[2:]])
