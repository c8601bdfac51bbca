"""Many seeds and many values of a setting through one video, in one call each.

python examples/sweep_seeds.py
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

import dcs_jax.synthetic
from dcs_jax.evaluation.metrics import mean_centre_error


def main(
    config: dcs_jax.Config = dcs_jax.Config(), seeds: int = 8, length: int = 60
) -> tuple[list[float], list[float]]:
    """Returns the centre errors by seed, and by weight of the motion prior."""
    clip = dcs_jax.synthetic.render(length)
    boxes = np.repeat(clip.boxes[:1], seeds, axis=0)

    def errors(track: dcs_jax.Track) -> list[float]:
        return [mean_centre_error(boxes, clip.boxes) for boxes in np.asarray(track.boxes)]

    keys = jax.vmap(jax.random.key)(jnp.arange(seeds))
    by_seed = errors(dcs_jax.track_batch(clip.frames, boxes, keys, config))
    print("by seed:", " ".join(f"{error:.1f}" for error in by_seed), "px")
    # A number of the settings may be an array, one value a track: other values compile nothing.
    priors = np.linspace(0.0, 1.4, seeds)
    swept = dataclasses.replace(config, prior=priors)
    by_prior = errors(dcs_jax.track_batch(clip.frames, boxes, config=swept))
    print("by prior:", " ".join(f"{p:.1f}: {e:.1f}" for p, e in zip(priors, by_prior, strict=True)))
    return by_seed, by_prior


if __name__ == "__main__":
    main()
