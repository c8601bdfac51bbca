"""Compiled programs on disk, so that only the first process waits for them."""

import os
from pathlib import Path

import jax

_NAME = "dcs_jax"
FROM_SECONDS = 0.2  # programs that compile faster than this are not worth a file


def cache(folder: str | os.PathLike[str] | None = None) -> Path | None:
    """Keep JAX's compiled programs in a folder, from which the next process reads them.

    Call it before anything is compiled. The command line does.

    folder: where to; by default that of the environment variable `JAX_COMPILATION_CACHE_DIR`, else
        dcs_jax in the user's cache ($XDG_CACHE_HOME, or .cache in the home folder). Programs of
        other code in this process are kept there, too.

    Returns the folder, which may be deleted at any time; None where the user has no home, or
    nothing can be written there: programs are then kept in memory only. A folder that is given and
    cannot be made raises OSError.
    """
    named = os.environ.get("JAX_COMPILATION_CACHE_DIR")
    if folder is None and named:
        return Path(named)
    if folder is None:
        try:
            folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / _NAME
            folder.mkdir(parents=True, exist_ok=True)
        except (RuntimeError, OSError):
            return None
        if not os.access(folder, os.W_OK):
            return None
    else:
        Path(folder).mkdir(parents=True, exist_ok=True)
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", FROM_SECONDS)
    return Path(folder)
