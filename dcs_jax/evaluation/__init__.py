"""Labelled sequences, metrics, many seeds, peers and a report: how good is a setting?"""

from dcs_jax.evaluation.experiment import Broken, Evaluation, Watch, evaluate

__all__ = ["Broken", "Evaluation", "Watch", "evaluate"]
