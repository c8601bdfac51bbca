"""Follow every target of a folder of videos, and go on where an earlier run has stopped.

python examples/batch_videos.py manifest.csv results/

`manifest.csv` has one row a target: source,box with box "x,y,w,h"; `dcs-jax batch` is the same.
"""

import argparse
from pathlib import Path

import dcs_jax
from dcs_jax.jobs import run_batch


def main(manifest: Path, out: Path, config: dcs_jax.Config = dcs_jax.Config()) -> int:
    """Track what is not finished; returns how many targets failed."""
    batch = run_batch(manifest, out, config=config)
    for failure in batch.failed:
        print(f"failed: {failure}")
    print(f"boxes in {out / 'boxes'}, one file a video")
    return len(batch.failed)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("manifest", type=Path)
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    main(arguments.manifest, arguments.out)
