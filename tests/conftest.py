"""How every test runs: shapes checked at run time, strict promotion, compiled programs kept."""

import os
from pathlib import Path

# JAX reads these when it is imported, which the hook below does.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parents[1] / ".jax_cache"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")
os.environ.setdefault("JAX_NUMPY_DTYPE_PROMOTION", "strict")

from jaxtyping import install_import_hook

# Not config, which JAX rebuilds around placeholders of any type, nor sequence, whose callers are
# users: both have checks of their own.
install_import_hook(["dcs_jax.core", "dcs_jax.tracker"], "beartype.beartype")

from hypothesis import settings

# The first example of each shape compiles. The same examples every time: a failure is reproducible.
settings.register_profile("default", deadline=None, derandomize=True, max_examples=25)
settings.load_profile("default")
