"""Follow a box through a clip, and compare with the truth, which a rendered clip has.

python examples/first_track.py
"""

import dcs_jax.synthetic
from dcs_jax.evaluation.metrics import mean_centre_error, success_rate


def main(config: dcs_jax.Config = dcs_jax.Config(), length: int = 150) -> float:
    """Track the rendered target; returns the rate of success."""
    clip = dcs_jax.synthetic.render(length)
    track = dcs_jax.track_sequence(clip.frames, clip.boxes[0], config=config)
    success = success_rate(track.boxes, clip.boxes)
    print(
        f"centre error {mean_centre_error(track.boxes, clip.boxes):.1f} px, success {success:.2f}"
    )
    print(f"frames called lost: {int(track.lost.sum())} of {length}")
    return success


if __name__ == "__main__":
    main()
