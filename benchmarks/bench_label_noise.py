"""Does the noise vector find wrong labels? `python -m benchmarks.bench_label_noise [--seeds 5]`

Decision stumps on three data sets that scikit-learn ships, half of the samples for training with a
share of their labels flipped. Printed, as means over seeds: the area under the ROC curve of |noise|
for finding the flipped labels, and the accuracy of the selected ensemble, sign(Phi beta), on the
other half with true labels. For comparison: the stumps of least error, AdaBoost, and cleanlab with
logistic regression (its accuracy is that of the same model without the samples it trusts least).
"""

import argparse
import itertools
import warnings

import numpy as np
from cleanlab.rank import get_label_quality_scores
from sklearn.datasets import load_breast_cancer, load_digits, load_wine
from sklearn.ensemble import AdaBoostClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import cross_val_predict, train_test_split
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from dcs_jax import select_classifiers

FLIPPED = (0.05, 0.10, 0.20, 0.30)
PAPER = 0.01  # lambda of both penalties
THRESHOLDS = 9  # per feature, at equally spaced quantiles
LEAST_ERROR = 20  # stumps of the ensemble by accumulated error
# (lam / (L lam_noise), lam_noise). With saturated noise the first is the share of all samples by
# which a stump must be right more often than wrong to be selected.
PENALTIES = tuple(itertools.product((0.003, 0.02, 0.1, 0.3), (0.01, 0.3, 1.0)))


def data(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Samples [n, features] and labels in {-1, 1}.

    One wine against the other two, digits 0 to 4 against 5 to 9.
    """
    load = {"breast_cancer": load_breast_cancer, "wine": load_wine, "digits": load_digits}[name]
    samples, target = load(return_X_y=True)
    positive = {"breast_cancer": target == 1, "wine": target == 1, "digits": target < 5}[name]
    return samples, np.where(positive, 1.0, -1.0)


def stumps(train: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Votes of one stump for each feature, threshold and sign: [samples, stumps]."""
    cuts = np.quantile(train, np.linspace(0, 1, THRESHOLDS + 2)[1:-1], axis=0)
    signs = np.where(samples[:, None] > cuts, 1.0, -1.0).reshape(len(samples), -1)
    return np.hstack([signs, -signs])


def one(name: str, part: float, seed: int) -> dict[str, tuple[float, float]]:
    """(AUC, accuracy) of each method; nan where a method has none."""
    samples, truth = data(name)
    train, test, clean, expected = train_test_split(
        samples, truth, test_size=0.5, random_state=seed, stratify=truth
    )
    generator = np.random.default_rng(seed)
    flipped = np.zeros(len(clean), bool)
    flipped[generator.choice(len(clean), round(part * len(clean)), replace=False)] = True
    labels = np.where(flipped, -clean, clean)
    phi, phi_test = stumps(train, train), stumps(train, test)

    def accuracy(score: np.ndarray) -> float:
        return float((np.where(score > 0, 1, -1) == expected).mean())

    results = {}
    share, lam_noise = np.array([(1 / len(labels), PAPER), *PENALTIES]).T
    found = select_classifiers(phi, labels, share * len(labels) * lam_noise, lam_noise, tol=1e-2)
    names = ("paper, both 0.01", *PENALTIES)
    for penalties, beta, noise in zip(names, found.beta, found.noise, strict=True):
        score = phi_test @ np.asarray(beta)
        results[f"l1 {penalties}"] = (
            roc_auc_score(flipped, np.abs(noise)),
            accuracy(score),
        )
    errors = (phi != labels[:, None]).mean(0)
    least = np.argsort(errors, kind="stable")[:LEAST_ERROR]
    alpha = np.log((1 - errors[least]) / np.maximum(errors[least], 1e-3))
    margin = labels * (phi[:, least] @ alpha)
    results["least error"] = (
        roc_auc_score(flipped, -margin),
        accuracy(phi_test[:, least] @ alpha),
    )
    boosted = AdaBoostClassifier(n_estimators=100, random_state=0).fit(train, labels)
    results["AdaBoost"] = (
        roc_auc_score(flipped, -labels * boosted.decision_function(train)),
        accuracy(boosted.decision_function(test)),
    )
    model = make_pipeline(StandardScaler(), LogisticRegression(max_iter=1000))
    classes = (labels > 0).astype(int)
    out_of_sample = cross_val_predict(model, train, classes, cv=5, method="predict_proba")
    quality = get_label_quality_scores(classes, out_of_sample)
    kept = quality > np.quantile(quality, part)
    results["cleanlab"] = (
        roc_auc_score(flipped, -quality),
        accuracy(model.fit(train[kept], labels[kept]).decision_function(test)),
    )
    return results


def main() -> None:
    """Print a table for each data set: AUC / accuracy by share of flipped labels."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    seeds = range(parser.parse_args().seeds)
    warnings.simplefilter("ignore")
    for name in ("breast_cancer", "wine", "digits"):
        table = {part: [one(name, part, seed) for seed in seeds] for part in FLIPPED}
        print(f"\n| {name} | " + " | ".join(f"{part:.0%}" for part in FLIPPED) + " |")
        print("|---" * (len(FLIPPED) + 1) + "|")
        for method in table[FLIPPED[0]][0]:
            means = [np.mean([run[method] for run in table[part]], axis=0) for part in FLIPPED]
            cells = " | ".join(f"{auc:.2f} / {right:.3f}" for auc, right in means)
            print(f"| {method} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
