"""The paper's table on real sequences: centre error and success rate, mean over seeds.

    python -m benchmarks.reproduce ../shared/sequences --published ../shared/published --seeds 5

ROOT holds NAME/img/* and NAME/groundtruth_rect.txt. With --set NAME=VALUE (repeatable) every
setting is changed so, with --settings only some of them are run. Prints Markdown.
"""

import argparse
import ast
import csv
import dataclasses
import time
from collections.abc import Sequence
from pathlib import Path

import jax
import numpy as np

import dcs_jax
from dcs_jax.evaluation.metrics import mean_centre_error, success_rate
from dcs_jax.io.annotations import find_annotation, read_boxes
from dcs_jax.io.frames import open_source

SETTINGS = {
    "paper, l1": dcs_jax.Config.paper(),
    "paper, error": dcs_jax.Config.paper(selector="error"),
    "default": dcs_jax.Config(),
}
PUBLISHED = {"paper, l1": "dcs_with_l1", "paper, error": "dcs_without_l1"}


def main() -> None:
    """Run every setting on every sequence and print one table a setting."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("root", type=Path)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--published", type=Path, help="folder with authors_30_runs.csv")
    parser.add_argument("--settings", nargs="+", choices=SETTINGS, default=list(SETTINGS))
    parser.add_argument("--sequences", nargs="+", help="names of the folders (default: all)")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    arguments = parser.parse_args()
    changes = dict(_parse(text) for text in arguments.set)
    names = arguments.sequences or sorted(
        path.name for path in arguments.root.iterdir() if find_annotation(path)
    )
    print(f"{arguments.seeds} seeds, dcs_jax {dcs_jax.__version__}, changes: {changes or 'none'}\n")
    for setting in arguments.settings:
        config = dataclasses.replace(SETTINGS[setting], **changes)
        published = _read_published(arguments.published, PUBLISHED.get(setting))
        _print_table(setting, config, arguments.root, names, arguments.seeds, published)


def run(folder: Path, config: dcs_jax.Config, seeds: int) -> np.ndarray:
    """Centre error in pixels and success rate of each seed: [seeds, 2]."""
    frames = np.stack(list(open_source(folder)))
    truth = read_boxes(find_annotation(folder))
    results = []
    for seed in range(seeds):
        track = dcs_jax.track_sequence(frames, truth[0], jax.random.key(seed), config)
        results.append((mean_centre_error(track.boxes, truth), success_rate(track.boxes, truth)))
    return np.array(results)


def _print_table(
    setting: str,
    config: dcs_jax.Config,
    root: Path,
    names: list[str],
    seeds: int,
    published: dict[str, tuple[float, float]],
) -> None:
    print(f"### {setting}\n")
    theirs_head = " authors' 30 runs, px | success |" if published else ""
    print(f"| sequence | px | sd | success | sd |{theirs_head}")
    print("|---|---|---|---|---|" + ("---|---|" if published else ""))
    begin = time.perf_counter()
    rows = []
    for name in names:
        results = run(root / name, config, seeds)
        (error, success), (error_sd, success_sd) = results.mean(0), results.std(0, ddof=1)
        rows.append((error, success, *published.get(name, ())))
        spread = f"{error:.1f} | {error_sd:.1f} | {success:.2f} | {success_sd:.2f}"
        print(f"| {name} | {spread} |{_cells(rows[-1][2:])}", flush=True)
    error, success, *theirs = np.mean(rows, axis=0)
    print(f"| **mean** | **{error:.1f}** | | **{success:.3f}** | |{_cells(theirs)}")
    print(f"\n{time.perf_counter() - begin:.0f} s with compilation\n", flush=True)


def _cells(published: Sequence[float]) -> str:
    """The published centre error and success rate as cells of the table, if there are any."""
    return f" {published[0]:.1f} | {published[1]:.2f} |" if len(published) else ""


def _read_published(folder: Path | None, tracker: str | None) -> dict[str, tuple[float, float]]:
    """Centre error and success rate of the authors' 30 runs, by sequence."""
    if folder is None or tracker is None:
        return {}
    with open(folder / "authors_30_runs.csv", newline="") as file:
        return {
            row["sequence"]: (float(row["centre_error_px_mean"]), float(row["success_rate"]))
            for row in csv.DictReader(file)
            if row["tracker"] == tracker
        }


def _parse(text: str) -> tuple[str, object]:
    name, _, value = text.partition("=")
    try:
        return name, ast.literal_eval(value)
    except (SyntaxError, ValueError):
        return name, value


if __name__ == "__main__":
    main()
