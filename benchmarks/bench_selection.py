"""The selection solvers side by side: pytest benchmarks/bench_selection.py

Problems have correlated votes, 15 % flipped labels and lambda = 0.01, the same in every run. With
the time, `extra_info` holds the quality reached: `gap`, the distance of the worst problem's
objective to its minimum, relative to the minimum (the same measure for every solver, in float64),
and the solver's own certificate where it has one. Solvers of one problem at a time get five.
"""

import warnings

import jax
import numpy as np
import pytest

from dcs_jax import select_classifiers

LAM = 0.01
pytestmark = pytest.mark.filterwarnings("ignore:JAXopt is no longer maintained:DeprecationWarning")


def problems(number: int, rows: int, columns: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Votes [number, rows, columns] of classifiers that share ten causes of error, and labels."""
    generator = np.random.default_rng(seed)
    truth = generator.choice([-1.0, 1.0], (number, rows))
    causes = generator.normal(size=(number, rows, 10)) @ generator.normal(
        size=(number, 10, columns)
    )
    skill = generator.uniform(0, 1, (number, 1, columns))
    score = truth[..., None] * skill + 0.3 * causes
    score += 0.7 * generator.normal(size=score.shape)
    labels = np.where(generator.random((number, rows)) < 0.15, -truth, truth)
    return np.where(score > 0, 1, -1).astype(np.float32), labels.astype(np.float32)


def objectives(votes: np.ndarray, labels: np.ndarray, beta: np.ndarray) -> np.ndarray:
    """Objective of each problem with the best noise, in float64."""
    residual = np.abs(labels - np.einsum("blm,bm->bl", votes.astype(float), beta))
    limit = LAM / 2
    huber = np.where(residual <= limit, residual**2, limit * (2 * residual - limit))
    return huber.sum(-1) + LAM * beta.sum(-1)


def best(votes: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """The objectives at a duality gap of 1e-7, in float64."""
    with jax.enable_x64(True):
        found = select_classifiers(votes.astype(float), labels, LAM, tol=1e-7)
        assert found.converged.all()
        return np.asarray(found.objective)


def record(benchmark, votes, labels, beta, found=None) -> None:
    least = best(votes, labels)
    reached = objectives(votes, labels, np.asarray(beta, float))
    benchmark.extra_info["problems"] = len(votes)
    benchmark.extra_info["gap"] = float(((reached - least) / least).max())
    if found is not None:
        benchmark.extra_info["certificate"] = float(found.gap.max())
        benchmark.extra_info["iterations"] = float(found.iterations.mean())


def run(benchmark, votes, labels, rounds=5, **settings):
    """Time `select_classifiers` on arrays that are on the device already."""
    votes_there, labels_there = jax.device_put((votes, labels))
    found = benchmark.pedantic(
        lambda: jax.block_until_ready(
            select_classifiers(votes_there, labels_there, LAM, **settings)
        ),
        rounds=rounds,
        warmup_rounds=1,
    )
    record(benchmark, votes, labels, found.beta, found)


@pytest.mark.parametrize(
    "settings",
    [
        {"solver": "interior", "tol": 1e-3},
        {"solver": "interior", "tol": 1e-4},
        {"solver": "apg", "tol": None, "max_iterations": 100},
        {"solver": "apg", "tol": None, "max_iterations": 1000},
        {"solver": "projected_gradient", "tol": None, "max_iterations": 1000},
        {"solver": "jaxopt", "tol": None, "max_iterations": 100},
        {"solver": "jaxopt", "tol": None, "max_iterations": 1000},
    ],
    ids=lambda settings: f"{settings['solver']}-{settings.get('max_iterations', settings['tol'])}",
)
def test_100_of_100_x_200(benchmark, settings):
    run(benchmark, *problems(100, 100, 200), rounds=3, **settings)


def stacked(votes: np.ndarray) -> np.ndarray:
    """W = [Phi I -I], in the memory order coordinate descent wants."""
    identity = np.eye(votes.shape[0])
    return np.asfortranarray(np.hstack([votes, identity, -identity]))


def _sklearn(tol: float):
    from sklearn.linear_model import Lasso

    return Lasso(positive=True, fit_intercept=False, tol=tol, max_iter=1_000_000, alpha=1.0)


def _celer(tol: float):
    from celer import Lasso

    return Lasso(positive=True, fit_intercept=False, tol=tol, max_iter=1000, alpha=1.0)


def _skglm(tol: float):
    from skglm import Lasso

    return Lasso(positive=True, fit_intercept=False, tol=tol, max_iter=1000, alpha=1.0)


# Tolerances are in units of each package: the loosest powers of ten with a gap of at most 1e-4.
@pytest.mark.parametrize(
    ("make", "tol"),
    [(_sklearn, 1e-5), (_celer, 1e-5), (_skglm, 1e-6)],
    ids=["sklearn", "celer", "skglm"],
)
def test_one_by_one_of_100_x_200(benchmark, make, tol):
    """Their problem is ||W c - y||^2 / (2 L) + alpha sum c: alpha = lambda / (2 L)."""
    votes, labels = (array[:5] for array in problems(100, 100, 200))
    matrices = [stacked(phi) for phi in votes]
    model = make(tol)
    model.alpha = LAM / (2 * votes.shape[1])

    def solve():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return np.stack(
                [
                    model.fit(w, y.astype(float)).coef_[: votes.shape[2]].copy()
                    for w, y in zip(matrices, labels, strict=True)
                ]
            )

    beta = benchmark.pedantic(solve, rounds=2, warmup_rounds=1)
    record(benchmark, votes, labels, beta)


@pytest.mark.parametrize("settings", [{"tol": 1e-3}, {"tol": None, "max_iterations": 30}])
def test_100_of_the_tracker(benchmark, settings):
    """L = 8 samples, R = 5 distinct ones."""
    votes, labels = problems(100, 5, 200)
    votes_there, labels_there = jax.device_put((votes, labels))
    weights = jax.device_put(np.array([4, 1, 1, 1, 1], np.float32))
    found = benchmark.pedantic(
        lambda: jax.block_until_ready(
            select_classifiers(votes_there, labels_there, LAM, weights=weights, **settings)
        ),
        rounds=30,
        warmup_rounds=2,
    )
    benchmark.extra_info["certificate"] = float(found.gap.max())


@pytest.mark.parametrize(
    ("number", "rows", "columns"),
    [
        *((10, rows, 200) for rows in (8, 25, 80, 250, 800)),
        *((10, 100, columns) for columns in (50, 1000, 5000)),
        (1, 100, 20_000),
        *((number, 50, 100) for number in (1, 10, 100, 1000)),
    ],
)
def test_growth(benchmark, number, rows, columns):
    run(benchmark, *problems(number, rows, columns), rounds=2, tol=1e-3)
