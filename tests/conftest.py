"""How every test runs: shapes checked at run time, strict promotion, compiled programs kept."""

import os
from pathlib import Path

# JAX reads these when it is imported, which the hook below does.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parents[1] / ".jax_cache"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")
os.environ.setdefault("JAX_NUMPY_DTYPE_PROMOTION", "strict")

from jaxtyping import install_import_hook

# Not config, which JAX rebuilds around placeholders of any type, nor what users call, which has
# checks of its own: runners and solvers.select.
_SOLVERS = ("apg", "certificate", "interior", "iterate", "jaxopt", "problem", "projected_gradient")
_CHECKED = ("core", "extensions", "tracker", "solvers.ties", *(f"solvers.{s}" for s in _SOLVERS))
install_import_hook([f"dcs_jax.{module}" for module in _CHECKED], "beartype.beartype")

import jax
import pytest
from hypothesis import settings

from dcs_jax import tracker

# The first example of each shape compiles. The same examples every time: a failure is reproducible.
settings.register_profile("default", deadline=None, derandomize=True, max_examples=25)
settings.load_profile("default")


@pytest.fixture
def traces(monkeypatch):
    """How often `init` and `step` have been traced since the test began: a dict of counts."""
    counts = {"init": 0, "step": 0}

    def counted(name, function):
        def count(*arguments):
            counts[name] += 1
            return function(*arguments)

        return count

    for name in counts:
        monkeypatch.setattr(tracker, name, counted(name, getattr(tracker, name)))
    return counts


@pytest.fixture(scope="module", autouse=True)
def compiled_programs_are_let_go():
    """With those of all modules kept, XLA has crashed as it wrote one more to its cache."""
    yield
    jax.clear_caches()
