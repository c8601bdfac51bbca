"""An independent reference of the tracker: float64 NumPy, plain loops, in the order of the paper.

Chen and Wang, "Robust Visual Tracking Using Dynamic Classifier Selection with Sparse Representation
of Label Noise", ACCV 2012. It is written from the description, not from the JAX code, and knows
nothing of it; one idea a function, so that each can be compared. The features are passed in.
"""

from .haar import Box, boxes_of, cell_weights, haar_map, haar_response, parts_of
from .records import Grid, Pool, Settings
from .samples import LABELS, reachable, training_places, training_responses
from .search import move, nearest_place, peak, score_map, squared_distances
from .selection import (
    bag_log_likelihood,
    first_best,
    label_noise,
    select_error,
    select_first,
    select_l1,
    select_mil,
)
from .solver import duality_gap, fista, huber_objective, objective, solve_exactly
from .strong import evidence, part_probabilities, smooth, strong_map, voting_weight
from .tracker import Maps, Tracker
from .weak import (
    count,
    error,
    first_sigma,
    kalman_update,
    vote_gaussian,
    vote_midpoint,
    votes,
)
from .window import cell_means, grey, integral

__all__ = [
    "LABELS",
    "Box",
    "Grid",
    "Maps",
    "Pool",
    "Settings",
    "Tracker",
    "bag_log_likelihood",
    "boxes_of",
    "cell_means",
    "cell_weights",
    "count",
    "duality_gap",
    "error",
    "evidence",
    "first_best",
    "first_sigma",
    "fista",
    "grey",
    "haar_map",
    "haar_response",
    "huber_objective",
    "integral",
    "kalman_update",
    "label_noise",
    "move",
    "nearest_place",
    "objective",
    "part_probabilities",
    "parts_of",
    "peak",
    "reachable",
    "score_map",
    "select_error",
    "select_first",
    "select_l1",
    "select_mil",
    "smooth",
    "solve_exactly",
    "squared_distances",
    "strong_map",
    "training_places",
    "training_responses",
    "vote_gaussian",
    "vote_midpoint",
    "votes",
    "voting_weight",
]
