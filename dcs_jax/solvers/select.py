"""`select_classifiers`, the public function: a few classifiers for samples with wrong labels."""

import functools
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32

from dcs_jax.checks import as_numbers, check_choice, check_count, check_key, shown
from dcs_jax.solvers import apg, interior, jaxopt, projected_gradient
from dcs_jax.solvers.iterate import Method, Solved, iterate
from dcs_jax.solvers.problem import Problem
from dcs_jax.solvers.ties import is_maximum

Solver = Literal["auto", "apg", "interior", "projected_gradient", "jaxopt"]
Tie = Literal["first", "error", "random"]
Real = jax.Array | np.ndarray | Sequence[Any]
Penalty = float | jax.Array | np.ndarray


class _Settings(NamedTuple):
    """A solver's method, and how it is run.

    every: iterations between two looks at the gap. most: default maximum of iterations.
    block: approximate number of votes of the problems that are solved at once.
    """

    method: Callable[[Problem, Float[Array, " M"]], Method]
    every: int
    most: int
    block: int


# A look at the gap costs the gradient methods as much as an iteration, the interior point method
# next to nothing. By the latter, 100 problems of 100 x 200 take 155 ms one by one, 180 in tens and
# 310 all at once, where the slowest keeps the others waiting; 30 iterations of apg on 100 problems
# of 5 x 200 take 2.5 ms in twenties, 1.5 all at once.
_SOLVERS = {
    "apg": _Settings(apg.method, every=10, most=20_000, block=200_000),
    "interior": _Settings(interior.method, every=1, most=100, block=20_000),
    "projected_gradient": _Settings(
        projected_gradient.method, every=10, most=20_000, block=200_000
    ),
    "jaxopt": _Settings(jaxopt.method, every=10, most=20_000, block=20_000),
}


class Selection(NamedTuple):
    """What `select_classifiers` found; [...] are the leading dimensions of its arguments.

    index: [...] int32 in [0, M), the selected classifier: the largest coefficient under the tie
        rule; where all are 0, the classifier with the largest sum_l w_l phi_lm y_l.
    beta: [..., M] coefficients, not negative.
    noise: [..., L] e, the model's correction of each sample's label; 0 where it is believed.
    objective: [...] value of the problem at beta and noise, not negative.
    gap: [...] duality gap relative to the objective: an upper bound of
        (objective - minimum) / objective. Where the objective is below 1e-6 of that of beta = 0,
        the gap is relative to this 1e-6.
    iterations: [...] int32, iterations of the solver.
    converged: [...] bool, true where the gap is at most `tol`.
    """

    index: Int32[Array, "..."]  # type: ignore[assignment]  # hides tuple.index
    beta: Float[Array, "... M"]
    noise: Float[Array, "... L"]
    objective: Float[Array, "..."]
    gap: Float[Array, "..."]
    iterations: Int32[Array, "..."]
    converged: Bool[Array, "..."]


def select_classifiers(
    votes: Real,
    labels: Real,
    lam: Penalty = 0.01,
    lam_noise: Penalty | None = None,
    weights: Real | None = None,
    *,
    solver: Solver = "auto",
    tol: float | None = 1e-3,
    max_iterations: int | None = None,
    tie: Tie = "first",
    errors: Real | None = None,
    key: jax.Array | None = None,
    start: Real | None = None,
) -> Selection:
    """Select classifiers by non-negative l1 minimisation; a sparse vector absorbs wrong labels.

        min over beta >= 0, e of
            sum_l w_l [(phi_l' beta + e_l - y_l)^2 + lam_noise |e_l|] + lam sum_m beta_m

    These are the paper's eq. 14 and 15, with multiplicities w of the samples and a penalty of its
    own for the noise. Any leading dimensions [...] are a batch of problems; they broadcast.

    votes: [..., L, M] real, the votes phi of M classifiers on L samples, -1 and 1 in the paper.
    labels: [..., L] real, y.
    lam, lam_noise: [...] weights of the penalties, finite and not negative; `lam_noise` None: lam,
        the paper's choice. Another value compiles nothing.
    weights: [..., L] not negative, number of samples that each sample stands for; None: one.
    solver: method: "interior", a primal-dual interior point method; "apg", the tracker's
        accelerated proximal gradient; "auto", the first with a tolerance and the second without, as
        at every shape measured the first reaches the gap sooner; for comparison,
        "projected_gradient" and "jaxopt", the proximal gradient of that package, imported on use.
    tol: duality gap to stop at; None: stop after `max_iterations` only.
    max_iterations: maximum of iterations, by default 100 of "interior" and 20 000 of the others.
        With a tolerance it is rounded up to the iterations between two looks at the gap: 1 and 10.
    tie: rule that chooses among the largest coefficients, equal within a relative tolerance of
        1e-3: "first", the first one; "error", the one of least `errors`; "random", any with the
        same probability. In the tracker (paper setting on the canvas, seven sequences, 10 seeds)
        the success rate is 0.88 with "first", 0.61 with "error", which prefers the same few
        classifiers in every frame, and 0.89 with "random".
    errors: [..., M] real, with tie="error" only.
    key: random key, with tie="random" only.
    start: [..., M] not negative, coefficients to start from, such as those for another lambda.
        "interior" has a start of its own; it returns these only if they are good enough already.

    Works under jit, vmap, scan and sharding, in the type of `votes`: float64, or else float32.

    With lam = 0 the coefficients are free, and rounding often keeps the gap above `tol`:
    `converged` is then false. With lam_noise = 0 the noise takes up all labels: beta = 0, e = y.
    beta is also 0 where, for all m, lam is at least
    2 sum_l w_l phi_lm clip(y_l, -lam_noise / 2, lam_noise / 2).

    Raises ValueError where an argument is not as stated; inside a transformation, where values are
    not known, only for shapes.
    """
    check_choice("solver", solver, get_args(Solver))
    check_choice("tie", tie, get_args(Tie))
    for name, value, rule in (("errors", errors, "error"), ("key", key, "random")):
        if (value is not None) != (tie == rule):
            state = "missing" if value is None else "given"
            raise ValueError(f"{name} goes with tie={rule!r} only, but is {state} at tie={tie!r}")
    if key is not None:
        check_key(key)
    if tol is None and max_iterations is None:
        raise ValueError("tol=None stops after max_iterations, but max_iterations is None, too")
    if max_iterations is not None:
        check_count("max_iterations", max_iterations)
    try:
        shape = np.shape(votes)
    except ValueError:  # lists of different lengths
        raise ValueError(f"votes must be [..., L, M], but is {shown(votes)}") from None
    if len(shape) < 2 or 0 in shape:
        raise ValueError(f"votes must be [..., L, M] and not empty, not {shape}")
    rows, columns = shape[-2:]
    double = getattr(votes, "dtype", None) == np.float64 and jax.config.read("jax_enable_x64")
    dtype = jnp.dtype("float64" if double else "float32")
    weights = np.ones(rows, np.float32) if weights is None else weights
    lam_noise = lam if lam_noise is None else lam_noise
    coefficients = np.zeros(columns, np.float32) if start is None else start
    problems = _Problems(
        as_numbers("votes", votes, dtype, (rows, columns)),
        as_numbers("labels", labels, dtype, (rows,)),
        as_numbers("weights", weights, dtype, (rows,), least=0),
        as_numbers("lam", lam, dtype, (), least=0),
        as_numbers("lam_noise", lam_noise, dtype, (), least=0),
        as_numbers("start", coefficients, dtype, (columns,), least=0),
    )
    if errors is not None:
        errors = as_numbers("errors", errors, dtype, (columns,))
    # No gap is below -1: the solver stops only after its iterations.
    limit = jnp.asarray(-1, dtype) if tol is None else as_numbers("tol", tol, dtype, (), least=0)
    if limit.ndim:
        raise ValueError(f"tol must be one number for all problems, but has {limit.shape}")
    if solver == "auto":
        solver = "apg" if tol is None else "interior"
    return _select(
        problems,
        limit,
        errors,
        key,
        solver=solver,
        most=_SOLVERS[solver].most if max_iterations is None else int(max_iterations),
        fixed=tol is None,
        started=start is not None,
        tie=tie,
    )


class _Problems(NamedTuple):
    """One problem, or a batch of problems with leading dimensions."""

    votes: Float[Array, "*batch L M"]
    labels: Float[Array, "*batch L"]
    weights: Float[Array, "*batch L"]
    lam: Float[Array, "*batch"]
    lam_noise: Float[Array, "*batch"]
    start: Float[Array, "*batch M"]


def _broadcast(problems: _Problems) -> _Problems:
    """The problems with equal leading dimensions; ValueError where they do not broadcast."""
    sizes = (2, 1, 1, 0, 0, 1)
    leading = [
        array.shape[: array.ndim - size] for array, size in zip(problems, sizes, strict=True)
    ]
    try:
        batch = np.broadcast_shapes(*leading)
    except ValueError:
        shapes = ", ".join(f"{name} {x.shape}" for name, x in problems._asdict().items())
        raise ValueError(
            f"leading dimensions must broadcast, but the shapes are {shapes}"
        ) from None
    return _Problems(
        *(
            jnp.broadcast_to(array, batch + array.shape[array.ndim - size :])
            for array, size in zip(problems, sizes, strict=True)
        )
    )


@functools.partial(jax.jit, static_argnames=("solver", "most", "fixed", "started", "tie"))
def _select(
    problems: _Problems,
    tol: Float[Array, ""],
    errors: Float[Array, "..."] | None,
    key: jax.Array | None,
    *,
    solver: str,
    most: int,
    fixed: bool,
    started: bool,
    tie: str,
) -> Selection:
    """`select_classifiers` of checked arguments, compiled."""
    problems = _broadcast(problems)
    rows, columns = problems.votes.shape[-2:]
    batch = problems.lam.shape
    flat = jax.tree.map(lambda x: x.reshape(-1, *x.shape[len(batch) :]), problems)
    settings = _SOLVERS[solver]
    every = most if fixed and solver != "interior" else min(settings.every, most)

    def solve(one: _Problems) -> Solved:
        problem = Problem(
            one.votes, jnp.ones_like(one.start), one.labels, one.weights, one.lam, one.lam_noise
        )
        method = settings.method(problem, one.start)
        return iterate(problem, method, one.start if started else None, tol, most, every)

    block = max(1, settings.block // (rows * columns))
    # By default accelerators multiply float32 in a lower precision, which limits the gap.
    with jax.default_matmul_precision("highest"):
        found = jax.lax.map(solve, flat, batch_size=min(block, flat.lam.size))
        # b: problems, l: samples, m: classifiers
        correlation = jnp.einsum("blm,bl->bm", flat.votes, flat.weights * flat.labels)
    found = jax.tree.map(lambda x: x.reshape(*batch, *x.shape[1:]), found)
    all_zero = ~(found.beta > 0).any(-1, keepdims=True)
    scores = jnp.where(all_zero, correlation.reshape(*batch, columns), found.beta)
    tied = jnp.moveaxis(is_maximum(jnp.moveaxis(scores, -1, 0)), 0, -1)
    match tie:
        case "first":
            preference = -jnp.arange(columns, dtype=tol.dtype)
        case "error":
            assert errors is not None
            try:
                preference = jnp.broadcast_to(-errors, tied.shape)
            except ValueError:
                raise ValueError(
                    f"errors must have leading dimensions that broadcast to those of the problems, "
                    f"{batch}, but has the shape {errors.shape}"
                ) from None
        case "random":
            assert key is not None
            preference = jax.random.uniform(key, tied.shape, tol.dtype)
    index = jnp.argmax(jnp.where(tied, preference, -jnp.inf), axis=-1).astype(jnp.int32)
    return Selection(index, **found._asdict(), converged=found.gap <= jnp.maximum(tol, 0))
