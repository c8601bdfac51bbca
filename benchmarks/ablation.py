"""What each ingredient of a setting is worth: one change at a time, on the same seeds.

    python -m benchmarks.ablation ROOT --base 'default output_size=initial' --seeds 10

ROOT is a folder of sequences as for `dcs-jax evaluate`. Results are kept in --out: the same command
continues where it was stopped. Prints Markdown; --page also writes the report. --ingredients takes
some of the rows, by their names with commas between.
"""

import argparse
import itertools
from pathlib import Path

from dcs_jax.cli.evaluate import EvaluationBar
from dcs_jax.compilation import cache
from dcs_jax.config import COMPONENTS
from dcs_jax.evaluation import evaluate
from dcs_jax.evaluation.settings import parse_setting, with_changes
from dcs_jax.evaluation.statistics import paired
from dcs_jax.evaluation.summary import Summary, per_seed

INGREDIENTS = {
    "selector": ["selector=l1", "selector=error", "selector=first", "selector=mil"],
    "parts": ["parts=5", "parts=1"],
    "grid": ["canvas=native", "canvas=40"],
    "selectors N": ["selectors=10", "selectors=20", "selectors=40"],
    "pool M": ["pool_size=50", "pool_size=100", "pool_size=200", "pool_size=400"],
    "weak classifier": ["weak=midpoint", "weak=gaussian"],
    "ties": ["tie=first", "tie=error"],
}
# Only of a setting with all components. A choice with commas is several changes at once.
BEYOND = {
    "components": [
        "translation=none",
        "colour=none",
        "scale=none",
        "aspect=none",
        "rotation=none",
        "verification=none,redetection=none",
        "redetection=none",
        ",".join(f"{name}=none" for name in COMPONENTS),
    ],
    "search window": ["window_factor=2.0", "window_factor=2.5", "window_factor=3.0"],
    "window of the filter": ["translation.window_factor=2.5", "translation.window_factor=4.5"],
    "motion prior": ["prior=0.0", "prior=0.6"],
    "smoothing": ["smoothing=0.0", "smoothing=1.5"],
    "translation filter": ["translation.weight=0.0", "translation.weight=15.0"],
    "first frame's filter": ["translation.first_frame=0.0", "translation.first_frame=0.15"],
    "colour": ["colour.weight=0.0", "colour.weight=20.0"],
    "pull to the initial scale": ["scale.initial_pull=0.0", "scale.initial_pull=0.02"],
    "rotation from": [
        "rotation.gain_above=0.15",
        "rotation.gain_above=0.2",
        "rotation.gain_above=0.25",
    ],
    "recent template": ["verification.recent_rate=0.0", "verification.recent_rate=0.07"],
    "learning above": ["verification.learn_above=0.0", "verification.learn_above=0.7"],
    "sure above": ["verification.sure_above=0.4", "verification.sure_above=0.7"],
    "learning from every frame": ["verification.learn_every=1", "verification.learn_every=2"],
    "never missed": ["verification.lost_below=0.0", "verification.lost_below=0.5"],
}


def main() -> None:
    """Run every setting that differs from the base in one ingredient, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("root", type=Path)
    parser.add_argument("--base", default="paper", help="the setting that is changed")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--sequences", help="names with commas between (default: all)")
    parser.add_argument("--ingredients", help="names with commas between (default: all)")
    parser.add_argument("--out", type=Path, default=Path("ablation"))
    parser.add_argument("--page", action="store_true", help="also write index.html")
    arguments = parser.parse_args()
    if arguments.seeds < 2:
        parser.error("--seeds must be at least 2: differences are tested on pairs of seeds")
    cache()
    base = parse_setting(arguments.base).name
    rows = ingredients(base)
    if arguments.ingredients:
        names = arguments.ingredients.split(",")
        if unknown := set(names) - rows.keys():
            parser.error(f"--ingredients must be some of {', '.join(rows)}, not {min(unknown)!r}")
        rows = {name: rows[name] for name in names}
    settings = [base, *changes(base, rows).values()]
    with EvaluationBar() as bar:
        done = evaluate(
            arguments.root,
            arguments.out,
            sequences=arguments.sequences.split(",") if arguments.sequences else None,
            settings=settings,
            seeds=arguments.seeds,
            watch=bar,
        )
    for broken in done.broken:
        print(f"skipped {broken}")
    if done.interrupted:
        raise SystemExit("interrupted: the same command continues from here")
    print(table(done.summary, base, rows))
    if arguments.page:
        from dcs_jax.evaluation.report import write_report

        print(write_report(done.summary, arguments.out / "index.html"))


def ingredients(base: str) -> dict[str, list[str]]:
    """The choices for every ingredient of this setting."""
    config = parse_setting(base).config("")
    has_all = all(getattr(config, name) is not None for name in COMPONENTS)
    return INGREDIENTS | (BEYOND if has_all else {})


def changes(base: str, rows: dict[str, list[str]]) -> dict[str, str]:
    """The setting of each choice that differs from the base; rows: as of `ingredients`."""
    config = parse_setting(base).config("")
    choices = itertools.chain(*rows.values())
    settings = {choice: with_changes([base], [choice])[-1] for choice in choices}
    return {
        choice: setting.name for choice, setting in settings.items() if setting.config("") != config
    }


def table(summary: Summary, base: str, rows: dict[str, list[str]]) -> str:
    """Each ingredient's choices: means, and the difference from the base on the same seeds."""
    sequences = len({sequence for sequence, _ in summary.common})
    of_base, changed = per_seed(summary, base), changes(base, rows)
    lines = [
        f"Base: `{base}`; {len(of_base)} seeds, mean over {sequences} sequences. Differences from "
        "it are on the same seeds, with the 95 % interval and p by permutation of signs.",
        "",
        "| ingredient | choice | centre error, px | success rate | difference, px | p "
        "| difference, success | p |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for ingredient, choices in rows.items():
        for choice in choices:
            setting = changed.get(choice, base)
            is_base = setting == base
            numbers = summary.overall[setting]
            cells = [ingredient, f"`{choice}`" + (" (base)" if is_base else "")]
            cells += [f"{numbers['centre_error'].mean:.1f}", f"{numbers['success_rate'].mean:.3f}"]
            for metric, digits in (("centre_error", 1), ("success_rate", 3)):
                if is_base:
                    cells += ["", ""]
                    continue
                other = per_seed(summary, setting)
                seeds = sorted(of_base.keys() & other.keys())
                values = ([getattr(s[seed], metric) for seed in seeds] for s in (other, of_base))
                test = paired(*values)
                cells.append(
                    f"{test.difference:+.{digits}f} ({test.low:+.{digits}f} to "
                    f"{test.high:+.{digits}f})"
                )
                cells.append(f"{test.p:.3f}")
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
