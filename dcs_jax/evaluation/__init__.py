"""Labelled sequences, metrics, many seeds, peers and a report: how good is a setting?"""

from dcs_jax.evaluation.experiment import Evaluation, Watch, evaluate
from dcs_jax.evaluation.results import Skipped

__all__ = ["Evaluation", "Skipped", "Watch", "evaluate"]
