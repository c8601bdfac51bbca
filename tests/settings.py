"""Settings that several tests share."""

import dataclasses

from dcs_jax.config import COMPONENTS, Config

# The paper's tracker, without what the default has beyond it.
WITHOUT_COMPONENTS = dict.fromkeys(COMPONENTS)
# Small, so that it compiles fast.
SMALL_DEFAULT = Config(canvas=20, parts=5, selectors=6, pool_size=12)
SMALL = dataclasses.replace(SMALL_DEFAULT, **WITHOUT_COMPONENTS)
