"""A tracker for the experiments of the package got10k (`pip install got10k six`):

from got10k.experiments import ExperimentOTB
from dcs_jax.adapters.got10k import GOT10kTracker

experiment = ExperimentOTB("data/OTB", version=2015)
experiment.run(GOT10kTracker())
experiment.report(["dcs_jax"])
"""

from typing import Any

import numpy as np
from got10k.trackers import Tracker as Base
from numpy.typing import NDArray

import dcs_jax
from dcs_jax.config import Config


class GOT10kTracker(Base):  # type: ignore[misc] # got10k has no types
    """One track, as the experiments start it in each sequence."""

    def __init__(self, name: str = "dcs_jax", config: Config = Config(), seed: int = 0) -> None:
        """name: of the folder of results. config, seed: as for `dcs_jax.Tracker`."""
        # With the same seed, a second run has the same boxes.
        super().__init__(name, is_deterministic=True)
        self._tracker = dcs_jax.Tracker(config, seed)

    def init(self, image: Any, box: NDArray[np.float64]) -> None:
        """Start the track in an image of PIL; box: [4], x, y, w, h in pixels."""
        self._tracker.init(image, box)

    def update(self, image: Any) -> NDArray[np.float64]:
        """The box [4] in the next image; the best candidate where the object is lost."""
        _, box = self._tracker.update(image)
        return np.array(box)
