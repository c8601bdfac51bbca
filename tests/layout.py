"""The features of `dcs_jax`, stored for speed, in the reference's plain order.

dcs_jax has f = (m, k, n) along the last axis, the reference has f = (k, n, m) along the first.
"""

import numpy as np
import reference

from dcs_jax.config import Config
from dcs_jax.types import Pool


def in_reference_order(values, config: Config) -> np.ndarray:
    """Values [..., F] of the features of `dcs_jax`, as the reference has them: [F, ...]."""
    values = np.asarray(values)
    values = values.reshape(-1, config.pool_size, config.parts * config.selectors)
    ordered = values.transpose(2, 1, 0).reshape(-1, values.shape[0])
    return ordered if ordered.shape[1] > 1 else ordered[:, 0]


def reference_pool(pool: Pool, config: Config) -> reference.Pool:
    """The same features as weighted corners."""
    return reference.Pool(
        in_reference_order(pool.corners, config),
        in_reference_order(np.asarray(pool.coefficients, float) * np.asarray(pool.scale), config),
        in_reference_order(pool.boxes, config),
    )
