"""How good is a setting: labelled sequences, metrics, many seeds, baselines and a report."""

from dcs_jax.evaluation.experiment import Evaluation, Watch, evaluate
from dcs_jax.evaluation.results import Skipped

__all__ = ["Evaluation", "Skipped", "Watch", "evaluate"]
