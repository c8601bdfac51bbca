"""The selection as a public function: certificate, solvers, ties, and what is refused."""

import os
import subprocess
import sys
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference

import dcs_jax
from dcs_jax import Selection, select_classifiers
from dcs_jax.solvers import select

PROBLEMS, ROWS, COLUMNS = 1000, 8, 20


class Batch:
    """Problems with lambdas and sample weights of their own, and their minima."""

    def __init__(self, real: bool) -> None:
        generator = np.random.default_rng(real)
        labels = generator.choice([-1.0, 1.0], (PROBLEMS, ROWS))
        right = generator.choice([-1.0, 1.0], (PROBLEMS, ROWS, COLUMNS), p=[1 / 3, 2 / 3])
        self.votes, self.labels = labels[..., None] * right, labels
        if real:
            self.votes = self.votes + generator.normal(size=self.votes.shape)
            self.labels = labels * generator.uniform(0.5, 2, labels.shape)
        self.lam, self.lam_noise = 10 ** generator.uniform(-2, 0.7, (2, PROBLEMS))
        self.weights = generator.integers(1, 5, (PROBLEMS, ROWS)).astype(float)
        self.minima = np.array(
            [
                self.objective(number, *reference.solve_exactly(*problem))
                for number, problem in enumerate(
                    zip(
                        self.votes,
                        self.labels,
                        self.lam,
                        self.lam_noise,
                        self.weights,
                        strict=True,
                    )
                )
            ]
        )

    def objective(self, number: int, beta: np.ndarray, noise: np.ndarray) -> float:
        residual = self.votes[number] @ beta + noise - self.labels[number]
        rows = residual**2 + self.lam_noise[number] * np.abs(noise)
        return float(self.weights[number] @ rows + self.lam[number] * beta.sum())

    def select(self, **settings) -> Selection:
        return select_classifiers(
            self.votes, self.labels, self.lam, self.lam_noise, self.weights, **settings
        )

    def check(self, found: Selection) -> None:
        """Compare the certificate with the minima, in float64."""
        beta, noise = np.asarray(found.beta, float), np.asarray(found.noise, float)
        assert (beta >= 0).all()
        objective = np.array([self.objective(n, beta[n], noise[n]) for n in range(PROBLEMS)])
        np.testing.assert_allclose(found.objective, objective, rtol=1e-5, atol=1e-6)
        excess = (objective - self.minima) / objective
        # Up to rounding in float32, of the gap and of the objective.
        assert (excess <= np.asarray(found.gap, float) * (1 + 1e-5) + 3e-6).all()
        assert (found.gap >= 0).all()


@pytest.fixture(scope="module", params=[False, True], ids=["signs", "real"])
def batch(request):
    return Batch(request.param)


@pytest.mark.parametrize(
    "settings",
    [
        {"solver": "interior", "tol": None, "max_iterations": 3},
        {"solver": "interior", "tol": 1e-3},
        {"solver": "apg", "tol": None, "max_iterations": 30},
        {"solver": "projected_gradient", "tol": None, "max_iterations": 30},
    ],
    ids=["interior, 3 steps", "interior", "apg", "projected gradient"],
)
def test_the_gap_bounds_the_distance_to_the_minimum(batch, settings):
    batch.check(batch.select(**settings))


def test_the_gap_goes_to_zero(batch):
    found = batch.select(solver="interior")
    assert found.converged.all()
    assert (found.gap <= 1e-3).all()
    with jax.enable_x64(True):
        assert batch.select(solver="interior", tol=1e-9).converged.all()


def test_after_its_best_the_interior_point_method_stays_there(batch):
    found = batch.select(solver="interior", tol=None, max_iterations=60)
    batch.check(found)
    assert (found.gap <= 1e-3).all()


def test_many_classifiers_that_err_alike_converge_too():
    """They take more steps: 53 here, 200 classifiers take 9."""
    generator = np.random.default_rng(0)
    labels = generator.choice([-1.0, 1.0], 100)
    causes = generator.normal(size=(100, 10)) @ generator.normal(size=(10, 20_000))
    noise = generator.normal(size=(100, 20_000))
    votes = np.sign(labels[:, None] * generator.uniform(0, 1, 20_000) + 0.3 * causes + 0.7 * noise)
    wrong = generator.random(100) < 0.15
    found = select_classifiers(votes, np.where(wrong, -labels, labels))
    assert found.converged
    assert found.iterations > 30  # or the problem is too easy for this test


@pytest.mark.parametrize("solver", ["apg", "projected_gradient"])
def test_gradient_methods_reach_a_gap_too(solver):
    found = select_classifiers(*example(), 1.0, solver=solver)
    assert found.converged.all()
    assert (found.iterations % 10 == 0).all()


def example(seed=0, problems=7, rows=30, columns=40) -> tuple[np.ndarray, np.ndarray]:
    """Votes that agree with the labels two times in three."""
    generator = np.random.default_rng(seed)
    labels = generator.choice([-1.0, 1.0], (problems, rows))
    right = generator.choice([-1.0, 1.0], (problems, rows, columns), p=[1 / 3, 2 / 3])
    return (labels[..., None] * right).astype(np.float32), labels.astype(np.float32)


@pytest.mark.filterwarnings("ignore:JAXopt is no longer maintained:DeprecationWarning")
def test_jaxopt_finds_the_same_minimum():
    run = partial(select_classifiers, *example(), 0.3, 0.8, np.arange(30) % 3)
    ours = run(tol=1e-4)
    theirs = run(solver="jaxopt", tol=None, max_iterations=1500)
    np.testing.assert_allclose(ours.objective, theirs.objective, rtol=1e-3)
    assert (ours.objective <= theirs.objective * (1 + 1e-4)).all()


def test_jaxopt_is_imported_only_when_asked_for():
    """In a process of its own, as another test may have imported it."""
    code = """
import sys, warnings
import dcs_jax

assert "jaxopt" not in sys.modules
warnings.simplefilter("ignore", DeprecationWarning)
settings = {"solver": "jaxopt", "tol": None, "max_iterations": 1}
dcs_jax.select_classifiers([[1.0], [-1.0]], [1.0, -1.0], **settings)
assert "jaxopt" in sys.modules
"""
    environment = os.environ | {"PYTHONPATH": os.getcwd()}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)


def test_the_shapes_are_the_promised_ones():
    votes, labels = example(problems=6)
    found = select_classifiers(votes.reshape(2, 3, 30, 40), labels.reshape(2, 3, 30))
    assert found.index.shape == found.gap.shape == found.converged.shape == (2, 3)
    assert found.beta.shape == (2, 3, 40)
    assert found.noise.shape == (2, 3, 30)
    assert found.index.dtype == found.iterations.dtype == jnp.int32
    one = select_classifiers(votes[4], labels[4])
    assert one.index.shape == ()
    np.testing.assert_allclose(one.beta, found.beta[1, 1], atol=1e-5)


def test_leading_dimensions_broadcast():
    votes, labels = example(problems=3)
    lam = np.array([[0.01], [1.0]])
    found = select_classifiers(votes, labels, lam)
    assert found.beta.shape == (2, 3, 40)
    np.testing.assert_allclose(
        found.beta[1], select_classifiers(votes, labels, 1.0).beta, atol=1e-5
    )


def test_jit_vmap_and_scan_give_the_same():
    votes, labels = example()
    run = partial(select_classifiers, lam=0.1, tol=1e-5)
    expected = run(votes, labels)
    for found in (
        jax.jit(run)(votes, labels),
        jax.vmap(run)(votes, labels),
        jax.lax.scan(lambda carry, one: (carry, run(*one)), None, (votes, labels))[1],
    ):
        np.testing.assert_array_equal(found.index, expected.index)
        np.testing.assert_allclose(found.objective, expected.objective, rtol=1e-4)
        assert found.converged.all()


def test_another_lambda_or_tolerance_compiles_nothing():
    votes, labels = example()
    compiled: Any = select._select  # a jitted function, whose type lacks the size of its cache
    numbers: list[Any] = [0.02, np.float32(1), jnp.float32(3)]
    select_classifiers(votes, labels)
    programs = compiled._cache_size()
    for lam in numbers:
        select_classifiers(votes, labels, lam, lam_noise=0.5, tol=lam / 100)
    assert compiled._cache_size() == programs


def test_a_batch_on_two_devices():
    """In a process of its own, as the number of devices is fixed when JAX starts."""
    code = """
import jax, numpy as np
from jax.sharding import NamedSharding, PartitionSpec
from dcs_jax import select_classifiers
from tests.test_select_classifiers import example

votes, labels = example(problems=8)
mesh = jax.make_mesh((2,), ("batch",), axis_types=(jax.sharding.AxisType.Auto,))
votes_there, labels_there = jax.device_put(
    (votes, labels), NamedSharding(mesh, PartitionSpec("batch"))
)
expected = select_classifiers(votes, labels)
found = select_classifiers(votes_there, labels_there)
np.testing.assert_array_equal(found.index, expected.index)
mapped = jax.shard_map(
    select_classifiers, mesh=mesh, in_specs=PartitionSpec("batch"),
    out_specs=PartitionSpec("batch"), check_vma=False,
)
found = jax.jit(mapped)(votes_there, labels_there)
np.testing.assert_array_equal(found.index, expected.index)
assert len(found.beta.sharding.device_set) == 2
"""
    flags = "--xla_force_host_platform_device_count=2"
    environment = os.environ | {"XLA_FLAGS": flags, "PYTHONPATH": f"{os.getcwd()}:tests"}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)


def test_a_start_that_is_good_enough_is_returned():
    votes, labels = example()
    first = select_classifiers(votes, labels, tol=1e-4)
    again = select_classifiers(votes, labels, tol=0.5, start=first.beta)
    assert (again.objective <= first.objective * (1 + 1e-6)).all()


def test_a_start_saves_apg_iterations():
    votes, labels = example()
    cold = select_classifiers(votes, labels, 1.0, solver="apg")
    warm = select_classifiers(votes, labels, 1.0, solver="apg", start=cold.beta)
    assert 2 * warm.iterations.sum() < cold.iterations.sum()


def test_in_float64_the_gap_goes_further():
    votes, labels = example()
    with jax.enable_x64(True):
        found = select_classifiers(votes.astype(float), labels, tol=1e-10)
        single = select_classifiers(votes, labels)
    assert found.beta.dtype == found.gap.dtype == np.float64
    assert found.converged.all()
    assert single.beta.dtype == np.float32


def test_a_count_may_be_numpys():
    votes, labels = example()
    found = select_classifiers(votes, labels, tol=None, max_iterations=np.arange(5, 7)[0])
    assert (found.iterations == 5).all()


# Ties


def three_equal() -> tuple[np.ndarray, np.ndarray]:
    """One wrong column, three perfect ones."""
    labels = np.array([1.0, -1.0, 1.0, 1.0])
    return np.stack([-labels, labels, labels, labels], axis=-1), labels


@pytest.mark.parametrize("solver", ["interior", "apg"])
def test_the_first_of_equal_columns_is_taken(solver):
    found = select_classifiers(*three_equal(), solver=solver)
    assert found.index == 1
    np.testing.assert_allclose(found.beta[1:], found.beta[1], rtol=1e-3)


def test_the_one_with_the_least_error_is_taken():
    errors = [0.0, 0.3, 0.2, 0.2]
    assert select_classifiers(*three_equal(), tie="error", errors=errors).index == 2


def test_any_of_the_equal_columns_is_taken_at_random():
    votes, labels = three_equal()
    many = np.broadcast_to(votes, (3000, 4, 4))
    found = select_classifiers(many, labels, tie="random", key=jax.random.key(0))
    share = np.bincount(found.index, minlength=4) / 3000
    np.testing.assert_allclose(share, [0, 1 / 3, 1 / 3, 1 / 3], atol=0.04)


# Degenerate input

SOLVERS = pytest.mark.parametrize("solver", ["interior", "apg"])


@SOLVERS
def test_one_row(solver):
    found = select_classifiers([[-1.0, 1.0]], [1.0], solver=solver)
    assert found.index == 1
    assert found.converged


@SOLVERS
def test_one_classifier(solver):
    found = select_classifiers([[1.0], [-1.0], [1.0], [1.0]], [1.0, -1.0, 1.0, -1.0], solver=solver)
    assert found.index == 0
    assert found.converged
    # Three votes of four are right: they are believed, the fourth label is not.
    np.testing.assert_allclose(found.noise, [0, 0, 0, -2], atol=0.02)


@SOLVERS
def test_a_zero_column_is_never_taken(solver):
    votes, labels = example()
    votes[..., 0] = 0
    found = select_classifiers(votes, labels, 1.0, solver=solver)
    assert found.index.all()
    assert found.converged.all()
    assert (found.beta[:, 0] <= 1e-3 * found.beta.max(-1)).all()


@SOLVERS
def test_all_columns_zero(solver):
    found = select_classifiers(np.zeros((4, 1)), np.ones(4), solver=solver)
    assert found.index == 0
    assert found.converged
    np.testing.assert_allclose(found.noise, np.full(4, 0.995))


@SOLVERS
def test_equal_columns_share_their_coefficient(solver):
    votes, labels = example(columns=20)
    found = select_classifiers(np.tile(votes, 2), labels, 1.0, solver=solver, tol=1e-4)
    once = select_classifiers(votes, labels, 1.0, tol=1e-4)
    np.testing.assert_allclose(found.beta[:, :20], found.beta[:, 20:], atol=1e-4)
    np.testing.assert_allclose(found.objective, once.objective, rtol=2e-4)


@SOLVERS
def test_all_labels_equal(solver):
    votes, _ = example()
    votes[..., 3] = 1
    found = select_classifiers(votes, np.ones((7, 30)), 1.0, solver=solver)
    assert (found.index == 3).all()
    assert found.converged.all()


@pytest.mark.parametrize("lam_noise", [None, 1.0])
def test_lambda_zero(lam_noise):
    votes, labels = example(problems=1)
    found = select_classifiers(votes, labels, 0.0, lam_noise)
    beta, noise = reference.solve_exactly(votes[0].astype(float), labels[0], 0.0, lam_noise or 0.0)
    residual = votes[0] @ beta + noise - labels[0]
    minimum = residual @ residual + (lam_noise or 0) * np.abs(noise).sum()
    np.testing.assert_allclose(found.objective, minimum, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("solver", ["interior", "apg", "projected_gradient"])
def test_a_lambda_that_leaves_nothing_takes_the_best_correlated(solver):
    votes, labels = example()
    found = select_classifiers(votes, labels, 1000.0, solver=solver)
    assert not found.beta.any()
    assert found.converged.all()
    assert (found.iterations == 0).all()
    np.testing.assert_array_equal(found.index, np.einsum("blm,bl->bm", votes, labels).argmax(-1))


def test_columns_of_very_different_norm():
    votes, labels = example(columns=20)
    scale = 10 ** np.linspace(-4, 4, 20)
    found = select_classifiers(votes * scale, labels, 0.01)
    assert found.converged.all()


@SOLVERS
def test_a_row_of_weight_zero_is_as_good_as_absent(solver):
    votes, labels = example()
    weights = np.arange(30) % 2
    found = select_classifiers(votes, labels, 1.0, weights=weights, solver=solver, tol=1e-4)
    short = select_classifiers(votes[:, 1::2], labels[:, 1::2], 1.0, tol=1e-4)
    np.testing.assert_allclose(found.objective, short.objective, rtol=2e-4)
    assert found.converged.all()


def test_all_weights_zero():
    found = select_classifiers(*example(), weights=np.zeros(30))
    assert found.converged.all()
    assert not found.objective.any()


VOTES, LABELS = np.ones((5, 3)), np.ones(5)
NAN = np.array([1, np.nan, 1, np.inf, 1])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"votes": np.ones(3)}, r"votes must be \[\.\.\., L, M\] and not empty, not \(3,\)"),
        ({"votes": np.ones((0, 3))}, r"not empty, not \(0, 3\)"),
        ({"votes": [[1.0, 1.0], [1.0]]}, r"votes must be \[\.\.\., L, M\], but is \[\[1.0, 1.0\]"),
        ({"votes": VOTES * 1j}, "votes must be real numbers, but is complex128"),
        ({"votes": VOTES * NAN[:, None]}, "votes must be finite, but 6 of its 15 values are not"),
        ({"labels": np.ones(4)}, r"labels must have the shape \[\.\.\., 5\], but has \(4,\)"),
        ({"labels": NAN}, "labels must be finite, but 2 of its 5 values are not .*: nan, inf"),
        (
            {"labels": LABELS * 1e39},
            r"labels must be finite, .* not \(in float32\): 1e\+39, 1e\+39",
        ),
        ({"labels": "abc"}, "labels must be real numbers"),
        ({"lam": -0.5}, "lam must be finite and at least 0, but 1 of its 1 values is not .*: -0.5"),
        ({"lam": np.inf}, "lam must be finite"),
        ({"lam_noise": -1}, "lam_noise must be finite and at least 0"),
        ({"weights": -LABELS}, "weights must be finite and at least 0, but 5 .* -1.0, -1.0"),
        ({"weights": np.ones(3)}, r"weights must have the shape \[\.\.\., 5\]"),
        ({"start": -np.ones(3)}, "start must be finite and at least 0"),
        ({"tol": -1.0}, "tol must be finite and at least 0"),
        ({"tol": [1e-3, 1e-4]}, r"tol must be one number for all problems, but has \(2,\)"),
        ({"tol": None}, "tol=None stops after max_iterations"),
        ({"max_iterations": 0}, "max_iterations must be an integer of at least 1, but is 0"),
        ({"max_iterations": 3.0}, "max_iterations must be an integer of at least 1, but is 3.0"),
        ({"solver": "simplex"}, "solver must be one of 'auto', .* but is 'simplex'"),
        ({"tie": "last"}, "tie must be one of 'first', 'error', 'random', but is 'last'"),
        ({"tie": "error"}, "errors goes with tie='error' only, but is missing at tie='error'"),
        ({"errors": np.ones(3)}, "errors goes with tie='error' only, but is given at tie='first'"),
        ({"tie": "random"}, "key goes with tie='random' only, but is missing"),
        ({"tie": "random", "key": 3}, r"key must be made by jax\.random\.key"),
        ({"votes": np.ones((2, 5, 3)), "lam": np.ones(3)}, "leading dimensions must broadcast"),
        (
            {"tie": "error", "errors": np.ones((2, 3))},
            r"errors must have .* of the problems, \(\), but has the shape \(2, 3\)",
        ),
        ({"labels": jax.random.key(0)}, "labels must be real numbers, but is key"),
        ({"tol": [[1], [1, 2]]}, "tol must be an array of numbers"),
    ],
)
def test_bad_arguments_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        dcs_jax.select_classifiers(**({"votes": VOTES, "labels": LABELS} | arguments))
