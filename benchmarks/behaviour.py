"""What the tracker does when its target grows, hides, leaves or moves by parts of a pixel.

    python -m benchmarks.behaviour [--seeds 10] [--setting 'default output_size=initial']

Rendered clips with exact ground truth, a different scene for every seed. Prints a line for each
kind of clip.
"""

import argparse
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dcs_jax import track_batch
from dcs_jax.config import Config
from dcs_jax.evaluation.metrics import centre_error, overlap
from dcs_jax.evaluation.settings import parse_setting
from dcs_jax.synthetic import Clip, render
from dcs_jax.types import Track

PLAIN: dict[str, Any] = {"occlusion": 0.0, "lookalike": False, "cloud": 0.0}
CLIPS: dict[str, dict[str, Any]] = {
    "grows from 0.5 to 2 times": {"length": 200, "zoom": (0.5, 2.0)},
    "shrinks from 2 to 0.5 times": {"length": 200, "zoom": (2.0, 0.5)},
    "hidden for 40 frames": {"length": 190, "covered": 40},
    "out of the frame for 40 frames": {"length": 190, "away": 40},
    "0.7 px a frame, no noise": {"length": 100, "speed": 0.7, "noise": 0.0},
}
WITHIN = 20  # frames in which a target that is wholly in sight again should be found


class Absence(NamedTuple):
    """A track around the frames in which its target is out of sight.

    lost_before: number of frames called lost before the target is hidden at all. lost: share of the
    frames without the target that are called lost. after: frames from the target's full return
    until it is found, negative where it is found while half hidden; None where it is not found.
    noise: mean label noise of the tracked box before, and while the target is out of sight.
    """

    lost_before: int
    lost: float
    after: int | None
    noise: tuple[float, float]


def track_clips(clips: Sequence[Clip], config: Config, first_seed: int = 0) -> Track:
    """A track of each clip, each with its own seed."""
    keys = jax.vmap(jax.random.key)(jnp.arange(first_seed, first_seed + len(clips)))
    frames = np.stack([clip.frames for clip in clips])
    track = track_batch(frames, np.stack([clip.boxes[0] for clip in clips]), keys, config)
    return jax.tree.map(np.asarray, track)


def overlaps(clips: Sequence[Clip], track: Track) -> NDArray[np.float64]:
    """IoU of every frame: [clips, T]."""
    pairs = zip(track.boxes, clips, strict=True)
    return np.array([overlap(boxes, clip.boxes) for boxes, clip in pairs])


def centre_errors(clips: Sequence[Clip], track: Track) -> NDArray[np.float64]:
    """Centre error of every frame, pixels: [clips, T]."""
    pairs = zip(track.boxes, clips, strict=True)
    return np.array([centre_error(boxes, clip.boxes) for boxes, clip in pairs])


def absences(clips: Sequence[Clip], track: Track) -> list[Absence]:
    """The track of each clip around the frames without its target."""
    found = []
    for clip, iou, lost, noise in zip(
        clips, overlaps(clips, track), track.lost, track.noise, strict=True
    ):
        hidden, gone = np.flatnonzero(clip.occluded > 0), np.flatnonzero(clip.absent)
        good = np.flatnonzero((iou > 0.5) & ~lost & (np.arange(len(iou)) > gone[-1]))
        after = int(good[0] - hidden[-1]) if len(good) else None
        mean_noise = noise[1 : hidden[0], 0].mean(), noise[gone, 0].mean()
        found.append(Absence(int(lost[: hidden[0]].sum()), lost[gone].mean(), after, mean_noise))
    return found


def main() -> None:
    """Print what happens in every kind of clip."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--setting", default="default", help="as for dcs-jax evaluate")
    arguments = parser.parse_args()
    config = parse_setting(arguments.setting).config("")
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    for name, options in CLIPS.items():
        clips = [render(seed=seed, **PLAIN, **options) for seed in seeds]
        track = track_clips(clips, config, arguments.first_seed)
        if clips[0].absent.any():
            before, lost, after, noise = zip(*absences(clips, track), strict=True)
            soon = sum(frames is not None and frames <= WITHIN for frames in after)
            print(
                f"{name}: found within {WITHIN} frames {soon} of {len(seeds)}, after "
                f"{list(after)}; lost before {list(before)}, meanwhile "
                f"{np.round(lost, 2).tolist()}; noise of the tracked box "
                f"{np.mean(noise, 0).round(3).tolist()}"
            )
        else:
            print(
                f"{name}: least IoU {overlaps(clips, track).min(1).round(2).tolist()}, centre "
                f"error {centre_errors(clips, track).mean():.2f} px"
            )


if __name__ == "__main__":
    main()
