"""The solver of the selection problem against independent ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st

from dcs_jax.solvers import apg
from dcs_jax.solvers.problem import Problem, objective

lambdas = st.sampled_from([0.01, 0.1, 1.0, 5.0])


def random_problem(seed: int, rows: int, columns: int, lam: float) -> Problem:
    """Votes that agree with the labels two times in three, every row and column once."""
    generator = np.random.default_rng(seed)
    labels = generator.choice([-1.0, 1.0], rows)
    votes = labels[:, None] * generator.choice([-1.0, 1.0], (rows, columns), p=[1 / 3, 2 / 3])
    return Problem(
        jnp.asarray(votes, jnp.float32),
        jnp.ones(columns),
        jnp.asarray(labels, jnp.float32),
        jnp.ones(rows),
        jnp.float32(lam),
    )


solve = jax.jit(apg.solve, static_argnums=1)


@given(seed=st.integers(0, 2**31), lam=lambdas)
def test_objective_reaches_that_of_an_exact_solver(seed, lam):
    problem = random_problem(seed, 8, 20, lam)
    phi, labels = np.asarray(problem.votes, float), np.asarray(problem.labels, float)
    beta, noise = reference.solve_exactly(phi, labels, lam)
    best = reference.objective(phi, labels, lam, beta, noise)
    solution = solve(problem, 3000)
    reached = reference.objective(phi, labels, lam, *(np.asarray(x, float) for x in solution))
    assert best - 1e-6 <= reached <= best * (1 + 1e-4)
    assert objective(problem, solution) == pytest.approx(reached, rel=1e-4)


@given(seed=st.integers(0, 2**31), lam=lambdas)
def test_at_the_optimum_the_objective_is_the_huber_form(seed, lam):
    problem = random_problem(seed, 8, 20, lam)
    solution = solve(problem, 3000)
    huber = reference.huber_objective(
        np.asarray(problem.votes, float),
        np.asarray(problem.labels, float),
        lam,
        np.asarray(solution.beta, float),
    )
    assert objective(problem, solution) == pytest.approx(huber, rel=1e-4)


@given(seed=st.integers(0, 2**31), lam=lambdas, iterations=st.sampled_from([1, 10, 30]))
def test_iterates_are_those_of_the_reference(seed, lam, iterations):
    problem = random_problem(seed, 8, 20, lam)
    phi, labels = np.asarray(problem.votes, float), np.asarray(problem.labels, float)
    beta, noise = reference.fista(phi, labels, lam, iterations)
    solution = solve(problem, iterations)
    np.testing.assert_allclose(solution.beta, beta, atol=1e-5)
    np.testing.assert_allclose(solution.noise, noise, atol=1e-5)


@given(seed=st.integers(0, 2**31), lam=lambdas, iterations=st.sampled_from([1, 10, 30]))
def test_equal_rows_and_columns_may_be_given_once_with_their_number(seed, lam, iterations):
    distinct = random_problem(seed, 5, 6, lam)
    row_counts, column_counts = np.array([4, 1, 1, 1, 1]), np.array([1, 3, 0, 2, 1, 5])
    counted = distinct._replace(
        weights=jnp.asarray(row_counts, jnp.float32), counts=jnp.asarray(column_counts, jnp.float32)
    )
    votes = np.repeat(np.repeat(distinct.votes, row_counts, axis=0), column_counts, axis=1)
    labels = np.repeat(distinct.labels, row_counts)
    written_out = Problem(
        jnp.asarray(votes), jnp.ones(12), jnp.asarray(labels), jnp.ones(8), distinct.lam
    )
    short, long = solve(counted, iterations), solve(written_out, iterations)
    present = column_counts > 0
    np.testing.assert_allclose(
        np.repeat(short.beta[present], column_counts[present]), long.beta, atol=1e-5
    )
    np.testing.assert_allclose(np.repeat(short.noise, row_counts), long.noise, atol=1e-5)
    np.testing.assert_allclose(
        objective(counted, short), objective(written_out, long), rtol=1e-5, atol=1e-5
    )


def test_a_large_lambda_leaves_nothing():
    problem = random_problem(0, 8, 20, 16.0)  # 2 L
    solution = solve(problem, 30)
    assert not solution.beta.any()
    assert not solution.noise.any()


def test_a_batch_of_problems_is_solved_at_once():
    problems = [random_problem(seed, 8, 20, 0.1) for seed in range(3)]
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *problems)
    solutions = jax.vmap(lambda problem: apg.solve(problem, 10))(batch)
    for number, problem in enumerate(problems):
        np.testing.assert_allclose(solutions.beta[number], solve(problem, 10).beta, atol=1e-5)


def test_problems_may_differ_in_their_counts_only():
    distinct = random_problem(0, 5, 6, 0.1)
    counts = jnp.asarray(np.random.default_rng(0).integers(0, 5, (6, 3)), jnp.float32)
    together = solve(distinct._replace(counts=counts), 10)
    for number in range(3):
        alone = solve(distinct._replace(counts=counts[:, number]), 10)
        np.testing.assert_allclose(together.beta[:, number], alone.beta, atol=1e-6)
        np.testing.assert_allclose(together.noise[:, number], alone.noise, atol=1e-6)
