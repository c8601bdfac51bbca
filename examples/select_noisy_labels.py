"""Choose among voters when some labels are wrong, and say which labels are not believed.

python examples/select_noisy_labels.py
"""

import numpy as np

import dcs_jax


def main(rows: int = 100, voters: int = 40, flipped: int = 8) -> float:
    """Returns the share of the flipped labels among those that are believed the least."""
    random = np.random.default_rng(0)
    truth = random.choice([-1.0, 1.0], rows)
    right = random.random((rows, voters)) < np.linspace(0.55, 0.95, voters)  # the last are the best
    votes = np.where(right, truth[:, None], -truth[:, None]).astype(np.float32)
    labels = truth.astype(np.float32)
    wrong = random.choice(rows, flipped, replace=False)
    labels[wrong] *= -1
    # A weight of its own for the noise: one for both lets the ensemble learn wrong labels.
    found = dcs_jax.select_classifiers(votes, labels, lam=0.02 * rows, lam_noise=1.0)
    least = np.argsort(-np.abs(np.asarray(found.noise)))[:flipped]
    share = float(np.isin(least, wrong).mean())
    print(f"voter {int(found.index)} of {voters}, proved within {float(found.gap):.1e}")
    print(f"of the {flipped} labels that are believed the least {share:.0%} had been flipped")
    return share


if __name__ == "__main__":
    main()
