"""How every test runs: shapes checked at run time, strict promotion, compiled programs kept."""

import contextlib
import os
import signal
import subprocess
from pathlib import Path

# JAX reads these when it is imported, which the hook below does.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parents[1] / ".jax_cache"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")
os.environ.setdefault("JAX_NUMPY_DTYPE_PROMOTION", "strict")

from jaxtyping import install_import_hook

# Not what users call, which has checks of its own: config, tracker, runners and solvers.select.
_SOLVERS = ("apg", "certificate", "interior", "iterate", "jaxopt", "problem", "projected_gradient")
_CHECKED = ("core", "extensions", "solvers.ties", *(f"solvers.{s}" for s in _SOLVERS))
install_import_hook([f"dcs_jax.{module}" for module in _CHECKED], "beartype.beartype")

import jax
import pytest
from hypothesis import settings

from dcs_jax import tracker

# The first example of each shape compiles. The same examples every time: a failure is reproducible.
settings.register_profile("default", deadline=None, derandomize=True, max_examples=25)
settings.load_profile("default")


# A runner may ignore Ctrl-C or SIGHUP, as `nohup pytest &` does: what it starts inherits that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture
def start():
    """Start a process with pipes of text. It and what it has started do not outlive the test."""
    started = []

    def start(command, **options):
        options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True} | options
        process = subprocess.Popen([*map(str, command)], start_new_session=True, **options)
        started.append(process)
        return process

    yield start
    for process in started:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        for pipe in (process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()


@pytest.fixture
def traces(monkeypatch):
    """How often what is compiled has been traced since the test began: a dict of counts."""
    counts = {"init": 0, "start": 0, "step": 0}

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
